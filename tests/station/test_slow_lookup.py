"""A robot whose host is looked up slowly, or in vain, delays no other page."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable

import pytest

from cohelm.core.errors import CohelmError
from cohelm.station.robot_link import Linked
from cohelm.station.serve import Server
from tests.station.bare import Bare
from tests.station.conftest import WAIT
from tests.station.servers import served
from tests.station.visitor import asked, opened, session


@pytest.mark.parametrize("known", [True, False])
def test_a_robot_that_is_looked_up_slowly_delays_no_other_page(bare: Bare, known: bool) -> None:
    looked_up = threading.Event()
    connect: list[Callable[[str], Linked]] = [bare.connect]

    def slowly(name: str) -> Linked:
        looked_up.wait(WAIT / 1e3)
        if not known:
            raise CohelmError("the host 'robot.local' can not be found: check its name")
        return bare.connect(name)

    with served(lambda name: connect[0](name)) as server, opened(server) as page:
        page.recv()
        connect[0] = slowly
        said: list[str] = []
        other = threading.Thread(target=lambda: said.append(_last(server)))
        other.start()
        time.sleep(0.5)
        since = 1e3 * time.monotonic()
        beats = (json.loads(text) for text in page if isinstance(text, str))
        assert any(one["type"] == "beat" and one["at_ms"] > since for one in beats)
        looked_up.set()
        other.join()
        assert said == ["" if known else "the host 'robot.local' can not be found: check its name"]


def test_a_download_from_a_robot_that_is_not_found_says_so(bare: Bare) -> None:
    def unknown(_: str) -> Linked:
        raise CohelmError("the host 'robot.local' can not be found: check its name")

    with served(unknown) as server:
        bearer = f"Bearer {session(server)}"
        for method in ("POST", "GET"):
            said = asked(server, method, "/records/drive.mcap", authorization=bearer)
            assert said.status == 503
            assert "can not be found" in said.text


def _last(server: Server) -> str:
    """Why the station closes a connection at once; empty: it does not."""
    with opened(server) as page:
        try:
            page.recv(WAIT / 1e3)
        except Exception:
            return "" if page.protocol.close_rcvd is None else page.protocol.close_rcvd.reason
    return ""
