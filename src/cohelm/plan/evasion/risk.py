"""How near movers will be: clearance, what the filter has to spare, and how uneasy it is."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.guard.bounds import brake_steps, coasting
from cohelm.law.guard.contact import point_clearance
from cohelm.law.guard.surroundings import strayed
from cohelm.plan.evasion.case import Case
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_ROUNDING = 1e-9  # more than what is lost in a few sums [m]


@jit
def trajectories(movers: Floats, reach: float, e: EvasionParams) -> Floats:
    """(k, m, 7): the movers after 0, 1, ... steps, past the horizon: x, y, velocity, speed by the
    acceleration that it is capable of [s], how near to it anything is uneasy [m], and farther than
    what from the robot's origin it is nowhere near [m]."""
    n = int(e.horizon / STEP) + 3
    ahead = np.empty((n, len(movers), 7))
    t = 0.0
    for k in range(n):
        for i in range(len(movers)):
            m, one = movers[i], ahead[k, i]
            until = min(t, m[9])
            goes = until * (t - 0.5 * until)
            one[0] = m[0] + m[2] * t + m[7] * goes
            one[1] = m[1] + m[3] * t + m[8] * goes
            one[2], one[3] = m[2] + m[7] * until, m[3] + m[8] * until
            walks = m[5] > 0.0 and m[10] > 0.0 and e.sets_off_weight > 0.0 < e.risk_weight
            one[4] = (
                math.hypot(one[2], one[3]) / min(m[5], e.sets_off_acceleration)
                if walks
                else math.inf
            )
            one[5] = e.clearance + m[6] * t
            far = one[5] + e.ahead * math.hypot(m[2], m[3])
            one[6] = max(far, _comes(m, one[4], 1.0, e)) + reach + m[4] + _ROUNDING
        t += STEP
    return ahead


@jit_inline
def clearance_at(
    then: Floats, movers: Floats, outline: Floats, reach: float, pose: Pose, t: float, most: float,
    growth: float, agile: float,
) -> float:  # fmt: skip
    """Least clearance of the outline to where the movers will be after t, at most `most` [m].

    then: as they are foretold, `agile` before t [s]; since then they have kept their velocity, and
    may have done anything else that they are capable of. growth: share of the doubt that they are
    larger by.
    """
    least = most
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(then)):
        dx = then[i, 0] + then[i, 2] * agile - pose.x
        dy = then[i, 1] + then[i, 3] * agile - pose.y
        r = movers[i, 4] + strayed(movers[i, 12], movers[i, 5], agile)
        r += growth * movers[i, 6] * t
        far = least + reach + r
        if dx * dx + dy * dy < far * far:
            least = min(least, point_clearance(outline, c * dx + s * dy, -s * dx + c * dy) - r)
    return least


@jit_inline
def spare_at(
    then: Floats, movers: Floats, outline: Floats, reach: float, pose: Pose, twist: Twist, t: float,
    limits: Limits, e: EvasionParams,
) -> float:  # fmt: skip
    """What is left between robot and movers when it has stopped from there, whatever they did of
    what the filter takes them to be capable of [m]."""
    takes = brake_steps(twist, limits, STEP) * STEP
    there = arc(pose, twist, coasting(twist, limits, STEP))
    growth = e.certified_growth
    return clearance_at(then, movers, outline, reach, there, t + takes, 1.0, growth, takes)


@jit_inline
def _comes(mover: Floats, stops: float, turns: float, e: EvasionParams) -> float:
    """How far a mover could come, if it turned on the robot, before the robot is away [m].

    stops: how long it takes to stop first [s]. The robot gets away to the front or to the back:
    from who is ahead or behind, after turning by so much of a radian. Nobody is faster than
    `_FASTER` lets him be; who is not known to walk does not count.
    """
    left = mover[11] + turns / e.yaw_rate - stops
    if not left > 0.0:
        return 0.0
    most = min(mover[5], e.sets_off_acceleration)
    top = min(mover[10], most * left)
    return top * left - 0.5 * top * top / most


@jit_inline
def risk_at(case: Case, pose: Pose, k: int, e: EvasionParams) -> tuple[float, float]:
    """How uneasy it is to be there after k steps, and the least clearance to where the movers are.

    Each counts (1 - clearance / d)^2 below d = `e.clearance` and the doubt of where he is by then;
    of those that stand only the nearest, as they may be many points of one thing. Who has been seen
    to move counts besides by how much nearer he is than `_comes`.
    """
    risk, stands, least = 0.0, 0.0, 9.0
    weight = e.sets_off_weight / e.risk_weight if e.risk_weight > 0.0 else 0.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(case.movers)):
        one, mover = case.ahead[k, i], case.movers[i]
        dx, dy = one[0] - pose.x, one[1] - pose.y
        if not dx * dx + dy * dy < one[6] * one[6]:  # nor for NaN
            continue
        near, r = one[5], mover[4]
        g = point_clearance(case.outline, c * dx + s * dy, -s * dx + c * dy) - r
        least = min(least, g)
        beside = abs(c * dy - s * dx) / max(math.hypot(dx, dy), 1e-9)
        zone = _comes(mover, one[4], 1.0 - beside, e)
        if zone > 0.0 and g < zone:
            share = 1.0 - max(g, 0.0) / zone
            risk += weight * share * share
        if e.ahead > 0.0:  # in front of somebody it is worse than behind him
            dx += mover[2] * e.ahead
            dy += mover[3] * e.ahead
            far = near + case.reach + r
            if dx * dx + dy * dy < far * far:
                g = min(g, point_clearance(case.outline, c * dx + s * dy, -s * dx + c * dy) - r)
        if g < near:
            share = 1.0 - max(g, 0.0) / near
            if mover[2] == 0.0 and mover[3] == 0.0:
                stands = max(stands, share * share)
            else:
                risk += share * share
    return risk + stands, least
