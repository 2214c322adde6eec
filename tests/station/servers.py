"""A real station, with a robot to drive, for as long as a test needs it."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.drive.trial import SimulatedRobot
from cohelm.link.messages import Status
from cohelm.scenario import build, load
from cohelm.station.app import pages
from cohelm.station.robot_link import Connect
from cohelm.station.serve import Server


@contextmanager
def served(
    host: str = "127.0.0.1", certificate: tuple[Path, Path] | None = None,
    stale: float | None = None, connect: Connect | None = None, port: int = 0,
) -> Iterator[Server]:  # fmt: skip
    try:
        pages()
    except CohelmError as error:
        pytest.skip(str(error))
    if connect is None:
        with (
            robot() as simulated,
            served(host, certificate, stale, simulated.connect, port) as server,
        ):
            yield server
        return
    server = Server(connect, host, port, certificate, stale)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        until = time.monotonic() + 20.0
        while not server.started:
            assert time.monotonic() < until
            time.sleep(0.01)
        yield server
    finally:
        server.stop()
        thread.join(10.0)
        assert not thread.is_alive()


@contextmanager
def robot() -> Iterator[SimulatedRobot]:
    made = SimulatedRobot(build.setup(load.scenario("lab-avoid", [], None)), "sally", None)
    made.start()
    link = made.connect("the test")
    while not any(isinstance(news.message, Status) for news in link.news()):
        time.sleep(0.05)  # the first step compiles
    link.close()
    try:
        yield made
    finally:
        made.close()
