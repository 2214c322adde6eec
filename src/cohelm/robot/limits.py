"""What the wheels can do: speed and acceleration limits, and the nearest achievable command."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit_inline
from cohelm.core.types import Twist


class Limits(NamedTuple):
    """Bounds on the body's twist and on each wheel's rim; `inf` where there is none.

        >>> import cohelm
        >>> limits = cohelm.load_robot("sally").bounds()
        >>> (limits.speed, limits.wheel_acceleration)
        (1.0, 2.0)

    What a robot's YAML file says under `limits`; `RobotModel.of` takes them as they stand here.
    """

    speed: float
    """Forward and back [m/s]."""
    acceleration: float
    """[m/s^2]"""
    yaw_rate: float
    """Either way [rad/s]."""
    yaw_acceleration: float
    """[rad/s^2]"""
    wheel_speed: float = math.inf
    """Of each wheel at its rim [m/s]."""
    wheel_acceleration: float = math.inf
    """Of each wheel at its rim [m/s^2]."""
    track: float = math.nan
    """Distance between the wheels [m]; only the limits of the wheels need it."""


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


def checked_limits(limits: Limits) -> Limits:
    """The same limits, as floats. Raises CohelmError where one can not be a robot's."""
    try:
        made = Limits._make(float(value) for value in limits)
    except (TypeError, ValueError) as error:
        raise CohelmError(f"the limits must be {len(Limits._fields)} numbers: {error}") from error
    if math.isnan(made.track) and made.wheel_speed == made.wheel_acceleration == math.inf:
        made = made._replace(track=1.0)
    if not 0.0 < made.track < math.inf:  # nor for NaN
        raise CohelmError(
            f"limits.track must be a length in metres, got {made.track:g}: measure between the "
            "middles of the driven wheels"
        )
    for name, value in made._asdict().items():
        if not value > 0.0:
            raise CohelmError(
                f"limits.{name} must be greater than 0, got {value:g}: give inf where there is none"
            )
    return made


def checked_braking(limits: Limits) -> Limits:
    """Limits with which a robot takes time to stop; a real one does. Raises CohelmError without."""
    straight = min(limits.acceleration, limits.wheel_acceleration)
    turning = min(limits.yaw_acceleration, limits.wheel_acceleration)
    if math.inf in (straight, turning):
        raise CohelmError(
            "the filter must know how hard the robot brakes: give limits.wheel_acceleration_mps2, "
            "or both acceleration_mps2 and yaw_acceleration_radps2, in the robot's description"
        )
    return limits


def unlimited(track: float) -> Limits:
    """The ideal unicycle of the paper: any command is reached at once."""
    return Limits(math.inf, math.inf, math.inf, math.inf, math.inf, math.inf, track)


_ROUNDING = 2e-15
"""Of the speeds themselves, more than the rounding in a few sums of them."""
_INSIDE = 1.0 - _ROUNDING
_NONE = 1e-300
"""An acceleration too small to change the speeds' last digit."""


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
