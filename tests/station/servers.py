"""A real station and a real robot for tests."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.drive.operate import DriveOptions
from cohelm.drive.robot_process import RobotProcess
from cohelm.drive.teleop_server import TeleopConfig
from cohelm.link import keys
from cohelm.link.messages import Command, Device, Mode, RequestKind, Status
from cohelm.link.station_end import StationEnd
from cohelm.station.app import pages
from cohelm.station.robot_link import Connect, Linked
from cohelm.station.serve import Server
from tests.patience import started

PATIENCE = 5.0
"""Tests share their machine: who is late by less than this is not gone [s]. How soon things that
are gone are noticed is tested where nobody else is in the way: tests/link, tests/drive."""
NEAT = 60.0
"""A driver that a failed test left behind is gone by then [s]."""


class Robot:
    """The simulated robot with its real loop, gate and link, in its own processes."""

    def __init__(self, scenario: str, twin: bool, records: Path) -> None:
        of_robot, self.keys = keys.pair_here()
        self.records = records
        self._made = RobotProcess(
            DriveOptions(scenario, scenario, "twin" if twin else "kinematic", True, None, []),
            TeleopConfig(of_robot, "127.0.0.1", 0, records), False, PATIENCE,
        )  # fmt: skip
        assert started(self._made), self._made.over
        self.pid = self._made.pid
        self.watcher = StationEnd(self.keys, self._made.host, self._made.port)

    def connect(self, _: str) -> Linked:
        """One more operator's link."""
        return Linked(self.keys, self._made.host, self._made.port)

    def status(self) -> Status | None:
        """What it tells now."""
        told = self.watcher.status()
        return None if told is None else told.message

    def tidy(self) -> None:
        """As a test wants to find it: standing, nothing latched, and nobody drives."""
        end = time.monotonic() + NEAT
        while not _neat(status := self.status()):
            assert time.monotonic() < end, f"the robot is not fit for another test: {status}"
            if status is not None and status.lease.driver != status.lease.you:
                self.watcher.ask(RequestKind.TAKE)
            elif status is not None:
                self.watcher.steer(Command(Stick(0.0, 0.0), True, True, Device.SCRIPT))
                for what in (RequestKind.RESET, RequestKind.ACKNOWLEDGE, RequestKind.RECORD):
                    self.watcher.ask(what, 0)
                self.watcher.ask(RequestKind.MODE, Mode.HOLD)
                if _neat(status._replace(lease=status.lease._replace(driver=0, requester=0))):
                    self.watcher.ask(RequestKind.GIVE, 0)
            # as soon as it shows; but a client may ask for 20 things a second, and no more
            before, late = _untidy(status), time.monotonic() + 0.4
            while time.monotonic() < late and _untidy(self.status()) == before:
                time.sleep(0.02)

    def close(self) -> None:
        """End it."""
        self.watcher.close()
        self._made.close()


def _untidy(s: Status | None) -> tuple[object, ...] | None:
    """What there is to tidy up."""
    if s is None:
        return None
    return s.stopped, s.alarms, s.recording, s.mode != Mode.HOLD, s.lease.driver, s.lease.requester


def _neat(s: Status | None) -> bool:
    return s is not None and not any(_untidy(s) or ())


@contextmanager
def served(
    connect: Connect, host: str = "127.0.0.1", certificate: tuple[Path, Path] | None = None,
    port: int = 0, stale: float = PATIENCE,
) -> Iterator[Server]:  # fmt: skip
    try:
        pages()
    except CohelmError as error:
        pytest.skip(str(error))
    server = Server(connect, host, port, certificate, stale)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        until = time.monotonic() + 60.0
        while not server.started:
            assert time.monotonic() < until
            time.sleep(0.01)
        yield server
    finally:
        server.stop()
        thread.join(30.0)
        assert not thread.is_alive()
