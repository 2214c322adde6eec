"""The whole robot over a bad network of real packets: nothing old is driven, it stops, it goes on.

What the robot did is read from its record. Opt-in: `pytest -m slow tests/drive`.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from cohelm.core.types import Stick
from cohelm.link import keys
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind
from cohelm.link.operator import STALE
from cohelm.link.station_end import StationEnd
from cohelm.loop.stick import BACK_WITHIN, ArmingParams
from cohelm.record import period
from cohelm.record.messages import messages
from cohelm.robot.gate.modes import GateMode
from tests.drive.far import PORT, FarRobot
from tests.drive.faults import CORRIDOR
from tests.link import net
from tests.link.ends import until

WHY_NOT = net.why_not()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.xdist_group("realtime"),
    pytest.mark.skipif(bool(WHY_NOT), reason=f"no bad network can be made: {WHY_NOT}"),
]
PERIOD = 0.02
ON_THE_WAY = 0.05 + 4 * 0.01
"""Delay, and four deviations of it [s]."""
DARK = 3.0
BRAKING = 0.05 + 0.5 / 2.0 + 0.1
"""The robot's delay, from 0.5 m/s at 2 m/s^2, and a little for the odometry to show it [s]."""
PATIENT = 60.0


class Person(threading.Thread):
    """Holds the stick at 50 Hz; every deflection is another one, and when it was made is known."""

    def __init__(self, station: StationEnd) -> None:
        super().__init__(daemon=True)
        self.station, self.centred, self.open = station, True, True
        self.made: dict[float, float] = {}
        """Wall-clock time of each deflection [s]."""

    def run(self) -> None:
        number = 0
        while self.open:
            number += 1
            x = 0.0 if self.centred else float(np.float32(0.7 + 2e-5 * number))
            self.made[x] = time.time()
            self.station.steer(Command(Stick(x, 0.0), True, True, Device.SCRIPT))
            time.sleep(PERIOD)


class Row(NamedTuple):
    at: float
    """Wall clock [s]."""
    mode: GateMode
    stick: float
    v: float
    given: float


def rows(record: Path) -> list[Row]:
    found = [(stamp * 1e-9, m) for _, stamp, m in messages(record, ("/period",))]
    table = period.rows([m for _, m in found])
    return [
        Row(stamp, GateMode(int(p["mode"])), float(p["stick_x"]), float(p["measured_v"]),
            float(p["applied_v"]))
        for (stamp, _), p in zip(found, table, strict=True)
    ]  # fmt: skip


def ask(station: StationEnd, what: RequestKind, value: int, done) -> None:
    """Again and again: an answer may be lost for as long as one waits for it."""
    end = time.monotonic() + PATIENT
    while not done():
        assert time.monotonic() < end, (what, station.status())
        number = station.ask(what, value)
        until(lambda n=number: station.answer(n) or done(), PATIENT)


def drives(station: StationEnd, person: Person) -> None:
    """Take the lease where it is free, let go of what is latched, and drive by hand."""
    told = lambda: station.status().message  # noqa: E731
    until(station.status, PATIENT)
    person.centred = True
    ask(station, RequestKind.TAKE, 0, lambda: told().lease.driver == told().lease.you)
    until(lambda: told().arming == Arming.ARMED, PATIENT)
    ask(station, RequestKind.RESET, 0, lambda: not told().stopped)
    ask(station, RequestKind.MODE, Mode.MANUAL, lambda: told().mode == Mode.MANUAL)
    person.centred = False
    until(lambda: told().measured.v > 0.1 or told().stopped, PATIENT)
    assert not told().stopped


@pytest.mark.parametrize("loss", [0.02, 0.10])
def test_no_old_command_is_used_and_after_a_long_interruption_driving_continues(
    loss, tmp_path, monkeypatch
):
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    path = {"delay": 0.05, "jitter": 0.01, "loss": loss, "duplicate": 0.05, "rate": 4e6}
    with net.Network() as network:
        robot = FarRobot(network, str(CORRIDOR), tmp_path)
        try:
            with network.station():
                station = StationEnd(keys.station(), net.ROBOT, PORT)
            with station:
                person = Person(station)
                person.start()
                network.be(**path)
                drives(station, person)
                time.sleep(2.0)
                way = station._connection
                dark = time.time()
                network.be(loss=1.0)
                time.sleep(DARK)
                network.be(**path)
                light = time.time()
                until(lambda: station.status().message.stopped, PATIENT)
                drives(station, person)
                time.sleep(4.0)  # a busy machine lets fewer sticks through in a second
                assert station._connection is way
                person.open = False
                person.join()
        finally:
            summary = robot.end()
    said = robot.log.read_text()
    assert "SHARED -> STOPPED: the stick is lost: " in said or "the driver is lost: " in said, said
    all_ = rows(robot.record)
    ages = [r.at - person.made[r.stick] for r in all_ if r.stick and r.mode == GateMode.SHARED
            and r.stick in person.made]  # fmt: skip
    assert len(ages) > 100
    assert max(ages) <= STALE + 0.05  # by a clock both share; the robot can not know better
    latched = next(r.at for r in all_ if r.at > dark and r.mode == GateMode.STOPPED)
    noticed = ArmingParams().stale + ON_THE_WAY + PERIOD + 0.1
    # it brakes at once, and latches when nobody has come back within a second
    standing = next(r.at for r in all_ if r.at > dark and abs(r.v) < 0.02)
    assert standing - dark < noticed + BRAKING + PERIOD + 0.1
    assert latched - dark < BACK_WITHIN + noticed
    assert all(r.given == 0.0 for r in all_ if standing + 0.3 < r.at < light)
    assert any(r.v > 0.1 for r in all_ if r.at > light)  # it went on
    assert summary["least_clearance_moving_m"] > 0.1
    print(
        f"loss {loss:.0%}: age used median {1e3 * np.median(ages):.0f}, most "
        f"{1e3 * max(ages):.0f} ms; stood {1e3 * (standing - dark):.0f} ms after the black-out "
        f"began, latched after {1e3 * (latched - dark):.0f} ms"
    )
