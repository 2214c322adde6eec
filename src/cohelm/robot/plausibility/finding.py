"""The result of a plausibility check, and the action that follows from it."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from cohelm.robot.sensors import of_sensor


class Action(IntEnum):
    """The action that follows, mildest first."""

    SLOW = 1
    """No part of the outline may be faster than the finding's speed."""
    HOLD = 2
    """Brake and stand while the finding lasts and a little longer; then go on."""
    FAULT = 3
    """Stop, latched."""


class Finding(NamedTuple):
    """One implausible reading."""

    action: Action
    reason: str
    """In words, for the record; names the sensor first."""
    speed: float = math.inf
    """For SLOW [m/s]."""
    sensor: str = ""
    """Name of the LiDAR, where there are several."""

    @property
    def text(self) -> str:
        """The reason, with the name of the LiDAR."""
        return of_sensor(self.sensor, self.reason)


def fault(reason: str) -> Finding:
    """Impossible with a working sensor."""
    return Finding(Action.FAULT, reason)


def hold(reason: str) -> Finding:
    """Implausible: a wrong sensor, or for a moment a robot that was pushed or carried."""
    return Finding(Action.HOLD, reason)


def slow(speed: float, reason: str) -> Finding:
    """A degraded sensor: limit the speed [m/s]."""
    return Finding(Action.SLOW, reason, speed)
