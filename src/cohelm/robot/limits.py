"""Limits of speed and acceleration, checked."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.errors import CohelmError


class Limits(NamedTuple):
    """Bounds on the body's twist and on each wheel's rim; `inf` where there is none.

        >>> import cohelm
        >>> limits = cohelm.load_robot("sally").bounds()
        >>> (limits.speed, limits.wheel_acceleration)
        (1.0, 2.0)

    The key `limits` of a robot's YAML file; `RobotModel.of` takes this class.
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


LARGEST = Limits(
    speed=30.0, acceleration=100.0, yaw_rate=30.0, yaw_acceleration=100.0, wheel_speed=30.0,
    wheel_acceleration=100.0, track=20.0,
)._asdict()  # fmt: skip
"""Of each limit that is finite, as in a robot's YAML file."""


_UNITS = dict(
    zip(Limits._fields, ("m/s", "m/s^2", "rad/s", "rad/s^2", "m/s", "m/s^2", "m"), strict=True)
)


def checked_limits(limits: Limits) -> Limits:
    """The same limits, as floats. Raises CohelmError where one is impossible."""
    if not isinstance(limits, Limits):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise CohelmError(f"the limits must be a cohelm.Limits, got {limits!r}")
    made = limits
    for name, value in limits._asdict().items():
        try:
            if isinstance(value, (bool, str, bytes)):
                raise TypeError
            made = made._replace(**{name: float(value)})
        except (TypeError, ValueError, OverflowError) as error:
            raise CohelmError(f"limits.{name} must be a number, got {value!r}") from error
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
        if LARGEST[name] < value < math.inf:
            raise CohelmError(
                f"limits.{name} is in {_UNITS[name]} and at most {LARGEST[name]:g}, got {value:g}: "
                "convert it from the units that it is in"
            )
    return made


def checked_braking(limits: Limits) -> Limits:
    """The same limits, if they bound the deceleration. Raises CohelmError if not."""
    straight = min(limits.acceleration, limits.wheel_acceleration)
    turning = min(limits.yaw_acceleration, limits.wheel_acceleration)
    if math.inf in (straight, turning):
        raise CohelmError(
            "the filter must know how hard the robot brakes: give the limit wheel_acceleration, or "
            "both acceleration and yaw_acceleration (in YAML wheel_acceleration_mps2 and so on)"
        )
    return limits


def speeds(limits: Limits) -> tuple[float, float]:
    """Speeds of a straight [m/s] and of a turn on the spot [rad/s]; inf where there is none."""
    wheel = limits.wheel_speed
    return min(limits.speed, wheel), min(limits.yaw_rate, 2.0 * wheel / limits.track)


def ramps(limits: Limits) -> tuple[float, float]:
    """Accelerations of a straight [m/s^2] and of a turn on the spot [rad/s^2]."""
    wheel = limits.wheel_acceleration
    return min(limits.acceleration, wheel), min(limits.yaw_acceleration, 2.0 * wheel / limits.track)


def unlimited(track: float) -> Limits:
    """The ideal unicycle of the paper: any command is reached at once."""
    return Limits(math.inf, math.inf, math.inf, math.inf, math.inf, math.inf, track)


def unbraked(limits: Limits) -> Limits:
    """The limits without those of acceleration: twists within them can be held."""
    return limits._replace(
        acceleration=math.inf, yaw_acceleration=math.inf, wheel_acceleration=math.inf
    )
