"""The robot's clock beside this machine's: stamps become ages, whoever's clock is wrong.

Only what comes is known, not how long it was under way; so a difference of clocks can be told from
a delay only where it is larger than any sound one, or where messages seem to be of the future.
"""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError

AHEAD, BEHIND = 0.02, 0.15
"""Readings that are this much younger or older than now may come from a clock that is right [s]."""
MOST = 5.0
"""Clocks that differ by more are not taken into account but refused, unless allowed [s]."""
SIMULATED = 1e8
"""Stamps before this are of a simulator's clock, or of none [s]: three years after 1970."""


class Clock(NamedTuple):
    """How the robot's clock stands."""

    ahead: float = 0.0
    """Of this machine's wall clock [s]; 0 where both agree as far as can be told."""

    def age(self, stamp: float) -> float:
        """How long ago a stamp of the robot's was [s]."""
        return time.time() + self.ahead - stamp


def seconds(stamp: Any) -> float:
    """Of a `builtin_interfaces/msg/Time`."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def estimated(ages: list[float], topic: str, most: float = MOST) -> Clock:
    """The clock by which readings came so old, by this machine's wall clock [s].

    The one that was under way the shortest is taken to have come at once, if the clocks can not
    agree. Raises CohelmError where they differ by more than `most` [s].
    """
    least = min(ages, default=0.0)
    if not math.isfinite(least) or -AHEAD <= least <= BEHIND:
        return Clock()
    if abs(least) <= most:
        return Clock(-least)
    if time.time() - least < SIMULATED:
        raise CohelmError(
            f"the stamps of {topic} are a simulator's or zero, not of this time: simulated time is "
            "not supported yet; let the driver stamp with the wall clock (use_sim_time:=false)"
        )
    direction = "ahead of" if least < 0.0 else "behind"
    raise CohelmError(
        f"the stamps of {topic} are {abs(least):.1f} s {direction} this machine's clock, which is "
        f"more than {most:g} s: set both clocks (chrony, ntp), or allow it with --clock-difference"
    )
