"""Remembers how movers change their velocities, and gathers those that matter for a horizon."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.bounds import brake_steps
from cohelm.law.guard.surroundings import Surroundings, rests
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.robot.limits import Limits

_WATCHED = 64  # movers are watched at most
_SLOW = 0.05  # nobody makes way for who is slower; as in `plan.prediction` [m/s]
_SAME = 0.5  # who is farther from where he should be by now is somebody else [m]
_LASTS = 0.5  # of a change of velocity, share that is taken from the newest look
_WALKS, _LATELY = 0.3, 1.0  # who was faster so lately may set off again at any moment [m/s, s]
_KNOWN = 0.5  # who has walked for less may be noise, and none of whom to expect it [s]
_HARD = 0.5  # of what he is capable of, from which on who slows down is taken to stop
_AGREE = 0.8  # two accelerations, as a share of the larger one, that are no noise
_FASTER = 2.0  # times as fast as he was ever seen may who sets off become
_NOTICED = 0.3  # until it is seen that somebody sets off: three looks [s]


def nobody_watched() -> Floats:
    """Memory of how movers change their velocities, for `evade`: (64, 12), as many rows of x, y,
    vx, vy, ax, ay, the mean square of what they were taken from (-1: not known yet), the largest
    speed so far, the time since he was last faster than `_WALKS`, for how long he has been, and
    the acceleration since the last look but one, as there were movers at the last look, then NaN.
    """
    return np.full((_WATCHED, 12), math.nan)


@jit
def noted(seen: Floats, around: Surroundings, period: float) -> Floats:
    """Those that move, and how they change their velocities, as `nobody_watched` says."""
    found = np.empty((min(len(around.discs), _WATCHED), 12))
    n = 0
    for i in range(len(around.discs)):
        d = around.discs[i]
        if n == len(found) or not math.hypot(d[VX], d[VY]) > 0.0:  # nor for NaN
            continue
        one = found[n]
        one[0], one[1], one[2], one[3] = d[X], d[Y], d[VX], d[VY]
        one[4], one[5], one[6], one[7] = 0.0, 0.0, -1.0, math.hypot(d[VX], d[VY])
        walks = one[7] > _WALKS
        one[8], one[9] = (0.0, period) if walks else (math.inf, 0.0)
        one[10], one[11] = 0.0, 0.0
        best, before = _SAME, -1
        for j in range(len(seen)):
            far = math.hypot(
                seen[j, 0] + period * seen[j, 2] - d[X], seen[j, 1] + period * seen[j, 3] - d[Y]
            )
            if far < best:
                best, before = far, j
        if before >= 0:
            most = max(around.max_acceleration[i], 0.0)
            ax, ay = (d[VX] - seen[before, 2]) / period, (d[VY] - seen[before, 3]) / period
            push = math.hypot(ax, ay)
            share = min(1.0, most / push) if push > 0.0 else 1.0
            ax, ay = ax * share, ay * share
            new = 1.0 if seen[before, 6] < 0.0 or _turned(seen[before], ax, ay, most) else _LASTS
            one[10], one[11] = ax, ay
            one[4] = seen[before, 4] + new * (ax - seen[before, 4])
            one[5] = seen[before, 5] + new * (ay - seen[before, 5])
            one[6] = max(seen[before, 6], 0.0)
            one[6] += new * (ax * ax + ay * ay - one[6])
            one[7] = max(one[7], seen[before, 7])
            one[8] = min(one[8], seen[before, 8] + period)
            one[9] += seen[before, 9]
        n += 1
    return found[:n]


@jit_inline
def _turned(was: Floats, ax: float, ay: float, most: float) -> bool:
    """Whether who is known to walk accelerates as he did a look ago, and hard: what he did before
    says no more what he will do. most: of what he is capable [m/s^2]."""
    larger = max(ax * ax + ay * ay, was[10] * was[10] + was[11] * was[11])
    hard = larger > _HARD * _HARD * most * most
    agree = ax * was[10] + ay * was[11] > _AGREE * larger
    return was[9] > _KNOWN and was[8] < _LATELY and hard and agree


@jit
def foreseen(
    around: Surroundings, seen: Floats, pose: Pose, reach: float, limits: Limits, e: EvasionParams
) -> tuple[Floats, int]:
    """Those that could matter within the horizon, and how many of them come first because they
    move, or did lately; the others may set off."""
    found = np.empty((2 * len(around.discs), 13))
    n = _gathered(found, 0, True, around, seen, pose, reach, limits, e)
    return found[: _gathered(found, n, False, around, seen, pose, reach, limits, e)], n


@jit
def _gathered(
    found: Floats, n: int, moving: bool, around: Surroundings, seen: Floats, pose: Pose,
    reach: float, limits: Limits, e: EvasionParams,
) -> int:  # fmt: skip
    """Write those that move, or those that do not, from row n on; one past the last row."""
    k = 0
    fast = min(e.speed, limits.speed)
    stops = brake_steps(Twist(fast, 0.0), limits, STEP) * STEP
    for i in range(len(around.discs)):
        d = around.discs[i]
        vx, vy = d[VX], d[VY]
        max_acceleration = around.max_acceleration[i]
        speed, ax, ay = math.hypot(vx, vy), 0.0, 0.0
        top, lately, turning = 0.0, speed > _SLOW, e.turning
        if speed > 0.0:
            if k < len(seen):
                lasts = 0.0
                if seen[k, 6] > 0.0:  # what does not last was noise
                    lasts = min((seen[k, 4] ** 2 + seen[k, 5] ** 2) / seen[k, 6], 1.0)
                known = seen[k, 9] > _KNOWN
                top = seen[k, 7] if known else 0.0
                lately = lately or (known and seen[k, 8] < _LATELY)
                ax, ay = lasts * seen[k, 4], lasts * seen[k, 5]
            k += 1
        if rests(around, i):
            continue
        if lately != moving:
            continue
        far = math.hypot(d[X] - pose.x, d[Y] - pose.y) - d[RADIUS] - reach
        if not far < (speed + e.speed) * e.horizon + e.social_clearance:
            continue
        if speed > 0.0:  # who slows down, stops; he does not go back
            brakes = -(ax * vx + ay * vy) / speed
            straight = max(_HARD * max_acceleration, 0.9 * math.hypot(ax, ay))
            if brakes > straight:
                turning = speed / brakes
                ax, ay = -brakes * vx / speed, -brakes * vy / speed
            elif -brakes > straight:  # who gets faster does so for as long as he may
                turning = max((_FASTER * top - speed) / -brakes, turning)
            else:
                back = min(speed / e.turning - brakes, 0.0) / speed
                ax, ay = ax - back * vx, ay - back * vy
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = d[X], d[Y], vx, vy
        found[n, 4], found[n, 5], found[n, 12] = (
            d[RADIUS], max_acceleration, around.velocity_error[i],
        )  # fmt: skip
        found[n, 6] = e.standing_growth
        if moving:
            found[n, 6] = min(e.moving_growth + e.growth_per_speed * speed, e.most_growth)
        found[n, 7], found[n, 8], found[n, 9], found[n, 10] = ax, ay, turning, _FASTER * top
        gains = min(max_acceleration, e.sets_off_acceleration)
        way = reach + d[RADIUS] + 0.5 * gains * stops * stops
        found[n, 11] = min(_NOTICED + way / max(fast, 1e-3) + 0.5 * stops, e.horizon)
        n += 1
        if e.pass_right > 0.0 and far < math.inf:
            found[n] = found[n - 1]
            away = math.hypot(d[X] - pose.x, d[Y] - pose.y)
            share = e.pass_right / max(away, 1e-9)
            found[n, 0] -= share * (d[Y] - pose.y)
            found[n, 1] += share * (d[X] - pose.x)
            n += 1
    return n
