"""How near movers will be: clearance, what the filter has to spare, and how uneasy it is."""

from __future__ import annotations

import math

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.guard.bounds import brake_steps, coasting
from cohelm.law.guard.contact import point_clearance
from cohelm.plan.evasion.case import Case
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits


@jit_inline
def _goes(t: float, turning: float) -> float:
    """By how much of its acceleration a mover is displaced after t [s^2]."""
    s = min(t, turning)
    return s * (t - 0.5 * s)


@jit
def clearance_at(
    movers: Floats, outline: Floats, reach: float, pose: Pose, t: float, most: float,
    growth: float, agile: float,
) -> float:  # fmt: skip
    """Least clearance of the outline to where the movers will be after t, at most `most` [m].

    growth: share of the doubt that they are larger by; agile: for so long before t they have kept
    their velocity, and may have done anything else that they are capable of [s].
    """
    least = most
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    since = t - agile
    for i in range(len(movers)):
        goes = _goes(since, movers[i, 9]) + agile * min(since, movers[i, 9])
        dx = movers[i, 0] + movers[i, 2] * t + movers[i, 7] * goes - pose.x
        dy = movers[i, 1] + movers[i, 3] * t + movers[i, 8] * goes - pose.y
        r = movers[i, 4] + 0.5 * movers[i, 5] * agile * agile + growth * movers[i, 6] * t
        far = least + reach + r
        if dx * dx + dy * dy < far * far:
            least = min(least, point_clearance(outline, c * dx + s * dy, -s * dx + c * dy) - r)
    return least


@jit
def spare_at(
    movers: Floats, outline: Floats, reach: float, pose: Pose, twist: Twist, t: float,
    limits: Limits, e: EvasionParams,
) -> float:  # fmt: skip
    """What is left between robot and movers when it has stopped from there, whatever they did of
    what the filter takes them to be capable of [m]."""
    takes = brake_steps(twist, limits, STEP) * STEP
    there = arc(pose, twist, coasting(twist, limits, STEP))
    return clearance_at(movers, outline, reach, there, t + takes, 1.0, e.certified_growth, takes)


@jit_inline
def _comes(
    mover: Floats, t: float, dx: float, dy: float, c: float, s: float, e: EvasionParams
) -> float:
    """How far a mover could come, if it turned on the robot after t, before the robot is away [m].

    dx, dy: where it is then, from the robot [m]; c, s: cosine and sine of the robot's heading. The
    robot gets away to the front or to the back: from who is ahead or behind, after turning by up to
    a radian. Who moves stops first. Nobody is faster than `_FASTER` lets him be; who is not known
    to walk does not count.
    """
    a, until = mover[5], min(t, mover[9])
    if not (a > 0.0 and mover[10] > 0.0):
        return 0.0
    u = math.hypot(mover[2] + mover[7] * until, mover[3] + mover[8] * until)
    beside = abs(c * dy - s * dx) / max(math.hypot(dx, dy), 1e-9)
    left = mover[11] + (1.0 - beside) / e.yaw_rate - u / a
    if not left > 0.0:
        return 0.0
    top = min(mover[10], a * left)
    return top * left - 0.5 * top * top / a


@jit
def risk_at(case: Case, pose: Pose, t: float, e: EvasionParams) -> tuple[float, float]:
    """How uneasy it is to be there after t, and the least clearance to where the movers will be.

    Each counts (1 - clearance / d)^2 below d = `e.clearance` and the doubt of where he is by then;
    of those that stand only the nearest, as they may be many points of one thing. Who has been seen
    to move counts besides by how much nearer he is than `_comes`.
    """
    risk, stands, least = 0.0, 0.0, 9.0
    weight = e.sets_off_weight / e.risk_weight if e.risk_weight > 0.0 else 0.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    movers = case.movers
    for i in range(len(movers)):
        goes = _goes(t, movers[i, 9])
        dx = movers[i, 0] + movers[i, 2] * t + movers[i, 7] * goes - pose.x
        dy = movers[i, 1] + movers[i, 3] * t + movers[i, 8] * goes - pose.y
        near = e.clearance + movers[i, 6] * t
        zone = _comes(movers[i], t, dx, dy, c, s, e) if weight > 0.0 else 0.0
        far = near + e.ahead * math.hypot(movers[i, 2], movers[i, 3])
        far = max(far, zone) + case.reach + movers[i, 4]
        if dx * dx + dy * dy < far * far:
            g = point_clearance(case.outline, c * dx + s * dy, -s * dx + c * dy) - movers[i, 4]
            least = min(least, g)
            if zone > 0.0 and g < zone:
                share = 1.0 - max(g, 0.0) / zone
                risk += weight * share * share
            if e.ahead > 0.0:  # in front of somebody it is worse than behind him
                dx += movers[i, 2] * e.ahead
                dy += movers[i, 3] * e.ahead
                g = min(
                    g,
                    point_clearance(case.outline, c * dx + s * dy, -s * dx + c * dy) - movers[i, 4],
                )
            if g < near:
                share = 1.0 - max(g, 0.0) / near
                if movers[i, 2] == 0.0 and movers[i, 3] == 0.0:
                    stands = max(stands, share * share)
                else:
                    risk += share * share
    return risk + stands, least
