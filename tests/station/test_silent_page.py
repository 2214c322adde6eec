"""A driver whose page says nothing any more, though its connection is whole: a tablet asleep."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from cohelm.station import app, operator
from cohelm.station.serve import Server
from tests.link.ends import until
from tests.station.bare import Bare
from tests.station.servers import served
from tests.station.visitor import opened

SILENT = 0.5


@pytest.fixture
def server(bare: Bare, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(operator, "SILENT", SILENT)
    monkeypatch.setattr(app, "GRACE", 0.1)
    with served(bare.connect) as made:
        yield made


def drives(page: ClientConnection, bare: Bare) -> None:
    def ask() -> None:
        page.send(json.dumps({"type": "do", "what": "take", "value": 0}))
        time.sleep(0.3)

    until(lambda: bare.end.driver, turn=ask)


def test_a_driver_whose_page_is_silent_loses_the_lease(server: Server, bare: Bare) -> None:
    """In automatic mode it sends no stick that could be lost, and the station speaks for it."""
    with opened(server) as watching, opened(server) as page:
        drives(page, bare)
        until(lambda: not bare.end.driver, within=5.0)
        assert len(server.station.operators) == 1  # who only looks on may be silent
        watching.ping().wait(1.0)


def read(page: ClientConnection) -> None:
    while True:
        page.recv(timeout=30.0)


def test_a_page_whose_network_was_gone_comes_back_as_the_driver_that_it_was(
    bare: Bare,
) -> None:
    """It connects anew, and the station has not noticed yet that its first connection is dead."""
    with served(bare.connect) as server, opened(server) as before:
        welcome = json.loads(before.recv())
        drives(before, bare)
        driver = bare.end.driver
        with opened(server, key=welcome["key"]) as other:  # a second tab: the first one is well
            assert json.loads(other.recv())["you"] != welcome["you"]
        time.sleep(1.2)
        with opened(server, key=welcome["key"]) as again:
            assert json.loads(again.recv())["you"] == welcome["you"]
            with pytest.raises(ConnectionClosed):
                read(before)
            again.send(json.dumps({"type": "got", "stream": "state"}))
            who = {}
            while who.get("type") != "who" or not who["you_drive"]:
                text = again.recv(timeout=30.0)
                who = json.loads(text) if isinstance(text, str) else {}
            assert bare.end.driver == driver


def test_a_driver_whose_page_is_in_the_background_keeps_the_lease(
    server: Server, bare: Bare
) -> None:
    """A hidden page is late with its stick; that it has been sent something it says at once."""
    with opened(server) as page:
        drives(page, bare)
        end = time.monotonic() + 3.0 * SILENT
        while time.monotonic() < end:
            page.send(json.dumps({"type": "got", "stream": "state"}))
            time.sleep(0.05)
        assert bare.end.driver
