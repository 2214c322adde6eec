"""Delay compensation: predicts robot and obstacles to the moment a command takes effect."""

from __future__ import annotations

import math

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.surroundings import Surroundings
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits


def periods(delay: float, dt: float) -> tuple[int, float]:
    """A delay as whole control periods, and what is left over [s]."""
    whole = math.floor(delay / dt + 1e-6)
    left = delay - whole * dt
    return whole, left if left > 1e-6 * dt else 0.0


@jit
def foreseen(
    pose: Pose, twist: Twist, rest: float, sent: Floats, k: int, limits: Limits, dt: float
) -> tuple[Pose, Twist]:
    """Pose and twist when the command decided now takes effect.

    twist: held for the `rest` of a period first. sent: (d, 2), the commands of the last d steps,
    not in effect yet; that of step k - d lies in row k % d. The robot is taken to do what it can of
    each, for `dt`.
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
def moved_on(around: Surroundings, after: float, stop: float) -> Surroundings:
    """The same surroundings `after` seconds later, none for 0: discs go on with their velocity.

    Each grows by what it may have strayed by then, max_acceleration * after^2 / 2, and, because its
    velocity may be off by max_acceleration * after, by that much times `stop`, the longest time
    the robot may yet move for [s].
    """
    if after == 0.0 or len(around.discs) == 0:
        return around
    discs = around.discs.copy()
    for i in range(len(discs)):
        discs[i, X] += discs[i, VX] * after
        discs[i, Y] += discs[i, VY] * after
        discs[i, RADIUS] += around.max_acceleration[i] * after * (0.5 * after + stop)
    return Surroundings(discs, around.max_acceleration, around.segments, around.points)


@jit
def stopping(twist: Twist, limits: Limits, dt: float) -> float:
    """How long the robot may yet move for, at least, if it brakes after one step more [s]."""
    a = min(limits.acceleration, limits.wheel_acceleration)
    if a == math.inf:
        return dt
    rim = abs(twist.v) + 0.5 * limits.track * abs(twist.omega)
    return 2.0 * dt + rim / a
