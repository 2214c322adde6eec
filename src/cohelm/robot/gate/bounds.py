"""Limits of speed and acceleration, of the body and of each wheel."""

from __future__ import annotations

from typing import NamedTuple

from cohelm.core.types import Twist


class Bounds(NamedTuple):
    """All above 0, infinite where there is none.

    speed [m/s], acceleration [m/s^2], yaw_rate [rad/s], yaw_acceleration [rad/s^2], wheel_speed
    [m/s] and wheel_acceleration [m/s^2] at the rim, track: distance between the wheels [m].
    """

    speed: float
    acceleration: float
    yaw_rate: float
    yaw_acceleration: float
    wheel_speed: float
    wheel_acceleration: float
    track: float


def _share(value: float, limit: float) -> float:
    return limit / abs(value) if abs(value) > limit else 1.0


def within_speeds(twist: Twist, bounds: Bounds) -> Twist:
    """The twist, scaled down to the speed limits if it exceeds them; its curvature stays."""
    left, right = _rims(twist, bounds)
    share = min(
        _share(twist.v, bounds.speed),
        _share(twist.omega, bounds.yaw_rate),
        _share(left, bounds.wheel_speed),
        _share(right, bounds.wheel_speed),
    )
    return Twist(share * twist.v, share * twist.omega)


def change_time(change: Twist, bounds: Bounds) -> float:
    """The least time that a change of the twist takes [s]."""
    left, right = _rims(change, bounds)
    return max(
        abs(change.v) / bounds.acceleration,
        abs(change.omega) / bounds.yaw_acceleration,
        abs(left) / bounds.wheel_acceleration,
        abs(right) / bounds.wheel_acceleration,
    )


def towards(before: Twist, goal: Twist, bounds: Bounds, time: float) -> tuple[Twist, float]:
    """As far from `before` towards `goal` as the accelerations allow in `time` [s].

    Returns the twist reached, and the time used for it [s].
    """
    change = Twist(goal.v - before.v, goal.omega - before.omega)
    takes, time = change_time(change, bounds), max(time, 0.0)
    if takes <= time:
        return goal, takes
    share = time / takes
    return Twist(before.v + share * change.v, before.omega + share * change.omega), time


def _rims(twist: Twist, bounds: Bounds) -> tuple[float, float]:
    half = 0.5 * bounds.track * twist.omega
    return twist.v - half, twist.v + half
