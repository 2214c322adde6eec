"""Every adapter of the port `robot.port.Robot`, and what the conformance suite may ask of it.

A new adapter adds itself to `ADAPTERS`; the suite then holds it to the port's promises.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Pose
from cohelm.robot.model import RobotModel
from cohelm.robot.pace import OnTheWall
from cohelm.robot.port import Robot
from cohelm.scenario.load import robot as load_robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.sim.world import World, world


class Adapter(NamedTuple):
    make: Callable[[], Robot]
    """A new robot, standing, at least 2 m from anything."""
    obeys: bool = True
    """Whether it moves as it is told; a replayed record does not."""
    real_time: bool = False
    """Whether `now()` is the clock on the wall."""
    timeout: float = 0.5
    """After how long without a command it stops by itself [s]."""


def sally() -> RobotModel:
    return load_robot("sally")


def room() -> World:
    walls = [[-4, -3, 6, -3], [6, -3, 6, 3], [6, 3, -4, 3], [-4, 3, -4, -3]]
    return world(([], np.array(walls, dtype=np.float64)))


START = Pose(0.0, 0.0, 0.0)

ADAPTERS: dict[str, Adapter] = {
    "kinematic": Adapter(lambda: Kinematic(sally(), START, room(), seed=3)),
    "kinematic, real time": Adapter(
        lambda: Kinematic(sally(), START, room(), seed=3, pace=OnTheWall()), real_time=True
    ),
    "twin": Adapter(lambda: Twin(sally(), START, room(), seed=3)),
    "twin, real time": Adapter(
        lambda: Twin(sally(), START, room(), seed=3, pace=OnTheWall()), real_time=True
    ),
}
