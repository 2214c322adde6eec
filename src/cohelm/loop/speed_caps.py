"""Speed caps: for a driver with latency, over ground that nobody has seen, for a lost robot."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import Twist
from cohelm.pilot.step import Settings
from cohelm.robot.limits import Limits

UNCAPPED_DELAY = 0.12
"""Delay up to which nothing is capped [s]: people hardly notice it."""
CRAWL = 0.1
"""The cap is never below this [m/s]: the guard prevents contact."""


class Cap(NamedTuple):
    """A speed limit and its reason."""

    speed: float
    """[m/s]; infinite: there is none."""
    reason: str


NO_CAP = Cap(math.inf, "")
"""No cap."""


def speed_cap(delay: float, clearance: float, deceleration: float, v_max: float) -> Cap:
    """The speed at which what the operator sees still leaves room to stop.

    delay: round trip from the robot to the operator and back, with the picture's age [s]; NaN or
    less than UNCAPPED_DELAY caps nothing. clearance: of the outline [m].
    """
    if not delay > UNCAPPED_DELAY or not math.isfinite(clearance):
        return NO_CAP
    if math.isinf(delay):
        return Cap(CRAWL, "latency unknown")
    room = max(clearance, 0.0)
    speed = max(_stops_within(room, delay, deceleration), CRAWL)
    if speed >= v_max:
        return NO_CAP
    return Cap(speed, f"{delay:.2f} s latency, {room:.1f} m clearance")


MAX_UNSEEN_SPEED = 0.3
"""A robot backs no faster over ground that nobody has seen since it was switched on [m/s]."""
UNSEEN = "backing over ground never seen"
MAX_LOST_SPEED = 0.2
"""A robot that has lost its pose is never driven faster [m/s]."""
_MIN_LOST_SPEED = 0.05  # nor slowed below this: it can leave what it stands against [m/s]
_DECELERATION = 1.0  # of a robot that has no limit [m/s^2]


def latency_cap(delay: float, clearance: float, settings: Settings) -> Cap:
    """The speed cap by the operator's delay [s]. clearance: to the nearest obstacle [m]."""
    return speed_cap(delay, clearance, _braking(settings.limits), settings.gains.u_d)


def unseen_cap(gap: float, settings: Settings) -> Cap:
    """The speed cap of a robot that backs. gap: to ground that is only assumed free [m]."""
    speed = unseen_speed(gap, settings.limits)
    return Cap(speed, UNSEEN) if speed < settings.gains.u_d else NO_CAP


def unseen_speed(gap: float, limits: Limits) -> float:
    """The speed from which a robot, once it gets to ground that is only assumed free, has come down
    to MAX_UNSEEN_SPEED [m/s]. gap: to that [m]."""
    return math.sqrt(MAX_UNSEEN_SPEED**2 + 2.0 * _braking(limits) * max(gap, 0.0))


def backed_slowly(twist: Twist, gap: float, limits: Limits) -> Twist:
    """A twist on the same arc that backs no faster than that."""
    speed = unseen_speed(gap, limits)
    if not twist.v < -speed:
        return twist
    return Twist(-speed, twist.omega * speed / -twist.v)


def lost_cap(clearance: float, delay: float, settings: Settings) -> Cap:
    """The speed cap of a robot that has lost its pose, and has only its scan.

    It stops within half the clearance [m], its own delay [s] included, and is never faster than
    MAX_LOST_SPEED.
    """
    speed = _stops_within(0.5 * max(clearance, 0.0), delay, _braking(settings.limits))
    speed = min(max(speed, _MIN_LOST_SPEED), MAX_LOST_SPEED)
    seen = f"{clearance:.1f} m clearance" if math.isfinite(clearance) else "nothing in sight"
    return Cap(speed, f"lost, with {seen}")


def _stops_within(room: float, delay: float, a: float) -> float:
    """The speed of a robot that travels on for the delay [s], then brakes with a [m/s^2], and stops
    within the room [m]:

        v delay + v^2 / (2 a) = room   =>   v = a (sqrt(delay^2 + 2 room / a) - delay)
    """
    return a * (math.sqrt(delay * delay + 2.0 * room / a) - delay)


def _braking(limits: Limits) -> float:
    braking = min(limits.acceleration, limits.wheel_acceleration)
    return braking if math.isfinite(braking) and braking > 0.0 else _DECELERATION
