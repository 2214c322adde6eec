"""Short drives of the twin."""

from collections.abc import Sequence

import numpy as np

from cohelm.core.types import Pose, Twist
from cohelm.robot.model import RobotModel
from cohelm.robot.port import RobotPort
from cohelm.scenario.load import robot
from cohelm.sim.world import Body, World, world

ORIGIN = Pose(0.0, 0.0, 0.0)


def sally(**changes: object) -> RobotModel:
    """Sally, without her camera unless there are changes to it."""
    return RobotModel.model_validate({**robot("sally").model_dump(), "camera": None, **changes})


def disc(x: float, y: float, radius: float, vx: float = 0.0, vy: float = 0.0) -> Body:
    return Body((x, y, vx, vy, radius, 0.2))


def scene(*bodies: Body, walls: Sequence[Sequence[float]] = ()) -> World:
    return world((list(bodies), np.array(walls, dtype=np.float64).reshape(-1, 4)))


def drive(robot: RobotPort, twist: Twist, seconds: float) -> list:
    """The truth every 20 ms."""
    seen = []
    end = robot.now() + seconds
    while robot.now() < end - 1e-9:
        robot.send(twist)
        robot.wait(robot.now() + 0.02)
        seen.append(robot.truth())
    return seen


def brake(robot: RobotPort, seconds: float = 2.0):
    return drive(robot, Twist(0.0, 0.0), seconds)[-1]
