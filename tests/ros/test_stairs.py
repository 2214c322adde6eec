"""A stair ahead, and the whole loop behind a depth camera: the robot stops before it."""

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
from cohelm.robot.gate.modes import latched
from cohelm.robot.sensors import FloorModel
from cohelm.ros.depth import DepthRanges, Intrinsics, described
from tests.drive.faults import CORRIDOR
from tests.drive.wrapped import wrapped
from tests.few import first as few
from tests.ros.test_depth import image, mounted, room

CAM = Intrinsics(160, 120, 137.5, 137.5, 79.5, 59.5)
BODY = mounted(x=0.2, down=25.0, z=0.4)
FROM = 0.45
"""From there it sees the floor [m]."""
LIFTED = 1.5, 2.5
"""From when to when a robot that is carried is lifted [s]."""
NOISE = 0.01
"""Of a depth, of itself."""


class Looks:
    """A simulated robot that looks with a depth camera, along a corridor that ends in a stair."""

    def __init__(self, robot, edge: float, step: float, seed: int, carried: float) -> None:
        self._robot, self._edge, self._step, self._carried = robot, edge, step, carried
        self._random = np.random.default_rng((seed, 0x57A1))
        self._made = DepthRanges(robot.model.further_lidars[0], CAM, BODY, "/depth")
        self._given = self._first = None

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def read(self):
        readings = self._robot.read()
        scan = readings.of_lidar("deep")
        if scan is None:
            return readings
        if self._given is None or self._given.number != scan.number:
            at, floor = self._robot.truth().pose, 0.0
            if scan.stamp - self._begun() > LIFTED[1]:
                self._edge = min(self._edge, self._carried)
            elif scan.stamp - self._begun() > LIFTED[0] and self._carried < math.inf:
                floor = -0.5
            beside = [
                (-9.0, y - at.y, -1.0, 9.0, y - at.y + 0.1, 2.0) for y in (-1.6, 1.5)
            ]  # fmt: skip
            here = (-9.0, -9.0, floor - 1.0, self._edge - at.x, 9.0, floor)
            depth = room(BODY, [*beside, here], CAM, floor=floor + self._step)
            depth[~(depth < 30.0)] = 0.0  # too far to be measured
            depth *= 1.0 + NOISE * self._random.standard_normal(depth.shape)
            self._given = scan._replace(ranges=self._made.of(image(depth)))
        return readings._replace(further=(self._given,))

    def _begun(self) -> float:
        if self._first is None:
            self._first = self._robot.now()
        return self._first


@dataclass(frozen=True)
class AtAStair(Simulated):
    """A kinematic robot with a LiDAR, and a camera that sees the stair in front of it."""

    edge: float = math.inf
    step: float = -0.18
    carried: float = math.inf

    def maker(self):
        return wrapped(super().maker(), Looks, self.edge, self.step, self.seed, self.carried)


def before_a_stair(
    edge: float, step: float, seed: int, carried: float = math.inf, least: float = 0.2
) -> AtAStair:
    """edge: where the floor ends; step: how high what is behind it lies; carried: where it ends
    after the robot was lifted and put down, by its odometry; least: the camera's range [m]."""
    made = simulated(CORRIDOR, real_time=False, seed=seed)
    given = made.model.lidar.model_copy(
        update={
            "height_band_m": (0.08, 1.0), "depth_image": True, "range_min_m": least,
            "range_max_m": 4.0, "noise_m": 0.02, "dropout": 0.0, "beams": 80,
            "floor": FloorModel(from_m=FROM, to_m=1.6, cell_m=0.1),
        }
    )  # fmt: skip
    deep = described(CAM, BODY, given, "/depth").model_copy(update={"name": "deep"})
    model = made.model.model_copy(update={"camera": None, "further_lidars": [deep]})
    scenario = made.scenario.model_copy(
        update={"robot": model, "walls_m": [[-2, -1.5, 30, -1.5], [30, 1.5, -2, 1.5]]}
    )
    return AtAStair(scenario, "kinematic", False, seed, edge, step, carried)


def driven(
    made: AtAStair, speed: float, seconds: float, begins: float = 0.8
) -> tuple[float, float, str]:
    """With the stick ahead from then on: how far its front came and how fast it was [m, m/s], and
    why it latched, if it did."""
    box: list[Session] = []
    front = float(np.asarray(made.model.outline)[:, 0].max())
    far, fast = 0.0, 0.0

    def stick(t: float) -> Stick:
        return Stick(0.0 if t < begins else speed, 0.0)

    def look(loop) -> bool:
        nonlocal far, fast
        truth = loop.gated.truth()
        far, fast = max(far, truth.pose.x + front), max(fast, truth.twist.v)
        return loop.gated.now() > seconds

    operator = Scripted(stick, lambda: box[0].gated.now() if box else 0.0)
    with Session(SessionConfig(made, localise=False), operator) as session:
        box.append(session)
        session.run(look, Mode.MANUAL)
        gate = session.gated.gate
        return far, fast, gate.reason if latched(gate.mode) else ""


@pytest.mark.parametrize(
    ("edge", "step", "speed", "seed"),
    few([(2.4, -0.18, 1.0, 1), (2.6, -2.0, 1.0, 2), (3.1, -0.12, 1.0, 3), (2.2, -0.3, 0.5, 4),
         (2.8, -9.0, 0.8, 5), (2.5, -0.2, 1.0, 6)], 1),
)  # fmt: skip
def test_with_the_stick_ahead_it_stops_before_a_stair_and_nothing_latches(edge, step, speed, seed):
    far, fast, latch = driven(before_a_stair(edge, step, seed), speed, 4.0 + 2.2 * edge / speed)
    assert fast > 0.4 * speed**2  # as sticks are scaled
    assert edge - 0.6 < far < edge - 0.05
    assert latch == ""


def test_carried_to_a_stair_that_is_nearer_than_its_picture_it_does_not_go_there():
    """0.15 m before its front; the floor that it remembers there is of where it came from."""
    front = float(np.asarray(before_a_stair(30.0, -0.18, 8).model.outline)[:, 0].max())
    made = before_a_stair(30.0, -0.18, 8, front + 0.15, FROM)
    far, fast, _ = driven(made, 0.6, 7.0, begins=3.5)
    assert far < front + 0.1
    assert fast < 0.1


@pytest.mark.slow
def test_carried_to_where_there_is_floor_it_drives_on_by_the_loop():
    far, _, latch = driven(before_a_stair(30.0, -0.18, 8, 29.0, FROM), 0.6, 10.0, begins=3.5)
    assert far > 1.2
    assert latch == ""


@pytest.mark.slow
def test_where_there_is_no_stair_it_drives_on():
    far, _, latch = driven(before_a_stair(30.0, -0.18, 7), 1.0, 14.0)
    assert far > 5.0
    assert latch == ""
