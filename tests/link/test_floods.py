"""Floods: a stop is executed within two periods, and the driver is not disturbed."""

from __future__ import annotations

import threading
import time

import pytest

from cohelm.core.types import Stick
from cohelm.link.messages import Command, Device, RequestKind
from cohelm.link.operator import STALE
from cohelm.link.station_end import StationEnd
from tests.link.ends import answered, until
from tests.link.floods import HERE, KINDS, PERIOD, Robot, Seen, flood, robot

pytestmark = pytest.mark.xdist_group("realtime")
STICK = Stick(0.25, -0.5)
RATE = 2000.0
"""Datagrams a second: forty times what a station sends."""
STOPS = 8
"""Under each kind of flood, by the driver and by a watcher in turn."""
QUIET = 0.02
"""Time in which a thread that was woken gets the processor on a machine that tests share [s]."""


class Driven:
    """A robot that is driven from this process, and watched."""

    def __init__(self, of: Robot) -> None:
        self.robot = of
        self.seen: list[Seen] = []
        self.driver = StationEnd(of.keys, HERE, of.port)
        self.watcher = StationEnd(of.keys, HERE, of.port)
        self._open = True
        self._threads = [threading.Thread(target=t) for t in (self._drive, self._watch)]
        for thread in self._threads:
            thread.start()
        until(lambda: self.driver.status() and self.watcher.status())
        answered(self.driver, RequestKind.TAKE)
        until(lambda: self.seen[-1].driven)

    def _drive(self) -> None:
        while self._open:
            self.driver.steer(Command(STICK, True, True, Device.SCRIPT))
            time.sleep(PERIOD)

    def _watch(self) -> None:
        while self._open:
            if self.robot.told.poll(0.05):
                self.seen.append(self.robot.told.recv())

    def close(self) -> None:
        self._open = False
        for thread in self._threads:
            thread.join()
        self.driver.close()
        self.watcher.close()


@pytest.fixture(scope="module")
def driven():
    with robot(STICK) as made:
        driven = Driven(made)
        yield driven
        driven.close()


def periods_until_stopped(driven: Driven, who: StationEnd, number: int, pressed: float) -> int:
    """Periods that had begun before the one that obeyed, since a stop was pressed; 1: the next."""
    until(lambda: who.answer(number), within=5.0)
    until(lambda: any(s.at > pressed and s.stop is not None for s in driven.seen))
    client = who.status().message.lease.you
    obeyed = next((s for s in driven.seen if s.at > pressed and s.stop == (client, number)), None)
    if obeyed is None:  # another's stop came first, and did it
        obeyed = next(s for s in driven.seen if s.at > pressed and s.stop is not None)
    on_the_way = pressed + QUIET
    return 1 + sum(on_the_way < s.at < obeyed.at for s in driven.seen)


def pressed(driven: Driven, kind: str) -> tuple[list[int], list[Seen]]:
    """Stops under a flood: periods until each was obeyed, and all the loop heard meanwhile."""
    with flood(kind, driven.robot, 120.0, RATE):
        time.sleep(0.3)
        began, took = time.monotonic(), []
        for k in range(STOPS):
            who = (driven.driver, driven.watcher)[k % 2]
            at = time.monotonic()
            number = who.ask(RequestKind.STOP)
            took.append(periods_until_stopped(driven, who, number, at))
            assert who.answer(number).granted
            time.sleep(0.05)
        ended = time.monotonic()
    return took, [s for s in driven.seen if began <= s.at <= ended]


@pytest.mark.parametrize("kind", ["requests", "stops", "sessions", "reconnects"])
def test_no_flood_of_a_paired_station_loses_a_stop(driven, kind):
    _, periods = pressed(driven, kind)
    assert all(s.first for s in periods)
    assert max(s.asked for s in periods) <= 20  # what the loop is asked for stays little


@pytest.mark.slow  # how soon, and beside whom: to be measured on a machine with nothing else to do
@pytest.mark.parametrize("kind", KINDS)
def test_no_flood_delays_a_stop_or_the_driver(driven, kind):
    took, periods = pressed(driven, kind)
    assert max(took) <= 2, took
    assert all(s.first for s in periods)
    assert all(s.driven for s in periods), sum(not s.driven for s in periods)
    assert max(s.age for s in periods) <= STALE
    assert max(s.asked for s in periods) <= 20
