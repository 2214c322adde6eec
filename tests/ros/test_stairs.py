"""A stair ahead, and the whole loop behind a depth camera: the robot stops before it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from cohelm.core.types import Stick
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.simulated import Simulated, simulated
from cohelm.link.messages import Mode
from cohelm.loop.operator import Scripted
from cohelm.robot.gate.modes import latched
from cohelm.robot.sensors import FloorModel
from cohelm.ros.depth import Camera, DepthRanges, described
from tests.drive.faults import CORRIDOR
from tests.few import first as few
from tests.ros.test_depth import image, mounted, room

CAM = Camera(160, 120, 137.5, 137.5, 79.5, 59.5)
BODY = mounted(x=0.2, down=25.0, z=0.4)
NOISE = 0.01
"""Of a depth, of itself."""


class Looks:
    """A simulated robot that looks with a depth camera, along a corridor that ends in a stair."""

    def __init__(self, robot, edge: float, step: float, seed: int) -> None:
        self._robot, self._edge, self._step = robot, edge, step
        self._random = np.random.default_rng((seed, 0x57A1))
        self._made = DepthRanges(robot.model.further_lidars[0], CAM, BODY, "/depth")
        self._given = None

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def read(self):
        readings = self._robot.read()
        scan = readings.of_lidar("deep")
        if scan is None:
            return readings
        if self._given is None or self._given.number != scan.number:
            at = self._robot.truth().pose
            beside = [
                (-9.0, y - at.y, -1.0, 9.0, y - at.y + 0.1, 2.0) for y in (-1.6, 1.5)
            ]  # fmt: skip
            here = (-9.0, -9.0, -1.0, self._edge - at.x, 9.0, 0.0)
            depth = room(BODY, [*beside, here], CAM, floor=self._step)
            depth[~(depth < 30.0)] = 0.0  # too far to be measured
            depth *= 1.0 + NOISE * self._random.standard_normal(depth.shape)
            self._given = scan._replace(ranges=self._made.of(image(depth)))
        return readings._replace(further=(self._given,))


@dataclass(frozen=True)
class AtAStair(Simulated):
    """A kinematic robot with a LiDAR, and a camera that sees the stair in front of it."""

    edge: float = math.inf
    step: float = -0.18

    def __call__(self):
        return Looks(super().__call__(), self.edge, self.step, self.seed)


def before_a_stair(edge: float, step: float, seed: int) -> AtAStair:
    """edge: where the floor ends; step: how high what is behind it lies [m]."""
    made = simulated(CORRIDOR, real_time=False, seed=seed)
    given = made.model.lidar.model_copy(
        update={
            "height_band_m": (0.08, 1.0), "depth_image": True, "range_min_m": 0.2,
            "range_max_m": 4.0, "noise_m": 0.02, "dropout": 0.0, "beams": 80,
            "floor": FloorModel(from_m=0.45, to_m=1.6, cell_m=0.1),
        }
    )  # fmt: skip
    deep = described(CAM, BODY, given, "/depth").model_copy(update={"name": "deep"})
    model = made.model.model_copy(update={"camera": None, "further_lidars": [deep]})
    scenario = made.scenario.model_copy(
        update={"robot": model, "walls_m": [[-2, -1.5, 30, -1.5], [30, 1.5, -2, 1.5]]}
    )
    return AtAStair(scenario, "kinematic", False, seed, edge, step)


def driven(made: AtAStair, speed: float, seconds: float) -> tuple[float, float, str]:
    """With the stick ahead: how far its front came and how fast it was [m, m/s], and why it
    latched, if it did."""
    box: list[Session] = []
    front = float(np.asarray(made.model.outline)[:, 0].max())
    far, fast = 0.0, 0.0

    def stick(t: float) -> Stick:
        return Stick(0.0 if t < 0.8 else speed, 0.0)

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


@pytest.mark.slow
def test_where_there_is_no_stair_it_drives_on():
    far, _, latch = driven(before_a_stair(30.0, -0.18, 7), 1.0, 14.0)
    assert far > 5.0
    assert latch == ""
