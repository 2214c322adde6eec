"""What a check has found, and what follows from it."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from cohelm.robot.sensors import of_sensor


class Action(IntEnum):
    """What follows, mildest first."""

    SLOW = 1
    """No part of the outline may be faster than the finding's speed."""
    HOLD = 2
    """Brake and stand, while it is so and a little longer; then go on."""
    FAULT = 3
    """Latched."""


class Finding(NamedTuple):
    """One thing that can not be."""

    action: Action
    reason: str
    """In words, for the record; begins with which sense it is about."""
    speed: float = math.inf
    """For SLOW [m/s]."""
    sensor: str = ""
    """Which of several LiDARs it is about."""

    @property
    def said(self) -> str:
        """The reason, with the LiDAR that it is about."""
        return of_sensor(self.sensor, self.reason)


def fault(reason: str) -> Finding:
    """Broken: this can not be true of a working sensor."""
    return Finding(Action.FAULT, reason)


def hold(reason: str) -> Finding:
    """Odd: true of a sensor that lies, and for a moment of a robot that was pushed or carried."""
    return Finding(Action.HOLD, reason)


def slow(speed: float, reason: str) -> Finding:
    """Worse than it should be."""
    return Finding(Action.SLOW, reason, speed)
