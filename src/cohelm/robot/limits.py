"""What the wheels can do: speed and acceleration limits, and the nearest achievable command."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_inline
from cohelm.core.types import Twist


class Limits(NamedTuple):
    """Bounds on the body's twist and on each wheel's rim; `inf` where there is none.

    speed [m/s], acceleration [m/s^2], yaw_rate [rad/s], yaw_acceleration [rad/s^2],
    wheel_speed [m/s] and wheel_acceleration [m/s^2] at the rim, track: distance between the
    wheels [m].
    """

    speed: float
    acceleration: float
    yaw_rate: float
    yaw_acceleration: float
    wheel_speed: float
    wheel_acceleration: float
    track: float


def unlimited(track: float) -> Limits:
    """The ideal unicycle of the paper: any command is reached at once."""
    return Limits(math.inf, math.inf, math.inf, math.inf, math.inf, math.inf, track)


@jit_inline
def _excess(
    v: float, omega: float, speed: float, yaw_rate: float, wheel: float, track: float
) -> float:
    """How many times over the bounds a twist is; at most 1 is inside."""
    rim = abs(v) + 0.5 * track * abs(omega)  # the faster wheel
    return max(abs(v) / speed, abs(omega) / yaw_rate, rim / wheel)


@jit_inline
def achievable(command: Twist, before: Twist, limits: Limits, dt: float) -> Twist:
    """The twist the wheels really reach one step of `dt` after `before`.

    First the command is scaled down to the speed bounds, which keeps its curvature; then the
    change from `before` is scaled down to the acceleration bounds. Both bounds are convex and
    `before` is inside them, so the result is too.
    """
    over = _excess(
        command.v, command.omega, limits.speed, limits.yaw_rate, limits.wheel_speed, limits.track
    )
    shrink = 1.0 / over if over > 1.0 else 1.0
    v, omega = command.v * shrink, command.omega * shrink
    dv, domega = v - before.v, omega - before.omega
    over = _excess(
        dv, domega, limits.acceleration * dt, limits.yaw_acceleration * dt,
        limits.wheel_acceleration * dt, limits.track,
    )  # fmt: skip
    if over <= 1.0:
        return Twist(v, omega)  # to the last bit: `before + (v - before)` would round
    return Twist(before.v + dv / over, before.omega + domega / over)
