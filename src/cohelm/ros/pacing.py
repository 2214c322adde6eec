"""When the next control period begins: with the controller's command, or without one in time."""

from __future__ import annotations

import math

USUAL = 0.02
"""Default control period [s]."""
LEAST, MOST = 0.008, 0.04
SPARE = 0.25
"""So much longer than the controller's own is the period that the filter counts with, as a share:
its command is waited for while it is no later, and processes that are not real-time are late by
some milliseconds now and then."""


def period(command: float) -> float:
    """The filter's control period for commands that come so often, NaN for unknown [s].

    The longest there will be. Slow controllers get several periods to a command.
    """
    if math.isnan(command):
        return USUAL * (1.0 + SPARE)
    parts = max(math.ceil(command / (1.25 * USUAL)), 1)
    return min(max(command / parts * (1.0 + SPARE), LEAST), MOST)


class Pacing:
    """Begins a period with the next command, whenever that comes, and at the latest when it is due.

    So that neither processor nor filter gets more of them than they are made for, they are twice as
    many as the longest ones at most, in the long run; one may be as short as it likes: the generic
    cell rate algorithm (ITU-T I.371), with a tolerance of one cell.
    """

    def __init__(self, length: float, now: float, every: float = math.nan) -> None:
        """length: the longest a period may be [s]. every: period of commands, NaN for unknown
        [s]."""
        self.length, self._every = length, every
        self._began = self._even = now
        self._came = math.nan
        """When the last command did [s]."""

    def earliest(self) -> float:
        """From when on a command begins the next period [s]."""
        return self._even

    def expected(self) -> float:
        """When it will, as far as is known [s]: with the next command, or when one that is on time
        would come. So what is done before leaves the spare time to be late in."""
        on_time = self._began + self.length / (1.0 + SPARE)
        next_ = self._came + self._every
        return next_ if self._began < next_ < on_time else on_time

    def latest(self) -> float:
        """When it begins without one [s]."""
        return self._began + self.length

    def begin(self, now: float, command: bool = False) -> None:
        """It begins, maybe with a command."""
        self._began = now
        if command:
            self._came = now
        self._even = max(now, self._even + 0.5 * self.length)
