"""When the next control period begins: with the controller's command, or without one in time."""

from __future__ import annotations

import math

USUAL = 0.02
"""A control period, where nobody says otherwise [s]."""
LEAST, MOST = 0.008, 0.04
SPARE = 0.08
"""So much longer than the controller's own is the period that the filter counts with, as a share;
so its command is waited for, and never a whole period late for having just been missed."""
EARLY = 0.08
"""So much earlier than after the controller's own period a command may begin one, as a share: by
so much periods move towards the commands until they begin with them."""
LONGEST = (1.0 + SPARE) / (1.0 - EARLY)
"""The longest period in the shortest ones: a delay may span so many more than it seems."""


def period(command: float) -> float:
    """The filter's control period for commands that come so often, NaN for nobody knows [s].

    The longest there will be. Slow controllers get several periods to a command.
    """
    if math.isnan(command):
        return USUAL * (1.0 + SPARE)
    parts = max(math.ceil(command / (1.25 * USUAL)), 1)
    return min(max(command / parts * (1.0 + SPARE), LEAST), MOST)


class Pacing:
    """Begins a period with the next command, but no earlier than a share before it is due, and at
    the latest when it is due."""

    def __init__(self, length: float, now: float) -> None:
        """length: the longest a period may be [s]."""
        self.length = length
        self._began = now

    def earliest(self) -> float:
        """From when on a command begins the next period [s]."""
        return self._began + self.length / LONGEST

    def latest(self) -> float:
        """When it begins without one [s]."""
        return self._began + self.length

    def begin(self, now: float) -> None:
        """It begins."""
        self._began = now
