"""What the second layer of safety did in a drive, counted."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass
class Acted:
    """How often the second layer acted in a drive."""

    periods: int = 0
    gate: int = 0
    """Periods in which the gate passed another twist than it was given."""
    monitors: int = 0
    """... in which a monitor had slowed or stopped it before."""
    stops: int = 0
    """Stops and faults that the robot latched by itself; somebody had to reset them."""
    why: str = ""
    """The first of them."""

    def share(self, periods: int) -> float:
        """Of all periods."""
        return periods / self.periods if self.periods else math.nan
