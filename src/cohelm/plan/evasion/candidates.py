"""Candidate motions of two pieces, their fees, and what each costs at least."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose, Twist
from cohelm.plan.evasion.case import Case, to_go
from cohelm.plan.evasion.params import Evasion, EvasionParams
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_SPEEDS = (1.0, 0.75, 0.5, 0.25, 0.0, -0.5, -1.0)
_TURNINGS = (0.0, 0.15, -0.15, 0.35, -0.35, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0)
"""Shares of the largest speed and yaw rate that are tried."""
_TURNS = 1.0  # the first piece of a motion [s]
_STRIDE = 0.5  # with which is foretold about where a motion leads [s]
_ABOUT = 0.25  # by so much less it may then cost [m]


@jit
def candidates(was: Evasion, limits: Limits, e: EvasionParams) -> tuple[Floats, Ints]:
    """(n, 5): v and omega of the first piece and of the second, and when that begins [s]; what is
    being done already comes first. And for each the first motion that begins with the same piece.
    """
    speed, turn = min(e.speed, limits.speed), min(e.yaw_rate, limits.yaw_rate)
    motions = np.empty((len(_SPEEDS) * len(_TURNINGS) * 3 + 1, 5))
    firsts = np.zeros(len(motions), dtype=np.int64)
    n = 0
    if was.on:
        turns = max(was.turns - e.period, 0.0)
        _put(motions, n, was.v, was.omega, was.after, was.then, turns)
        n = 1
    for a in _SPEEDS:
        for b in _TURNINGS:
            v, omega, first = a * speed, b * turn, n
            for after in range(3):  # goes on, goes straight on, stops
                if (after == 1 and b == 0.0) or (after == 2 and a == 0.0):
                    continue
                v2, omega2 = (v if after < 2 else 0.0), (omega if after == 0 else 0.0)
                _put(motions, n, v, omega, v2, omega2, _TURNS)
                firsts[n] = first
                n += 1
    return motions[:n], firsts[:n]


@jit
def _put(
    motions: Floats, n: int, v: float, omega: float, after: float, then: float, turns: float
) -> None:
    motions[n, 0], motions[n, 1] = v, omega
    motions[n, 2], motions[n, 3], motions[n, 4] = after, then, turns


@jit
def twist_now(row: Floats) -> Twist:
    """What a motion asks for first."""
    return Twist(row[0], row[1]) if row[4] > 0.0 else Twist(row[2], row[3])


@jit
def fees_of(motions: Floats, keeps: bool, e: EvasionParams) -> Floats:
    """What each motion costs beside where it leads and what it risks [m]."""
    fees = np.empty(len(motions))
    for i in range(len(motions)):
        fees[i] = _fee(motions[i, 0], motions[i, 1])
    if keeps:
        fees[0] -= e.hysteresis
    return fees


@jit_inline
def _fee(v: float, omega: float) -> float:
    """Turning and backing are only for a reason [m]."""
    return 0.03 * abs(omega) + (0.1 if v < 0.0 else 0.0)


@jit
def floors_of(
    case: Case, pose: Pose, twist: Twist, motions: Floats, firsts: Ints, keeps: bool,
    limits: Limits, e: EvasionParams,
) -> Floats:  # fmt: skip
    """What each motion costs at least, if nothing is in its way [m]; that of what is being done is
    -inf, for it is looked at first."""
    floors, there = np.empty(len(motions)), (pose, twist)
    for i in range(len(motions)):
        m = motions[i]
        if firsts[i] == i:
            there = _freely(pose, twist, Twist(m[0], m[1]), m[4], limits)
        end = _freely(there[0], there[1], Twist(m[2], m[3]), e.horizon - m[4], limits)[0]
        floors[i] = to_go(case, end) - _ABOUT
    if keeps:
        floors[0] = -math.inf
    return floors


@jit
def _freely(
    pose: Pose, twist: Twist, to: Twist, lasts: float, limits: Limits
) -> tuple[Pose, Twist]:
    """About where a twist that is asked for leads."""
    while lasts > 1e-6:
        step = min(lasts, _STRIDE)
        twist = achievable(to, twist, limits, step)
        pose = arc(pose, twist, step)
        lasts -= step
    return pose, twist
