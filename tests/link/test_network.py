"""Both ends over a bad network of real packets (namespaces; skipped where not permitted)."""

from __future__ import annotations

import functools
import inspect
import math
import threading
import time
from collections.abc import Callable
from contextlib import closing
from typing import Any, NamedTuple

import numpy as np
import pytest

from cohelm.core.types import Stick
from cohelm.link import station_end
from cohelm.link.bulk_messages import Piece
from cohelm.link.keys import pair_here
from cohelm.link.messages import Command, Device, Mode, RequestKind
from cohelm.link.operator import STALE
from cohelm.link.robot_bulk import RobotBulk
from cohelm.link.robot_end import RobotEnd
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import StationEnd
from tests.link import net
from tests.link.ends import STATUS, until
from tests.link.side import Side
from tests.patience import OwnTime

WHY_NOT = net.why_not()
pytestmark = [
    pytest.mark.xdist_group("realtime"),
    pytest.mark.skipif(bool(WHY_NOT), reason=f"no bad network can be made: {WHY_NOT}"),
]
DT = 0.02


class Used(NamedTuple):
    """One step of the robot's loop."""

    now: float
    made: float
    """When the command that was used was made, by the same clock; NaN: none was used."""
    age: float
    """How old the robot took it to be."""
    brake: bool
    stopped: str


class Drive:
    """A robot loop and a station that steers, each in its thread; the stick says when."""

    def __init__(self, network: net.Network) -> None:
        robot_keys, keys = pair_here()
        with network.robot():
            self.robot = RobotEnd(robot_keys, net.ROBOT, 7660)
            self.bulk = None
        with network.station():
            self.station = StationEnd(keys, net.ROBOT, 7660)
        self.network, self.robot_keys, self.keys = network, robot_keys, keys
        self.used: list[Used] = []
        self.made: dict[float, float] = {}
        self.side = Side()
        self.centred = True
        self.stood = 0.0
        """The longest time for which robot or person did not run at a stretch [s]."""
        self._open = True
        self._threads = [threading.Thread(target=t) for t in (self._loop, self._person)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._open = False
        for thread in self._threads:
            thread.join()
        self.station.close()
        self.robot.close()

    def _sleep(self) -> None:
        began = time.monotonic()
        time.sleep(DT)
        self.stood = max(self.stood, time.monotonic() - began - DT)

    def _person(self) -> None:
        number = 0
        while self._open:
            number += 1
            x = 0.0 if self.centred else 0.2 + 0.5 * (number % 4096) / 4096
            x = float(np.float32(x))
            self.made[x] = time.monotonic()
            self.station.steer(Command(Stick(x, 0.0), True, True, Device.SCRIPT))
            self._sleep()

    def _loop(self) -> None:
        while self._open:
            heard = self.robot.receive()
            for asked in heard.requests:
                granted, why = self.side.ask(asked.request, asked.name)
                self.robot.answer(asked.client, asked.request.number, granted, why)
            now = time.monotonic()
            result = self.side.step(heard)
            made = self.made.get(result.stick.x, math.nan) if result.stick.x else math.nan
            self.used.append(Used(now, made, heard.age, result.brake, self.side.stopped))
            self.robot.send_status(STATUS)
            self._sleep()

    def ask(self, what: RequestKind, value: int = 0) -> None:
        while True:
            number = self.station.ask(what, value)
            until(lambda number=number: self.station.answer(number))
            answer = self.station.answer(number)
            if answer.granted or "the driver already" in answer.reason:
                return

    def start(self) -> None:
        until(lambda: self.station.state().connected)
        until(self.station.status)
        self.ask(RequestKind.TAKE)
        until(lambda: self.used[-1].age < STALE)
        self.ask(RequestKind.RESET)
        self.centred = False
        until(lambda: not math.isnan(self.used[-1].made))

    def since(self, began: float) -> list[Used]:
        return [step for step in self.used if step.now >= began]


STOOD = 0.1
"""Where both ends and the network stood still for longer, nothing is told of the network [s]."""
TRIES = 3


def where_the_machine_runs(test: Callable[..., None]) -> Callable[..., None]:
    """The test with a drive over a network of its own; again, where it fails and the machine was
    frozen meanwhile."""

    @functools.wraps(test)
    def tried(**given: Any) -> None:
        for left in reversed(range(TRIES)):
            with OwnTime() as own, net.Network() as network, closing(Drive(network)) as drive:
                try:
                    return test(drive, network, **given)
                except AssertionError:
                    if not left or max(own.stood, drive.stood) < STOOD:
                        raise

    asked = list(inspect.signature(test).parameters.values())[2:]
    tried.__signature__ = inspect.Signature(asked)  # type: ignore[attr-defined]
    return tried


def true_ages(steps: list[Used]) -> list[float]:
    return [step.now - step.made for step in steps if not math.isnan(step.made)]


@pytest.mark.parametrize("loss", [pytest.param(0.02, marks=pytest.mark.slow), 0.10])
@where_the_machine_runs
def test_with_delay_jitter_and_loss_no_old_command_is_used(drive, network, loss):
    network.be(delay=0.05, jitter=0.01, loss=loss, duplicate=0.05, rate=4e6)
    drive.start()
    began = time.monotonic()
    time.sleep(3.0)
    steps = drive.since(began)
    ages = sorted(true_ages(steps))
    assert len(ages) > 0.8 * len(steps)
    assert ages[len(ages) // 2] < 0.12
    assert ages[-1] <= STALE + 0.05  # by a clock both share; the robot can not know better
    told = [s.age - (s.now - s.made) for s in steps if not math.isnan(s.made)]
    assert max(map(abs, told)) < 0.06  # half the shortest round trip
    state = drive.station.state()
    assert 0.05 < state.round_trip < 0.25  # the shortest of late; 100 ms, 14 ms of deviation
    assert abs(state.lost - loss) < 0.10


@where_the_machine_runs
def test_after_an_interruption_no_old_command_is_used_and_driving_continues(
    drive, network, monkeypatch
):
    """It is long enough for a stop, and for the station to try another connection."""
    monkeypatch.setattr(station_end, "_LOST", 1.0)
    network.be(delay=0.05, jitter=0.01)
    drive.start()
    session = drive.station._connection
    began = time.monotonic()
    network.be(loss=1.0)
    time.sleep(1.8)
    network.be(delay=0.05, jitter=0.01)
    dark = drive.since(began)
    first_brake = next(step.now for step in dark if step.brake)
    assert first_brake - began < STALE + 0.06 + 2 * DT  # 60 ms were under way
    assert dark[-1].stopped.startswith("no command for")
    until(lambda: drive.used[-1].age < STALE, within=1.0)
    assert drive.used[-1].brake  # it stays, until the driver says otherwise
    drive.centred = True
    time.sleep(0.3)
    drive.ask(RequestKind.RESET)
    drive.centred = False
    until(lambda: not math.isnan(drive.used[-1].made), within=2.0)
    assert drive.station._connection is session
    assert max(true_ages(drive.since(began))) <= STALE + 0.05


@where_the_machine_runs
def test_packets_held_for_three_seconds_and_then_delivered_move_nothing(drive, network):
    """A full buffer: every packet arrives in order, 3 s late, at once."""
    drive.start()
    began = time.monotonic()
    network.be(hoard=1.0)
    time.sleep(3.0)
    network.be()
    counts = drive.robot.counts
    until(lambda: counts["too old"] + counts["out of order"] > 50)
    time.sleep(0.4)
    ages = true_ages(drive.since(began))
    assert max(ages) <= STALE + 0.05


@where_the_machine_runs
def test_forged_replayed_and_reordered_packets_are_not_used(drive, network):
    drive.start()  # before: a handshake in which a fifth is damaged can take 10 s
    network.be(delay=0.02, jitter=0.02, duplicate=0.3, corrupt=0.2, replay=0.3)
    began = time.monotonic()
    until(lambda: len(drive.since(began)) >= 100)  # 2 s, and longer on a busy machine
    steps = drive.since(began)
    made = [step.made for step in steps if not math.isnan(step.made)]
    assert made == sorted(made)  # never back to an earlier command
    assert len(made) > 0.8 * len(steps)
    assert drive.robot.counts["out of order"] > 0
    assert drive.robot.counts["malformed"] == 0  # what was forged never came that far


@pytest.mark.slow
@where_the_machine_runs
def test_a_download_over_a_slow_link_does_not_delay_commands_or_status(drive, network, tmp_path):
    (tmp_path / "run.mcap").write_bytes(bytes(np.random.default_rng(1).bytes(3_000_000)))
    with network.robot():
        down = RobotBulk(drive.robot, drive.robot_keys, tmp_path)
    with network.station():
        up = StationBulk(drive.keys, net.ROBOT, 7660, drive.station.session)
    network.be(delay=0.025, rate=4e6, queue=200_000)
    try:
        drive.start()
        until(lambda: up.connected)
        from cohelm.link.bulk_messages import Fetch

        up.send(Fetch("run.mcap", 0, 3_000_000))
        got, ages, down_ages = 0, [], []
        began = time.monotonic()
        while time.monotonic() - began < 4.0:
            got += sum(len(m.data) for m in up.news() if isinstance(m, Piece))
            told = drive.station.status()
            down_ages.append(told.age)
            time.sleep(DT)
        ages = sorted(true_ages(drive.since(began)))
        assert got > 300_000  # it does flow
        assert ages[int(0.99 * len(ages))] < 0.15
        assert sorted(down_ages)[int(0.95 * len(down_ages))] < 0.20  # a full queue is 0.4 s
    finally:
        up.close()
        down.close()


@where_the_machine_runs
def test_only_a_stop_requested_during_an_interruption_is_executed_after_it(drive, network):
    drive.start()
    network.be(loss=1.0)
    mode = drive.station.ask(RequestKind.MODE, Mode.AUTOMATIC)
    stop = drive.station.ask(RequestKind.STOP)
    time.sleep(1.5)
    network.be()
    until(lambda: drive.station.answer(stop), within=3.0)
    assert drive.station.answer(mode).reason == "the robot did not answer in time"
    assert drive.side.mode is Mode.SHARED
    assert drive.side.stopped
