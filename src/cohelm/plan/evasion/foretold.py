"""Foretells a motion step by step, as the filter will let it be, and what it costs."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.bounds import braked
from cohelm.plan.evasion.case import Case, blocked, to_go
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.plan.evasion.risk import risk_at, spare_at
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_TOUCH = 100.0  # cost of a touch for each second that it comes before the horizon [m/s]


class Foretold(NamedTuple):
    """A motion as far as it is foretold."""

    pose: Pose
    twist: Twist
    t: float
    """Since now [s]."""
    risk: float
    """So far [m]."""
    cost: float
    """Of the whole, once it has ended; before, -1 [m]."""


@jit
def leg(
    case: Case, way: Foretold, to: Twist, until: float, limits: Limits, e: EvasionParams,
    most: float,
) -> Foretold:  # fmt: skip
    """The motion with a twist asked for until then; it ends with a touch, or where it can not go
    on. What risks more than `most` ends too."""
    pose, twist, t, risk = way.pose, way.twist, way.t, way.risk
    k = int(t / STEP + 0.5)
    while t < until - 0.5 * STEP:
        before, here, spare = twist, pose, 1.0
        twist = achievable(to, before, limits, STEP)
        pose = arc(here, twist, STEP)
        t, k = t + STEP, k + 1
        if t <= e.certified_for:
            spare = spare_at(
                case.ahead[k], case.movers, case.outline, case.reach, pose, twist, t, limits, e
            )
            spare -= e.static_clearance
            if spare <= 0.0:  # the filter brakes, for now
                twist = braked(before, limits, STEP)
                pose = arc(here, twist, STEP)
        if blocked(case, pose):  # it stops before, and is stood there when others come
            return Foretold(here, twist, t, risk, waiting(case, here, t - STEP, risk, e) + 0.5)
        uneasy, g = risk_at(case, pose, k, e)
        risk += e.risk_weight * STEP * uneasy
        if g <= 0.0:
            cost = _TOUCH * (e.horizon - t + 2.0 * STEP) + 10.0 * abs(twist.v) + risk
            return Foretold(pose, twist, t, risk, cost + 0.05 * to_go(case, pose))
        if t <= e.certified_for:
            least = e.slack + e.slack_growth * t
            if spare < least:
                short = 1.0 - max(spare, 0.0) / least
                risk += e.risk_weight * STEP * short * short
        if risk > most:
            return Foretold(pose, twist, t, risk, math.inf)
    return Foretold(pose, twist, t, risk, -1.0)


@jit
def waiting(case: Case, pose: Pose, since: float, risk: float, e: EvasionParams) -> float:
    """The cost of standing from then on."""
    t, k = since, int(since / STEP + 0.5)
    while t < e.horizon:
        t, k = t + STEP, k + 1
        uneasy, g = risk_at(case, pose, k, e)
        risk += e.risk_weight * STEP * uneasy
        if g <= 0.0:
            return _TOUCH * (e.horizon - t + 2.0 * STEP) + risk
    return to_go(case, pose) + risk


@jit
def whole(
    case: Case, way: Foretold, to: Twist, limits: Limits, e: EvasionParams, most: float
) -> float:  # fmt: skip
    """The cost of a motion that goes on with a twist to the horizon."""
    if way.cost >= 0.0:
        return way.cost
    if way.risk > most:
        return math.inf
    way = leg(case, way, to, e.horizon, limits, e, most)
    return way.cost if way.cost >= 0.0 else way.risk + to_go(case, way.pose)
