"""How fast a person may drive who sees the past: a cap on speed from delay and clearance."""

from __future__ import annotations

import math
from typing import NamedTuple

FREE = 0.12
"""Delay up to which nothing is capped [s]: a person hardly notices it."""
CRAWL = 0.1
"""The cap is never below this [m/s]: the guard holds back what touches."""


class Cap(NamedTuple):
    """A limit of speed, and why."""

    speed: float
    """[m/s]; infinite: there is none."""
    reason: str


def speed_cap(delay: float, clearance: float, deceleration: float, v_max: float) -> Cap:
    """The speed at which what the person sees now still leaves room to stop.

    delay: from the robot to the person's eyes and from the hand back to the wheels, that is a
    round trip and the age of the picture [s]; NaN or less than FREE caps nothing. clearance:
    smallest gap of the outline [m]. The robot travels v * delay unseen, then brakes:

        v delay + v^2 / (2 a) = clearance   =>   v = a (sqrt(delay^2 + 2 clearance / a) - delay)
    """
    if not delay > FREE or not math.isfinite(clearance):
        return Cap(math.inf, "")
    if math.isinf(delay):
        return Cap(CRAWL, "the delay is not known")
    room = max(clearance, 0.0)
    speed = deceleration * (math.sqrt(delay * delay + 2.0 * room / deceleration) - delay)
    speed = max(speed, CRAWL)
    if speed >= v_max:
        return Cap(math.inf, "")
    return Cap(speed, f"{delay:.2f} s of delay with {room:.1f} m clear")
