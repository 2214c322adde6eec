"""What the wheels can do in the next step, and how they brake."""

from __future__ import annotations

import math

from cohelm.core.jit import jit_no_refcount
from cohelm.core.types import Floats, Twist
from cohelm.law.guard.project import NO_OBSTACLE
from cohelm.robot.achievable import braking_time
from cohelm.robot.limits import Limits

WHEEL_ROWS = 8
"""Upper bound of the number of rows that `wheel_rows` writes."""

_INSIDE = 1.0 + 1e-12  # braking takes longer by this factor, so that rounding exceeds no limit


@jit_no_refcount
def wheel_rows(rows: Floats, before: Twist, limits: Limits, dt: float) -> int:
    """Write the bounds on the next twist as rows a_v v + a_omega omega >= b of `project`.

    Speed and acceleration of body, yaw and either wheel. Returns the number of rows; an infinite
    limit has none.
    """
    half = 0.5 * limits.track
    left, right = before.v - half * before.omega, before.v + half * before.omega
    n = _pair(rows, 0, 1.0, 0.0, before.v, limits.speed, limits.acceleration * dt)
    n = _pair(rows, n, 0.0, 1.0, before.omega, limits.yaw_rate, limits.yaw_acceleration * dt)
    n = _pair(rows, n, 1.0, -half, left, limits.wheel_speed, limits.wheel_acceleration * dt)
    return _pair(rows, n, 1.0, half, right, limits.wheel_speed, limits.wheel_acceleration * dt)


@jit_no_refcount
def _pair(rows: Floats, n: int, a: float, b: float, now: float, most: float, change: float) -> int:
    """-most <= a v + b omega <= most, and within `change` of `now`."""
    low, high = max(-most, now - change), min(most, now + change)
    if low > -math.inf:
        rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3] = a, b, low, NO_OBSTACLE
        n += 1
    if high < math.inf:
        rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3] = -a, -b, -high, NO_OBSTACLE
        n += 1
    return n


@jit_no_refcount
def brake_steps(twist: Twist, limits: Limits, dt: float) -> float:
    """Control steps of full braking at constant curvature until standstill.

    Each step reduces both wheels by the same share of `twist`, 1 / brake_steps; the last one by
    the rest. 0 without acceleration limits. After one step it is one less.
    """
    return _INSIDE * braking_time(twist, limits) / dt


@jit_no_refcount
def braked(before: Twist, limits: Limits, dt: float) -> Twist:
    """The twist after one step of full braking from `before`, at constant curvature."""
    steps = brake_steps(before, limits, dt)
    if steps > 1.0:  # never for NaN
        share = 1.0 - 1.0 / steps
        return Twist(before.v * share, before.omega * share)
    return Twist(0.0, 0.0)


@jit_no_refcount
def coasting(twist: Twist, limits: Limits, dt: float) -> float:
    """How long `twist` would have to be held to travel the braking distance from it [s].

    Sum over the braking steps of dt (1 - k / n), k = 1, 2, ... while k < n.
    """
    n = brake_steps(twist, limits, dt)
    whole = math.ceil(n) - 1.0
    return dt * whole * (1.0 - 0.5 * (whole + 1.0) / n) if whole > 0.0 else 0.0
