"""The judge of a run: what its real outline touched, between the control steps too.

It works from the trace alone and shares nothing with any law: pose and twist of every step, the
truth about discs and walls, and the limits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose, Twist, X, Y
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from cohelm.sim.world import clearance

LOOKS = 4
"""Looks in one control step, where anything is near enough to matter."""

FAR = 2.0
"""Gaps are told up to here [m]; what stays farther away was not near."""

_NONE, _STANDING, _MOVING = range(3)


class Judged(NamedTuple):
    """What was seen so far.

    A contact lasts while the outline overlaps anything. It is a *moving* one if the robot moved
    at any instant of it, else a *standing* one: the robot had stopped and was walked into.
    """

    gap: float = FAR
    """Smallest gap of the outline to anything, negative in overlap; at most FAR [m]."""
    gap_moving: float = FAR
    """The same while the robot moved [m]."""
    at: float = 0.0
    """When the smallest gap was, a moving robot's before a standing one's [s]."""
    moving: int = 0
    """Moving contacts."""
    standing: int = 0
    """Standing contacts."""
    excess: float = 0.0
    """Most by which a limit was exceeded, in the limit's own unit."""
    touching: int = _NONE
    """The contact that goes on, if any."""
    before: Twist = Twist(0.0, 0.0)
    """What the wheels did in the last step judged."""
    first: float = math.nan
    """When the first moving contact was [s]."""


@jit_inline
def least_gap(
    pose: Pose, twist: Twist, dt: float, now: Floats, after: Floats, between: Floats,
    outline: Floats, reach: float, walls: Floats, matters: float,
) -> float:  # fmt: skip
    """Smallest gap of the outline while `twist` is held for `dt` [m], at most FAR.

    now, after: (m, 6) discs at both ends, straight in between; the far end belongs to the next
    step. between: (m, 6), overwritten. reach: the outline's farthest corner [m]. Looked at once
    where no gap below `matters` is possible, else LOOKS times.
    """
    least = clearance(pose, outline, reach, now, walls, FAR)
    fastest = 0.0
    for i in range(now.shape[0]):
        dx, dy = after[i, X] - now[i, X], after[i, Y] - now[i, Y]
        fastest = max(fastest, dx * dx + dy * dy)
    closing = (abs(twist.v) + abs(twist.omega) * reach) * dt + math.sqrt(fastest)
    if not (closing > 0.0 and least - closing < matters):
        return least
    for part in range(1, LOOKS):
        share = part / LOOKS
        for i in range(now.shape[0]):
            for column in range(now.shape[1]):
                a, b = now[i, column], after[i, column]
                between[i, column] = a + share * (b - a)
        there = arc(pose, twist, share * dt)
        least = min(least, clearance(there, outline, reach, between, walls, FAR))
    return least


@jit_inline
def excess(after: Twist, before: Twist, limits: Limits, dt: float) -> float:
    """The most by which a twist or its change exceeds a limit; 0 within all, to the last digit."""
    half = 0.5 * limits.track
    left = (after.v - half * after.omega) - (before.v - half * before.omega)
    right = (after.v + half * after.omega) - (before.v + half * before.omega)
    over = max(abs(after.v) - limits.speed, abs(after.omega) - limits.yaw_rate)
    over = max(over, abs(after.v) + half * abs(after.omega) - limits.wheel_speed)
    over = max(over, abs(after.v - before.v) - limits.acceleration * dt)
    over = max(over, abs(after.omega - before.omega) - limits.yaw_acceleration * dt)
    over = max(over, max(abs(left), abs(right)) - limits.wheel_acceleration * dt)
    return max(over, 0.0)


@jit
def judge(
    seen: Judged, rows: NDArray[np.void], discs: Floats, outline: Floats, walls: Floats,
    limits: Limits, dt: float,
) -> Judged:  # fmt: skip
    """Go on judging over the steps from each row to the next one.

    rows: (n,) of dtype `core.trace.ROW`, discs: (n, m, 6); of one piece of a run, with the last
    row of the piece before it in front, if there was one.
    """
    gap, gap_moving, at = seen.gap, seen.gap_moving, seen.at
    moving, standing, over, touching = seen.moving, seen.standing, seen.excess, seen.touching
    before, first, reach = seen.before, seen.first, 0.0
    for i in range(len(outline)):
        reach = max(reach, math.hypot(outline[i, 0], outline[i, 1]))
    between = np.empty((discs.shape[1], discs.shape[2]))
    for k in range(len(rows) - 1):
        row = rows[k]
        twist = Twist(row.applied_v, row.applied_omega)
        over, before = max(over, excess(twist, before, limits, dt)), twist
        moves = twist.v != 0.0 or twist.omega != 0.0
        least = least_gap(
            Pose(row.x, row.y, row.psi), twist, dt, discs[k], discs[k + 1], between, outline,
            reach, walls, max(gap_moving if moves else gap, 0.0),
        )  # fmt: skip
        if least < gap_moving and moves:
            gap_moving, at = least, row.t
        elif least < gap and not moves and gap_moving == FAR:
            at = row.t
        gap = min(gap, least)
        if not least <= 0.0:
            touching = _NONE
        elif moves and touching != _MOVING:
            standing -= touching == _STANDING
            moving, touching = moving + 1, _MOVING
            first = row.t if math.isnan(first) else first
        elif not moves and touching == _NONE:
            standing, touching = standing + 1, _STANDING
    return Judged(gap, gap_moving, at, moving, standing, over, touching, before, first)
