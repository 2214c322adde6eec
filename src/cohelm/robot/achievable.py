"""What the wheels make of a command: the nearest twist within the limits, and the time to brake."""

from __future__ import annotations

import math

from cohelm.core.jit import jit_inline
from cohelm.core.types import Twist
from cohelm.robot.limits import Limits, speeds

_ROUNDING = 2e-15
"""Of the speeds themselves, more than the rounding in a few sums of them."""
_INSIDE = 1.0 - _ROUNDING
_NONE = 1e-300
"""An acceleration too small to change the speeds' last digit."""


@jit_inline
def braking_time(twist: Twist, limits: Limits) -> float:
    """How long it takes to stand still, braking on constant curvature [s]; 0 without acceleration
    limits."""
    rim = abs(twist.v) + 0.5 * limits.track * abs(twist.omega)
    return max(
        abs(twist.v) / limits.acceleration,
        abs(twist.omega) / limits.yaw_acceleration,
        rim / limits.wheel_acceleration,
    )


def stopping_distance(limits: Limits, reaction: float) -> float:
    """How far the robot drives at most until it stands [m]: for a reaction time [s] at full speed,
    and braking while it turns as fast as it can; inf without a limit of speed."""
    top = Twist(*speeds(limits))
    if not math.isfinite(top.v + top.omega):
        return math.inf
    return top.v * (reaction + 0.5 * braking_time(top, limits))


@jit_inline
def _excess(
    v: float, omega: float, speed: float, yaw_rate: float, wheel: float, track: float
) -> float:
    """How many times over the bounds a twist is; 1 inside them."""
    rim = abs(v) + 0.5 * track * abs(omega)  # the faster wheel
    if abs(v) <= speed and abs(omega) <= yaw_rate and rim <= wheel:
        return 1.0  # most of the time, and spares three divisions
    return max(abs(v) / speed, abs(omega) / yaw_rate, rim / wheel)


@jit_inline
def _grain(v: float, omega: float, before: Twist, track: float) -> float:
    """A difference of speeds is as fine as the speeds are [m/s at the rim]."""
    grain = _ROUNDING * max(abs(v), abs(before.v))
    return grain + 0.5 * track * (_ROUNDING * max(abs(omega), abs(before.omega)))


@jit_inline
def achievable(command: Twist, before: Twist, limits: Limits, dt: float) -> Twist:
    """The twist the wheels really reach one step of `dt` after `before`.

    First the command is scaled down to the speed bounds, which keeps its curvature; then the
    change from `before` is scaled down to the acceleration bounds. Both bounds are convex and
    `before` is inside them, so the result is too; and it stays far enough inside that no bound
    is passed by rounding, whichever way the wheels' speeds are worked out from it.
    """
    speed, yaw_rate, wheel, track = (
        limits.speed, limits.yaw_rate, limits.wheel_speed, limits.track,
    )  # fmt: skip
    over = _excess(command.v, command.omega, speed, yaw_rate, wheel, track)
    shrink = _INSIDE / over if over > 1.0 else 1.0
    v, omega = command.v * shrink, command.omega * shrink
    dv, domega = v - before.v, omega - before.omega
    grain = _grain(v, omega, before, track)
    over = _excess(
        dv, domega, limits.acceleration * dt, limits.yaw_acceleration * dt,
        max(limits.wheel_acceleration * dt - grain, _NONE), track,
    )  # fmt: skip
    if over <= 1.0:
        return Twist(v, omega)  # to the last bit: `before + (v - before)` would round
    over = _excess(
        dv, domega,
        max(limits.acceleration * dt - 4.0 * grain, _NONE),
        max(limits.yaw_acceleration * dt - 8.0 * grain / track, _NONE),
        max(limits.wheel_acceleration * dt - 4.0 * grain, _NONE), track,
    )  # fmt: skip
    v, omega = before.v + dv / over, before.omega + domega / over
    if _excess(v, omega, speed, yaw_rate, wheel, track) > 1.0:
        return Twist(v * _INSIDE, omega * _INSIDE)
    return Twist(v, omega)
