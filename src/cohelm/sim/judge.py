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
from cohelm.core.types import RADIUS, Floats, Pose, Twist, X, Y
from cohelm.robot.clearance import circumscribed_radius, disc_clearance, segment_clearance
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from cohelm.sim.world import outline_clearance

LOOKS = 4
"""Looks in one control step, where anything is near enough to matter."""

FAR = 2.0
"""Clearances are measured up to here [m]; what stays farther away was not near."""

_NONE, _STANDING, _DEPARTING, _MOVING = range(4)
_DEEPER = 1e-9  # of an overlap, by rounding alone [m]


class Judged(NamedTuple):
    """What was seen so far.

    A contact lasts while the outline overlaps anything. It is a *moving* one if it began, with
    anything at all, while the robot moved; else a *standing* one: the robot had stopped and was
    walked into. If the robot moves before that ends, and by its own motion deeper into what it
    overlaps, it is a *departing* one as well.
    """

    clearance: float = FAR
    """Smallest clearance of the outline to anything, negative in overlap; at most FAR [m]."""
    clearance_moving: float = FAR
    """The same while the robot moved, but for what had come into it while it stood [m]."""
    at: float = 0.0
    """When the smallest clearance was, a moving robot's before a standing one's [s]."""
    moving: int = 0
    """Moving contacts."""
    standing: int = 0
    """Standing contacts."""
    departing: int = 0
    """Those of them in which the robot then moved into what it overlapped."""
    steps: int = 0
    """Steps judged."""
    touched: int = 0
    """Those of them in which anything was overlapped."""
    excess: float = 0.0
    """Most by which a limit was exceeded, in the limit's own unit."""
    touching: int = _NONE
    """The contact that goes on, if any."""
    before: Twist = Twist(0.0, 0.0)
    """What the wheels did in the last step judged."""
    first: float = math.nan
    """When the first contact was; a moving one before a standing one [s]."""


@jit_inline
def least_clearance(
    pose: Pose, twist: Twist, dt: float, now: Floats, after: Floats, between: Floats,
    outline: Floats, reach: float, walls: Floats, matters: float,
) -> float:  # fmt: skip
    """Smallest clearance of the outline while `twist` is held for `dt` [m], at most FAR.

    now, after: (m, 6) discs at both ends, straight in between; the far end belongs to the next
    step. between: (m, 6), overwritten. reach: the outline's farthest corner [m]. Looked at once
    where no clearance below `matters` is possible, else LOOKS times.
    """
    least = outline_clearance(pose, outline, reach, now, walls, FAR)
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
        least = min(least, outline_clearance(there, outline, reach, between, walls, FAR))
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
    clearance, clearance_moving, at = seen.clearance, seen.clearance_moving, seen.at
    moving, standing, over, touching = seen.moving, seen.standing, seen.excess, seen.touching
    before, first, reach = seen.before, seen.first, circumscribed_radius(outline)
    departing, touched = seen.departing, seen.touched
    between = np.empty((discs.shape[1], discs.shape[2]))
    for k in range(len(rows) - 1):
        row = rows[k]
        twist = Twist(row.applied_v, row.applied_omega)
        over, before = max(over, excess(twist, before, limits, dt)), twist
        moves = twist.v != 0.0 or twist.omega != 0.0
        least = least_clearance(
            Pose(row.x, row.y, row.psi), twist, dt, discs[k], discs[k + 1], between, outline,
            reach, walls, max(clearance_moving if moves else clearance, 0.0),
        )  # fmt: skip
        entered = moves and least <= 0.0
        if entered and _STANDING <= touching <= _DEPARTING:
            here, end = Pose(row.x, row.y, row.psi), rows[k + 1]
            there = Pose(end.x, end.y, end.psi)
            entered = _entered(here, there, twist, dt, discs[k], discs[k + 1], outline, walls)
            if touching == _STANDING and _deeper(here, twist, dt, discs[k], outline, walls):
                departing, touching = departing + 1, _DEPARTING
        own = moves and (entered or least > 0.0)  # not what had come into the standing robot
        if least < clearance_moving and own:
            clearance_moving, at = least, row.t
        elif least < clearance and not own and clearance_moving == FAR:
            at = row.t
        clearance = min(clearance, least)
        touched += least <= 0.0
        if not least <= 0.0:
            touching = _NONE
        elif entered and touching != _MOVING:
            moving, touching = moving + 1, _MOVING
            first = row.t if moving == 1 else first
        elif not moves and touching == _NONE:
            standing, touching = standing + 1, _STANDING
            first = row.t if math.isnan(first) else first
    steps = seen.steps + len(rows) - 1
    return Judged(
        clearance, clearance_moving, at, moving, standing, departing, steps, touched, over,
        touching, before, first,
    )  # fmt: skip


@jit
def clearance_to(pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int) -> float:
    """The outline's clearance to disc i, or after the discs to a wall [m]."""
    n = len(discs)
    if i < n:
        return disc_clearance(pose, outline, discs[i, X], discs[i, Y], discs[i, RADIUS])
    w = walls[i - n]
    return segment_clearance(pose, outline, w[0], w[1], w[2], w[3])


@jit
def _entered(
    pose: Pose, after: Pose, twist: Twist, dt: float, now: Floats, then: Floats, outline: Floats,
    walls: Floats,
) -> bool:  # fmt: skip
    """Whether within a step anything comes to overlap that did not at its beginning."""
    between = now.copy()
    for i in range(len(now) + len(walls)):
        if clearance_to(pose, outline, now, walls, i) <= 0.0:
            continue
        for part in range(1, LOOKS + 1):
            share = part / LOOKS
            if i < len(now):
                between[i] = now[i] + share * (then[i] - now[i])
            there = after if part == LOOKS else arc(pose, twist, share * dt)
            if clearance_to(there, outline, between, walls, i) <= 0.0:
                return True
    return False


@jit
def _deeper(
    pose: Pose, twist: Twist, dt: float, now: Floats, outline: Floats, walls: Floats
) -> bool:  # fmt: skip
    """Whether the robot's own motion takes it deeper into anything that it overlaps."""
    there = arc(pose, twist, dt)
    for i in range(len(now) + len(walls)):
        clearance = clearance_to(pose, outline, now, walls, i)
        if clearance <= 0.0 and clearance_to(there, outline, now, walls, i) < clearance - _DEEPER:
            return True
    return False
