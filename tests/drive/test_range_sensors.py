"""Glass ahead, which the LiDAR does not see: the robot stops before it by a sonar, or at it by a
bumper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from cohelm.core.types import Stick
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.link.operator import Scripted
from cohelm.robot.contacts import ContactModel
from cohelm.robot.gate.modes import latched
from cohelm.robot.sensors import LidarModel
from tests.drive.faults import CORRIDOR
from tests.drive.wrapped import wrapped

GLASS = 2.6
"""Where it stands across the corridor [m]."""
SONAR = LidarModel.model_validate(
    {"name": "sonar", "range_sensor": True, "field_of_view_deg": 30, "range_min_m": 0.02,
     "range_max_m": 4.0, "rate_hz": 20, "noise_m": 0.01, "mount_x_m": 0.35}
)  # fmt: skip


class BehindGlass:
    """A simulated robot whose LiDAR looks through the glass."""

    def __init__(self, robot) -> None:
        self._robot = robot
        self._given = None

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def read(self):
        readings = self._robot.read()
        scan = readings.scan
        if scan is not None and (self._given is None or self._given.number != scan.number):
            at, lidar = self._robot.truth().pose, self.model.lidar.lidar()
            bearings = at.psi + lidar.first + lidar.step * np.arange(len(scan.ranges))
            ends = at.x + lidar.mount.x + np.where(
                np.isfinite(scan.ranges), scan.ranges, 0.0
            ) * np.cos(bearings)  # fmt: skip
            self._given = scan._replace(
                ranges=np.where(ends > GLASS - 0.1, math.inf, scan.ranges)
            )  # fmt: skip
        front = self.model.outline[:, 0].max()
        touches = self._robot.truth().pose.x + front >= GLASS
        contacts = tuple(one._replace(on=bool(touches)) for one in readings.contacts)
        return readings._replace(scan=self._given, contacts=contacts)


@dataclass(frozen=True)
class AtGlass(Simulated):
    """In a corridor that glass closes."""

    def maker(self):
        return wrapped(super().maker(), BehindGlass)


def before_glass(sonars, seed: int, bumpers=()) -> AtGlass:
    made = simulated(CORRIDOR, real_time=False, seed=seed)
    model = made.model.model_copy(
        update={"camera": None, "further_lidars": tuple(sonars), "bumpers": bumpers}
    )
    scenario = made.scenario.model_copy(
        update={
            "robot": model,
            "walls_m": [[-2, -1.5, 30, -1.5], [30, 1.5, -2, 1.5], [GLASS, -1.5, GLASS, 1.5]],
        }
    )
    return AtGlass(scenario, "kinematic", False, seed)


def driven(made: AtGlass, seconds: float):
    """With the stick ahead: how far its front came, how fast it was, and why it latched."""
    box: list[Session] = []
    front = float(np.asarray(made.model.outline)[:, 0].max())
    far, fast = 0.0, 0.0

    def look(loop) -> bool:
        nonlocal far, fast
        truth = loop.gated.truth()
        far, fast = max(far, truth.pose.x + front), max(fast, truth.twist.v)
        return loop.gated.now() > seconds

    def stick(t: float) -> Stick:
        return Stick(0.0 if t < 0.8 else 1.0, 0.0)

    operator = Scripted(stick, lambda: box[0].gated.now() if box else 0.0)
    with Session(SessionConfig(made, localise=False), operator) as session:
        box.append(session)
        session.run(look, Mode.MANUAL)
        gate = session.gated.gate
        return far, fast, gate.reason if latched(gate.mode) else ""


@pytest.mark.parametrize("seed", [1])
def test_glass_that_only_the_sonar_detects_is_not_hit(seed):
    far, fast, latch = driven(before_glass([SONAR], seed), 8.0)
    assert fast > 0.4
    assert GLASS - 0.4 < far < GLASS - 0.03
    assert latch == ""


def test_glass_that_only_the_bumper_detects_latches_a_stop():
    bumper = ContactModel(name="front", mount_x_m=0.36, width_m=0.4)
    far, fast, latch = driven(before_glass([], 1, (bumper,)), 8.0)
    assert fast > 0.4
    assert far < GLASS + 0.12  # its delay, and braking
    assert latch == "contact monitor: the front bumper is pressed"


@pytest.mark.slow
def test_without_the_sonar_the_glass_is_hit():
    """So the test above tells something."""
    far, _, _ = driven(before_glass([], 1), 10.0)
    assert far > GLASS
