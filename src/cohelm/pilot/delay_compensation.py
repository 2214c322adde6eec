"""Delay compensation: predicts robot and obstacles to the moment a command takes effect."""

from __future__ import annotations

import math

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.surroundings import Surroundings, strayed
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
def moved_on(around: Surroundings, after: float) -> Surroundings:
    """The same surroundings `after` seconds later, none for 0: discs go on with their velocity.

    Each grows by what it may have strayed by then, velocity_error * after + max_acceleration *
    after^2 / 2, and its velocity may be off by max_acceleration * after more.
    """
    if after == 0.0 or len(around.discs) == 0:
        return around
    discs, off = around.discs.copy(), around.velocity_error.copy()
    for i in range(len(discs)):
        discs[i, X] += discs[i, VX] * after
        discs[i, Y] += discs[i, VY] * after
        discs[i, RADIUS] += strayed(off[i], around.max_acceleration[i], after)
        off[i] += around.max_acceleration[i] * after
    return Surroundings(discs, around.max_acceleration, off, around.segments, around.points)
