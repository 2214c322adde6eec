"""Clearance to predicted movers, the filter's slack, and the risk beside them."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.guard.bounds import brake_steps, coasting
from cohelm.law.guard.contact import point_clearance
from cohelm.law.guard.surroundings import position_bound
from cohelm.plan.evasion.context import EvasionContext
from cohelm.plan.evasion.movers import (
    AX,
    AY,
    GROWTH,
    LEAVING,
    M_RADIUS,
    MAX_ACCELERATION,
    MVX,
    MVY,
    MX,
    MY,
    TOP_SPEED,
    TURNING,
    VELOCITY_ERROR,
)
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_ROUNDING = 1e-9  # bound of rounding errors [m]
_TWO_OVER_PI = 2.0 / math.pi

PX, PY, PVX, PVY, STOPS, NEAR, FAR = range(7)
"""Columns of predicted movers: position [m], velocity [m/s], time to stop with its max_acceleration
[s], clearance below which it causes risk [m], and distance from the robot's origin beyond which it
causes none [m]."""


@jit
def trajectories(movers: Floats, reach: float, params: EvasionParams) -> Floats:
    """(k, m, 7), columns from `PX` on: the movers after 0, 1, ... steps, past the horizon. movers:
    (m, 13), columns from `movers.MX` on."""
    n = int(params.horizon / STEP) + 3
    ahead = np.empty((n, len(movers), FAR + 1))
    t = 0.0
    for k in range(n):
        for i in range(len(movers)):
            m, prediction = movers[i], ahead[k, i]
            vx, vy, ax, ay = m[MVX], m[MVY], m[AX], m[AY]
            until = min(t, m[TURNING])
            acceleration_time = until * (t - 0.5 * until)
            prediction[PX] = m[MX] + vx * t + ax * acceleration_time
            prediction[PY] = m[MY] + vy * t + ay * acceleration_time
            prediction[PVX], prediction[PVY] = vx + ax * until, vy + ay * until
            may_set_off = m[MAX_ACCELERATION] > 0.0 and m[TOP_SPEED] > 0.0
            may_set_off = may_set_off and params.sets_off_weight > 0.0 < params.risk_weight
            prediction[STOPS] = (
                math.hypot(prediction[PVX], prediction[PVY])
                / min(m[MAX_ACCELERATION], params.sets_off_acceleration)
                if may_set_off
                else math.inf
            )
            prediction[NEAR] = params.clearance + m[GROWTH] * t
            far = prediction[NEAR] + params.ahead * math.hypot(vx, vy)
            far = max(far, _reachable_distance(m, prediction[STOPS], 1.0, params))
            prediction[FAR] = far + reach + m[M_RADIUS] + _ROUNDING
        t += STEP
    return ahead


@jit_inline
def clearance_at(
    movers_then: Floats, movers: Floats, outline: Floats, reach: float, pose: Pose, t: float,
    cap: float, growth: float, since: float,
) -> float:  # fmt: skip
    """Smallest clearance of the outline to the predicted movers after t, at most `cap` [m].

    movers_then: predicted to `since` [s] before t; from there on with constant velocity, grown by
    velocity_error and max_acceleration. growth: share of the position uncertainty added.
    """
    smallest = cap
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(movers_then)):
        dx = movers_then[i, PX] + movers_then[i, PVX] * since - pose.x
        dy = movers_then[i, PY] + movers_then[i, PVY] * since - pose.y
        r = movers[i, M_RADIUS]
        r += position_bound(movers[i, VELOCITY_ERROR], movers[i, MAX_ACCELERATION], since)
        r += growth * movers[i, GROWTH] * t
        far = smallest + reach + r
        if dx * dx + dy * dy < far * far:
            smallest = min(
                smallest, point_clearance(outline, c * dx + s * dy, -s * dx + c * dy) - r
            )
    return smallest


@jit_inline
def spare_at(
    movers_then: Floats, movers: Floats, outline: Floats, reach: float, pose: Pose, twist: Twist,
    t: float, limits: Limits, params: EvasionParams,
) -> float:  # fmt: skip
    """Clearance left to the movers after a stop from there, by the filter's assumptions [m]."""
    braking_time = brake_steps(twist, limits, STEP) * STEP
    there = arc(pose, twist, coasting(twist, limits, STEP))
    growth = params.certified_growth
    return clearance_at(
        movers_then, movers, outline, reach, there, t + braking_time, 1.0, growth, braking_time
    )


@jit_inline
def _reachable_distance(mover: Floats, stops: float, turns: float, params: EvasionParams) -> float:
    """Distance that a mover could cover, if it turned on the robot, before the robot is away [m].

    stops: time until the mover has stopped first [s]. The robot leaves forward or backward, after
    turning by up to a radian from a mover ahead or behind. The mover's speed is bounded by
    TOP_SPEED; one that is not known to walk covers nothing.
    """
    time_left = mover[LEAVING] + turns / params.yaw_rate - stops
    if not time_left > 0.0:
        return 0.0
    max_acceleration = min(mover[MAX_ACCELERATION], params.sets_off_acceleration)
    top_speed = min(mover[TOP_SPEED], max_acceleration * time_left)
    return top_speed * time_left - 0.5 * top_speed * top_speed / max_acceleration


@jit_inline
def risk_at(
    context: EvasionContext, pose: Pose, k: int, params: EvasionParams
) -> tuple[float, float]:
    """Risk rate of being there after k steps, and the smallest clearance to the movers.

    Each mover adds (1 - clearance / d)^2 below d, `params.clearance` plus the position uncertainty
    by then; of standing ones only the nearest, as they may be points of one object. A known walker
    adds risk where it is nearer than `_reachable_distance`, in proportion to the angle that the
    robot fills as seen from it: it may set off in any direction.
    """
    risk, static_risk, smallest = 0.0, 0.0, 9.0
    weight = params.sets_off_weight / params.risk_weight if params.risk_weight > 0.0 else 0.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    # each view of an array counts references, so none is made in the loop
    ahead, movers, outline, reach = context.ahead, context.movers, context.outline, context.reach
    for i in range(len(movers)):
        dx, dy = ahead[k, i, PX] - pose.x, ahead[k, i, PY] - pose.y
        if not dx * dx + dy * dy < ahead[k, i, FAR] * ahead[k, i, FAR]:  # nor for NaN
            continue
        near, r = ahead[k, i, NEAR], movers[i, M_RADIUS]
        vx, vy = movers[i, MVX], movers[i, MVY]
        clearance = point_clearance(outline, c * dx + s * dy, -s * dx + c * dy) - r
        smallest = min(smallest, clearance)
        away = max(math.hypot(dx, dy), 1e-9)
        beside = abs(c * dy - s * dx) / away
        reachable = _reachable_distance(movers[i], ahead[k, i, STOPS], 1.0 - beside, params)
        if reachable > 0.0 and clearance < reachable:
            share = 1.0 - max(clearance, 0.0) / reachable
            width = min((reach + r) / away, 1.0)
            risk += weight * share * share * math.asin(width) * _TWO_OVER_PI
        if params.ahead > 0.0:  # in front of a mover it is worse than behind it
            dx += vx * params.ahead
            dy += vy * params.ahead
            far = near + reach + r
            if dx * dx + dy * dy < far * far:
                clearance = min(
                    clearance, point_clearance(outline, c * dx + s * dy, -s * dx + c * dy) - r
                )
        if clearance < near:
            share = 1.0 - max(clearance, 0.0) / near
            if vx == 0.0 and vy == 0.0:
                static_risk = max(static_risk, share * share)
            else:
                risk += share * share
    return risk + static_risk, smallest
