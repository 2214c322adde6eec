"""Candidate motions of two pieces, their extra costs, and lower bounds of their costs."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline, jit_no_refcount
from cohelm.core.types import Floats, Ints, Pose, Twist
from cohelm.plan.evasion.context import EvasionContext, path_left
from cohelm.plan.evasion.params import Evasion, EvasionParams
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_SPEEDS = (1.0, 0.75, 0.5, 0.25, 0.0, -0.5, -1.0)
_TURNINGS = (0.0, 0.15, -0.15, 0.35, -0.35, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0)
"""Sampled shares of the largest speed and yaw rate."""
_FIRST_PIECE = 1.0  # duration of the first piece of a motion [s]
_STEP = 0.5  # of the coarse rollout for lower bounds [s]
_BOUND_SLACK = 0.25  # error of that rollout [m]

V, OMEGA, AFTER, THEN, TURNS = range(5)
"""Columns of motions: v and omega of the first piece and of the second [m/s, rad/s], and when that
begins [s]; named as in `Evasion`."""


@jit
def candidates(
    last: Evasion, since: float, limits: Limits, params: EvasionParams
) -> tuple[Floats, Ints]:
    """Motions (n, 5), columns from `V` on; the current one, `since` [s] after it was chosen, comes
    first. And (n,), the first motion that begins with the same piece."""
    speed, turn = min(params.speed, limits.speed), min(params.yaw_rate, limits.yaw_rate)
    motions = np.empty((len(_SPEEDS) * len(_TURNINGS) * 3 + 1, 5))
    firsts = np.zeros(len(motions), dtype=np.int64)
    n = 0
    if last.on:
        turns = max(last.turns - since, 0.0)
        _set_row(motions, n, last.v, last.omega, last.after, last.then, turns)
        n = 1
    for a in _SPEEDS:
        for b in _TURNINGS:
            v, omega, piece = a * speed, b * turn, n
            for after in range(3):  # continues, continues straight, stops
                if (after == 1 and b == 0.0) or (after == 2 and a == 0.0):
                    continue
                v2, omega2 = (v if after < 2 else 0.0), (omega if after == 0 else 0.0)
                _set_row(motions, n, v, omega, v2, omega2, _FIRST_PIECE)
                firsts[n] = piece
                n += 1
    return motions[:n], firsts[:n]


@jit_no_refcount
def _set_row(
    motions: Floats, n: int, v: float, omega: float, after: float, then: float, turns: float
) -> None:
    motions[n, V], motions[n, OMEGA] = v, omega
    motions[n, AFTER], motions[n, THEN], motions[n, TURNS] = after, then, turns


@jit_no_refcount
def first_twist(motion: Floats) -> Twist:
    """The twist that a motion begins with."""
    if motion[TURNS] > 0.0:
        return Twist(motion[V], motion[OMEGA])
    return Twist(motion[AFTER], motion[THEN])


@jit
def extra_costs(motions: Floats, keeps: bool, params: EvasionParams) -> Floats:
    """Cost of each motion beside remaining path and risk: turning, backing, hysteresis [m]."""
    costs = np.empty(len(motions))
    for i in range(len(motions)):
        costs[i] = _extra_cost(motions[i, V], motions[i, OMEGA])
    if keeps:
        costs[0] -= params.hysteresis
    return costs


@jit_inline
def _extra_cost(v: float, omega: float) -> float:
    """Turning and backing cost a little [m]."""
    return 0.03 * abs(omega) + (0.1 if v < 0.0 else 0.0)


@jit
def lower_bounds(
    context: EvasionContext, pose: Pose, twist: Twist, motions: Floats, firsts: Ints, keeps: bool,
    limits: Limits, params: EvasionParams,
) -> Floats:  # fmt: skip
    """Lower bound of each motion's cost, with nothing in its way [m]; -inf for the current motion,
    so that it is evaluated first."""
    bounds, state = np.empty(len(motions)), (pose, twist)
    for i in range(len(motions)):
        m = motions[i]
        if firsts[i] == i:
            state = _unhindered(pose, twist, Twist(m[V], m[OMEGA]), m[TURNS], limits)
        second, left = Twist(m[AFTER], m[THEN]), params.horizon - m[TURNS]
        end, _ = _unhindered(state[0], state[1], second, left, limits)
        bounds[i] = path_left(context, end) - _BOUND_SLACK
    if keeps:
        bounds[0] = -math.inf
    return bounds


@jit_no_refcount
def _unhindered(
    pose: Pose, twist: Twist, command: Twist, duration: float, limits: Limits
) -> tuple[Pose, Twist]:
    """Approximately where a commanded twist leads within `duration`, without obstacles."""
    while duration > 1e-6:
        if twist == command:
            return arc(pose, twist, duration), twist
        step = min(duration, _STEP)
        twist = achievable(command, twist, limits, step)
        pose = arc(pose, twist, step)
        duration -= step
    return pose, twist
