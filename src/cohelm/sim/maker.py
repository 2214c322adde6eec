"""Makes a simulated robot, in the process that is to hold it."""

from __future__ import annotations

from typing import Literal, NamedTuple

from cohelm.core.types import Pose
from cohelm.robot.clock import SteppedClock, WallClock
from cohelm.robot.model import RobotModel
from cohelm.robot.port import RobotPort
from cohelm.sim.grid import Grid
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import World

Kind = Literal["kinematic", "twin"]


class SimulatedMaker(NamedTuple):
    """All that a simulated robot is made of. Who unpickles it imports no more than it needs."""

    model: RobotModel
    start: Pose
    world: World
    grid: Grid
    kind: Kind
    seed: int
    real_time: bool

    def __call__(self) -> RobotPort:
        """A robot that stands at the start."""
        model, start, world, grid, kind, seed, real_time = self
        clock = WallClock() if real_time else SteppedClock()
        if kind == "kinematic":
            return Kinematic(model, start, world, grid=grid, seed=seed, clock=clock)
        from cohelm.sim.twin.robot import Twin  # MuJoCo takes half a second to import

        return Twin(model, start, world, grid=grid, seed=seed, clock=clock)
