"""Rolls out a candidate motion as the filter will shape it, and computes its cost."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_no_refcount
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.bounds import braked
from cohelm.plan.evasion.context import EvasionContext, blocked, path_left
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.plan.evasion.risk import clearance_at, risk_at, spare_at
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_CONTACT_COST = 100.0  # of a contact, for each second that it comes before the horizon [m/s]
_DEEPENS = 10  # for so many steps an overlap is followed until it is deepest


class PredictedMotion(NamedTuple):
    """A motion as far as it has been rolled out."""

    pose: Pose
    twist: Twist
    t: float
    """Since now [s]."""
    risk: float
    """Accumulated so far [m]."""
    cost: float
    """Of the whole motion, once it has ended; -1 before [m]."""


@jit_no_refcount
def roll_out_piece(
    context: EvasionContext, motion: PredictedMotion, command: Twist, until: float, limits: Limits,
    params: EvasionParams, max_risk: float,
) -> PredictedMotion:  # fmt: skip
    """The motion continued with a commanded twist until `until`; it ends with a contact, where it
    is blocked, or where its risk exceeds `max_risk`."""
    pose, twist, t, risk = motion.pose, motion.twist, motion.t, motion.risk
    k = int(t / STEP + 0.5)
    while t < until - 0.5 * STEP:
        before, here, slack = twist, pose, 1.0
        twist = achievable(command, before, limits, STEP)
        pose = arc(here, twist, STEP)
        t, k = t + STEP, k + 1
        if t <= params.certified_for:
            slack = spare_at(
                context.ahead[k], context.movers, context.outline, context.reach, pose, twist, t,
                limits, params,
            )  # fmt: skip
            slack -= params.static_clearance
            if slack <= 0.0:  # the filter brakes here
                twist = braked(before, limits, STEP)
                pose = arc(here, twist, STEP)
        if blocked(context, pose):  # it stops before and waits there
            return PredictedMotion(
                here, twist, t, risk, waiting_cost(context, here, t - STEP, risk, params) + 0.5
            )
        risk_rate, clearance = risk_at(context, pose, k, params)
        risk += params.risk_weight * STEP * risk_rate
        if clearance <= 0.0:
            cost = _contact_cost(context, pose, twist, k, params) + 10.0 * abs(twist.v) + risk
            return PredictedMotion(pose, twist, t, risk, cost + 0.05 * path_left(context, pose))
        if t <= params.certified_for:
            required = params.slack + params.slack_growth * t
            if slack < required:
                lacking = 1.0 - max(slack, 0.0) / required
                risk += params.risk_weight * STEP * lacking * lacking
        if risk > max_risk:
            return PredictedMotion(pose, twist, t, risk, math.inf)
    return PredictedMotion(pose, twist, t, risk, -1.0)


@jit_no_refcount
def waiting_cost(
    context: EvasionContext, pose: Pose, since: float, risk: float, params: EvasionParams
) -> float:
    """The cost of standing from `since` on [m]."""
    t, k = since, int(since / STEP + 0.5)
    while t < params.horizon:
        t, k = t + STEP, k + 1
        risk_rate, clearance = risk_at(context, pose, k, params)
        risk += params.risk_weight * STEP * risk_rate
        if clearance <= 0.0:
            return _contact_cost(context, pose, Twist(0.0, 0.0), k, params) + risk
    return path_left(context, pose) + risk


@jit_no_refcount
def _contact_cost(
    context: EvasionContext, pose: Pose, twist: Twist, k: int, params: EvasionParams
) -> float:
    """The cost of a contact that begins after k steps, if the twist is held and the mover goes on
    [m]: of a graze half as much for its time as of a deep one.

    Which of two motions is touched first is often within the noise of velocities; a robot that
    goes by that alone changes its mind, and does not leave the way of a mover that would only graze
    it. How deep the overlap gets says more, and changes little from one evaluation to the next.
    """
    deepest = 0.0
    for j in range(k, min(k + _DEEPENS, len(context.ahead))):
        overlap = -clearance_at(
            context.ahead[j], context.movers, context.outline, context.reach, pose, 0.0, 0.0, 0.0,
            0.0,
        )  # fmt: skip
        if overlap < deepest:
            break
        deepest = overlap
        pose = arc(pose, twist, STEP)
    left = params.horizon - k * STEP
    share = 0.5 + 0.5 * min(deepest / params.clearance, 1.0)
    return _CONTACT_COST * (left * share + 2.0 * STEP)


@jit_no_refcount
def motion_cost(
    context: EvasionContext, motion: PredictedMotion, command: Twist, limits: Limits,
    params: EvasionParams, max_risk: float
) -> float:  # fmt: skip
    """The cost of a motion continued with a commanded twist to the horizon [m]."""
    if motion.cost >= 0.0:
        return motion.cost
    if motion.risk > max_risk:
        return math.inf
    motion = roll_out_piece(context, motion, command, params.horizon, limits, params, max_risk)
    return motion.cost if motion.cost >= 0.0 else motion.risk + path_left(context, motion.pose)
