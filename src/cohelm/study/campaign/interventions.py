"""Counts what the second layer of safety did in a drive."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass
class Interventions:
    """How often the second layer acted in a drive."""

    periods: int = 0
    gate: int = 0
    """Periods in which the gate passed another twist than it was given."""
    monitors: int = 0
    """... in which a monitor had slowed or stopped it before."""
    stops: int = 0
    """Stops and faults that the robot latched by itself; each had to be reset."""
    why: str = ""
    """The first of them."""

    @property
    def gate_share(self) -> float:
        """Of all periods; NaN where there was no gate."""
        return self.gate / self.periods if self.periods else math.nan

    @property
    def monitor_share(self) -> float:
        """Of all periods; NaN where there was no monitor."""
        return self.monitors / self.periods if self.periods else math.nan
