"""Detects uncommanded motion: the robot moves although it was commanded to stand for some time."""

from __future__ import annotations

import math

from cohelm.core.types import Twist

MOVES = 0.05
"""Largest measured speed of the outline of a robot that stands [m/s]: thirty times a gyro's drift
and the wheels' jitter, half of the speed that is too fast for a contact."""
PATIENCE = 0.25
"""Time to stand allowed beyond the delay and braking from full speed [s]: drives and odometry lag,
and a person may nudge the robot."""


class Runaway:
    """Watches a robot that is commanded to stand."""

    def __init__(self, delay: float, braking: float) -> None:
        """delay: from a command to the wheels [s]. braking: from the largest speed [s]."""
        self._delay, self._allowed = delay, delay + braking + PATIENCE
        self.forget()

    def forget(self) -> None:
        """As if nothing had been commanded yet."""
        self._stopped = self._stood = math.nan

    def noticed(self, now: float, applied: Twist, speed: float) -> bool:
        """Whether it moves uncommanded. applied: the last twist sent; speed: as measured, NaN if it
        was not of late [m/s]."""
        if applied != Twist(0.0, 0.0):
            self.forget()
            return False
        if math.isnan(self._stopped):
            self._stopped = now
        if math.isnan(speed):
            return False
        if not speed > MOVES and now - self._stopped >= self._delay:
            self._stood = now  # before that, earlier commands are still under way
        since = self._stood if self._stood > self._stopped else math.nan
        if math.isnan(since):  # has not stood since it was commanded to
            return now - self._stopped > self._allowed
        return now - since > PATIENCE
