"""Speed cap of a remote operator, from latency and clearance."""

from __future__ import annotations

import math
from typing import NamedTuple

UNCAPPED_DELAY = 0.12
"""Delay up to which nothing is capped [s]: people hardly notice it."""
CRAWL = 0.1
"""The cap is never below this [m/s]: the guard prevents contact."""


class Cap(NamedTuple):
    """A speed limit and its reason."""

    speed: float
    """[m/s]; infinite: there is none."""
    reason: str


def speed_cap(delay: float, clearance: float, deceleration: float, v_max: float) -> Cap:
    """The speed at which what the operator sees still leaves room to stop.

    delay: round trip from the robot to the operator and back, with the picture's age [s]; NaN or
    less than UNCAPPED_DELAY caps nothing. clearance: of the outline [m]. The robot travels
    v * delay unseen, then brakes:

        v delay + v^2 / (2 a) = clearance   =>   v = a (sqrt(delay^2 + 2 clearance / a) - delay)
    """
    if not delay > UNCAPPED_DELAY or not math.isfinite(clearance):
        return Cap(math.inf, "")
    if math.isinf(delay):
        return Cap(CRAWL, "latency unknown")
    room = max(clearance, 0.0)
    speed = deceleration * (math.sqrt(delay * delay + 2.0 * room / deceleration) - delay)
    speed = max(speed, CRAWL)
    if speed >= v_max:
        return Cap(math.inf, "")
    return Cap(speed, f"{delay:.2f} s latency, {room:.1f} m clearance")
