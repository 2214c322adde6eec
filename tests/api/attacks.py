"""A robot whose every command goes through the safety filter alone, and who wants to crash it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.obstacles import Obstacles
from cohelm.core.types import Pose, Twist, disc
from cohelm.pilot.safety_filter import SafetyFilter
from cohelm.robot.clearance import disc_clearance, segment_clearance
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import Body, world

HERE = Pose(0.0, 0.0, 0.0)
ROOM = 0.05
"""From the robot at its start to anything, at least [m]."""


class Attacked(NamedTuple):
    """What became of a drive."""

    least: float
    """Smallest clearance of the real outline at any time [m]."""
    driven: float
    """Length of the commands [m]."""


def model(name: str, delay: float) -> RobotModel:
    """A shipped robot with another delay, that knows everything as it is."""
    return robot(name).model_copy(update={"delay_s": delay, "lidar": None})


def standing(rng: np.random.Generator, outline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Discs (x, y, radius) and walls all round a robot at the origin; nothing moves."""
    discs = np.column_stack((rng.uniform(-3, 3, (14, 2)), rng.uniform(0.0, 0.4, 14)))
    walls = rng.uniform(-3, 3, (4, 4))
    free = [disc_clearance(HERE, outline, *row) > ROOM for row in discs.tolist()]
    apart = [segment_clearance(HERE, outline, *row) > ROOM for row in walls.tolist()]
    return discs[free], walls[apart]


def attacked(
    name: str, seed: int, delay: float, period: float, seconds: float = 10.0, noise: float = 0.0,
    uneven: bool = False, late: float = 1.0,
) -> Attacked:  # fmt: skip
    """Half of the time at the nearest thing, else full deflections at random.

    noise: standard deviation of the twist that the filter is told [m/s, rad/s]. uneven: calls come
    when they like, none later than a period after the last, and not many more. late: periods from
    one call to the next, which the filter is told.
    """
    rng = np.random.default_rng(seed)
    made = model(name, delay)
    discs, walls = standing(rng, made.outline)
    bodies = [Body(disc(*row)) for row in discs.tolist()]
    plant = Kinematic(made, HERE, world((bodies, walls)), seed=seed)
    safe, seen = SafetyFilter(made, period), Obstacles(discs=discs, segments=walls)
    nominal, driven, k, after = Twist(2.0, 0.0), 0.0, 0, late * period
    while plant.now() < seconds:
        pose, twist = plant.truth().pose, plant.truth().twist
        if k * late * period % 3.0 < 1.5 and len(discs):
            away = discs[:, :2] - [pose.x, pose.y]
            dx, dy = away[np.argmin(np.hypot(*away.T) - discs[:, 2])]
            turn = math.remainder(math.atan2(dy, dx) - pose.psi, 2.0 * math.pi)
            nominal = Twist(2.0 * math.cos(turn), 4.0 * math.sin(turn))
        elif rng.random() < 2.5 * late * period:
            nominal = Twist(rng.choice([-2.0, 0.0, 2.0]), rng.uniform(-4.0, 4.0))
        told = Twist(twist.v + noise * rng.normal(), twist.omega + noise * rng.normal())
        command = safe(pose, told, nominal, seen, after).twist
        plant.send(command)
        k += 1
        if uneven:
            after = period * min(2.0 * rng.random(), 1.0) if k % 2 else period
            plant.wait(plant.now() + after)
        else:
            plant.wait(k * late * period)
        driven += abs(command.v) * after
    return Attacked(plant.truth().least, driven)
