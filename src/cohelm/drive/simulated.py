"""The factory of a scenario's simulated robot; the gate process calls it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.robot.clock import clock_of
from cohelm.robot.model import RobotModel
from cohelm.robot.port import RobotPort
from cohelm.scenario import load
from cohelm.scenario.model import Scenario
from cohelm.scenario.worlds.maps import read_map
from cohelm.sim.grid import NO_GRID
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.settings import TwinModel, lag

Kind = Literal["kinematic", "twin"]
NO_WALLS: Floats = np.empty((0, 4))


@dataclass(frozen=True)
class Simulated:
    """Makes the simulated robot of a scenario in the process that calls it."""

    scenario: Scenario
    """Self-contained: has the robot's description."""
    kind: Kind = "kinematic"
    real_time: bool = True
    seed: int = 0

    @property
    def model(self) -> RobotModel:
        """The robot."""
        return self.scenario.described()

    @property
    def start(self) -> Pose:
        """Its first pose."""
        return self.scenario.first_pose()

    def delay(self, period: float) -> float:
        """From a command to its effect, as the guard must predict it [s]."""
        if self.kind == "kinematic":
            return self.model.delay_s
        return lag(self.model, TwinModel(), period)

    def __call__(self) -> RobotPort:
        """Make a robot that stands at the start."""
        scenery, clock = self.scenario.scenery(), clock_of(self.real_time)
        if scenery.grid is not NO_GRID:  # its borders come with the map, and a LiDAR sees its cells
            scenery = scenery._replace(walls=NO_WALLS)
        world, grid = self.scenario.build_world(scenery), scenery.grid
        if self.kind == "kinematic":
            return Kinematic(self.model, self.start, world, grid=grid, seed=self.seed, clock=clock)
        from cohelm.sim.twin.robot import Twin  # MuJoCo takes half a second to import

        return Twin(self.model, self.start, world, grid=grid, seed=self.seed, clock=clock)


def simulated(
    name: str | Path, kind: Kind = "kinematic", *, real_time: bool = True, seed: int | None = None,
    changes: list[str] | None = None,
) -> Simulated:  # fmt: skip
    """A factory by a scenario's file or name. Raises CohelmError if that can not be used."""
    made = load.scenario(name, changes or [])
    alone = load.standing_alone(made, Path())
    return Simulated(alone, kind, real_time, alone.simulation.seed if seed is None else seed)


def mapped(path: Path, start: Pose) -> LocalizationMap:
    """A map to localise on, in the world's frame.

    A published map is in that frame already; a map of `cohelm map` is in the frame of the robot's
    first pose, here `start`. Raises CohelmError if the file can not be used.
    """
    return read_map(path).placed(start).known()
