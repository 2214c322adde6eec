"""When the next control period begins: with the controller's command, or without one in time."""

from __future__ import annotations

import math

USUAL = 0.02
"""A control period, where nobody says otherwise [s]."""
LEAST, MOST = 0.008, 0.04
SPARE = 0.08
"""So much longer than the controller's own is the period that the filter counts with, as a share;
so its command is waited for, and never a whole period late for having just been missed."""
_EARLY = 2.0 * SPARE


def period(command: float) -> float:
    """The filter's control period for commands that come so often, NaN for nobody knows [s].

    The longest there will be. Slow controllers get several periods to a command.
    """
    if math.isnan(command):
        return USUAL * (1.0 + SPARE)
    parts = max(math.ceil(command / (1.25 * USUAL)), 1)
    return min(max(command / parts * (1.0 + SPARE), LEAST), MOST)


class Pacing:
    """Begins a period no earlier than a share before it is due, and at the latest when it is due.

    What a period begins early is not gained: on average there are no more than of the controller's
    own length.
    """

    def __init__(self, length: float, now: float) -> None:
        """length: the longest a period may be [s]."""
        self.length = length
        self._usual = length / (1.0 + SPARE)
        self._began = self._debt = now

    def earliest(self) -> float:
        """From when on a command begins the next period [s]."""
        return max(self._began, self._debt) + self._usual * (1.0 - _EARLY)

    def latest(self) -> float:
        """When it begins without one [s]."""
        return self._began + self.length

    def begin(self, now: float) -> None:
        """It begins."""
        self._debt = max(self._debt + self._usual, now - _EARLY * self._usual)
        self._began = now
