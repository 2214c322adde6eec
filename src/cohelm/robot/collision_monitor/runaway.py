"""Motion that nobody commands: the robot moves though it has been told to stand for long enough."""

from __future__ import annotations

import math

from cohelm.core.types import Twist

MOVES = 0.05
"""The outline of a robot that stands is measured slower than this [m/s]: thirty times what a gyro
drifts and wheels jitter, half of what is too fast for a contact."""
PATIENCE = 0.25
"""So much longer than the delay and braking from full speed may a robot take to stand [s]: its
drives lag, its odometry tells late, and somebody may nudge it."""


class Runaway:
    """Since when the robot should stand."""

    def __init__(self, stopping: float) -> None:
        """stopping: delay and braking from the largest speed [s]."""
        self._takes = stopping + PATIENCE
        self._told = math.nan
        self._stood = math.nan

    def noticed(self, now: float, applied: Twist, speed: float) -> bool:
        """Whether it runs away. applied: what was sent last; speed: as measured [m/s]."""
        if applied != Twist(0.0, 0.0):
            self._told = self._stood = math.nan
            return False
        if math.isnan(self._told):
            self._told = now
        if not speed > MOVES:
            self._stood = now
        since = self._stood if self._stood > self._told else math.nan
        if math.isnan(since):  # has not stood since it was told to
            return now - self._told > self._takes
        return now - since > PATIENCE
