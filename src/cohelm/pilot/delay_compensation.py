"""Delay compensation: predicts robot and obstacles to the moment a command takes effect."""

from __future__ import annotations

import math

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.surroundings import position_bound
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits


def periods(delay: float, dt: float) -> tuple[int, float]:
    """A delay as whole control periods, and the rest [s]."""
    whole = math.floor(delay / dt + 1e-6)
    left = delay - whole * dt
    return whole, left if left > 1e-6 * dt else 0.0


@jit_no_refcount
def predict_robot(
    pose: Pose, twist: Twist, rest: float, sent: Floats, k: int, limits: Limits, dt: float
) -> tuple[Pose, Twist]:
    """Pose and twist when the command decided now takes effect.

    twist: held for the `rest` of a period first. sent: (d, 2), the commands of the last d steps,
    not in effect yet; that of step k - d is in row k % d. Each is applied within the limits for
    `dt`.
    """
    if rest > 0.0:
        pose = arc(pose, twist, rest)
    d = len(sent)
    for j in range(d):
        slot = (k + j) % d
        twist = achievable(Twist(sent[slot, 0], sent[slot, 1]), twist, limits, dt)
        pose = arc(pose, twist, dt)
    return pose, twist


@jit
def predict_obstacles(obstacles: Surroundings, after: float) -> Surroundings:
    """The obstacles `after` seconds later: discs move with their velocity.

    Each grows by velocity_error * after + max_acceleration * after^2 / 2, and its velocity_error
    by max_acceleration * after.
    """
    if after == 0.0 or len(obstacles.discs) == 0:
        return obstacles
    discs, velocity_error = obstacles.discs.copy(), obstacles.velocity_error.copy()
    for i in range(len(discs)):
        discs[i, X] += discs[i, VX] * after
        discs[i, Y] += discs[i, VY] * after
        discs[i, RADIUS] += position_bound(velocity_error[i], obstacles.max_acceleration[i], after)
        velocity_error[i] += obstacles.max_acceleration[i] * after
    return Surroundings(
        discs, obstacles.max_acceleration, velocity_error, obstacles.segments, obstacles.points
    )
