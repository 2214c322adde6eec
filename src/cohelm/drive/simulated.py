"""The robot of a scenario, simulated: what the keeper's process is handed to make it there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.law.reference import desired
from cohelm.perceive.frames import compose
from cohelm.perceive.known import Known, known
from cohelm.robot.model import RobotModel
from cohelm.robot.pace import pace
from cohelm.robot.port import Robot
from cohelm.scenario import load
from cohelm.scenario.model import Scenario
from cohelm.scenario.worlds.maps import read_map
from cohelm.sim.kinematic import Kinematic

Kind = Literal["kinematic", "twin"]
_CELL = 0.025  # of the map that stands for one made by measuring the walls [m]


@dataclass(frozen=True)
class Simulated:
    """Makes the simulated robot of a scenario, wherever it is called."""

    scenario: Scenario
    """Standing alone: the robot's description is in it."""
    kind: Kind = "kinematic"
    real_time: bool = True
    seed: int = 0

    @property
    def model(self) -> RobotModel:
        """The robot."""
        if isinstance(self.scenario.robot, str):
            raise TypeError("the robot is still a name")
        return self.scenario.robot

    @property
    def start(self) -> Pose:
        """Where it begins."""
        given = self.scenario.start
        if given is not None:
            return Pose(given.x_m, given.y_m, given.heading_rad)
        first = desired(self.scenario.reference.spline(), 0.0, False)
        return Pose(first.x, first.y, first.psi)

    def __call__(self) -> Robot:
        """A new one, standing at the start."""
        around, clock = self.scenario.around(), pace(self.real_time)
        if self.kind == "kinematic":
            return Kinematic(self.model, self.start, around, seed=self.seed, pace=clock)
        try:
            from cohelm.sim.twin.robot import Twin
        except ImportError as error:
            raise CohelmError(
                'the physics twin needs MuJoCo: pip install "cohelm[twin]", or use --kinematic'
            ) from error
        return Twin(self.model, self.start, around, seed=self.seed, pace=clock)


def simulated(
    name: str | Path, kind: Kind = "kinematic", *, real_time: bool = True, seed: int | None = None,
    changes: list[str] | None = None,
) -> Simulated:  # fmt: skip
    """Of a scenario's file or name. Raises CohelmError for what can not be used."""
    made = load.scenario(name, changes or [])
    alone = load.standing_alone(made, Path())
    return Simulated(alone, kind, real_time, alone.simulation.seed if seed is None else seed)


def mapped(path: Path, start: Pose) -> Known:
    """A map as `cohelm map` makes it, whose axes are the robot's first pose, now `start`.

    Raises CohelmError where the file can not be used.
    """
    made = read_map(path)
    return replace(made, origin=compose(start, made.origin)).known()


def surveyed(walls: Floats, inside: Pose) -> Known:
    """The map of walls as if measured by tape: what can be reached from `inside` is free.

    walls: (s, 4) segments [m]. Raises CohelmError where there is no wall to localise by.
    """
    if not len(walls):
        raise CohelmError(
            "there are no walls to localise by: give a map with --map, or walls_m in the scenario"
        )
    low = walls.reshape(-1, 2).min(axis=0) - 0.5
    columns, rows = np.ceil((walls.reshape(-1, 2).max(axis=0) + 0.5 - low) / _CELL).astype(np.int64)
    occupied = np.zeros((int(rows), int(columns)), dtype=np.bool_)
    for x1, y1, x2, y2 in (walls - np.tile(low, 2)).tolist():
        n = max(int(math.hypot(x2 - x1, y2 - y1) / (0.4 * _CELL)), 1) + 1
        along = np.linspace(0.0, 1.0, n)
        row = np.rint((y1 + along * (y2 - y1)) / _CELL).astype(np.int64)
        column = np.rint((x1 + along * (x2 - x1)) / _CELL).astype(np.int64)
        occupied[row, column] = True
    origin = Pose(float(low[0]) - 0.5 * _CELL, float(low[1]) - 0.5 * _CELL, 0.0)
    free = _reached(occupied, inside.y - origin.y, inside.x - origin.x)
    return known(occupied, free, _CELL, origin)


def _reached(occupied: NDArray[np.bool_], y: float, x: float) -> NDArray[np.bool_]:
    """The cells connected with the one at a place [m] from the map's corner."""
    labels: NDArray[np.int32] = ndimage.label(~occupied)[0]  # pyright: ignore[reportAssignmentType, reportUnknownVariableType]
    i = min(max(int(y / _CELL), 0), len(labels) - 1)
    j = min(max(int(x / _CELL), 0), labels.shape[1] - 1)
    return (labels == labels[i, j]) & ~occupied
