"""How fast time passes for a robot that is not real: as fast as it can, or as on the wall.

This is the only place where the two differ, for simulators and replayed records. Such a robot
moves its world on to `due()` whenever it is asked anything, and `wait` is the only call that lets
time pass.
"""

from __future__ import annotations

import time
from typing import Protocol

from cohelm.core.errors import CohelmError
from cohelm.robot.model import RobotModel


class Pace(Protocol):
    """The clock of a simulated robot [s], from 0."""

    def due(self) -> float:
        """How far the world must have come by now."""
        ...

    def wait(self, until: float) -> None:
        """Return when `due()` has reached `until`."""
        ...


class AsFast:
    """The clock stands still but for `wait`: two equal runs are equal to the last bit."""

    def __init__(self) -> None:
        self._now = 0.0

    def due(self) -> float:
        """Where the last `wait` left it."""
        return self._now

    def wait(self, until: float) -> None:
        """Put the clock on; it never goes back."""
        self._now = max(self._now, until)


class OnTheWall:
    """The machine's monotonic clock, from when this was made."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def due(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start

    def wait(self, until: float) -> None:
        """Sleep; an `until` that has passed returns at once."""
        left = until - self.due()
        while left > 0.0:
            time.sleep(left)
            left = until - self.due()


def pace(real_time: bool) -> Pace:
    """The one or the other."""
    return OnTheWall() if real_time else AsFast()


class Paced:
    """What every robot that is not real has of the port: its model, its clock, and an end."""

    def __init__(self, model: RobotModel, pace: Pace | None) -> None:
        """pace: none is as fast as it can."""
        self._model = model
        self._pace: Pace = AsFast() if pace is None else pace
        self._closed = False

    @property
    def model(self) -> RobotModel:
        """Outline, limits, sensors."""
        return self._model

    def now(self) -> float:
        """Seconds since its time began."""
        self._open()
        return self._pace.due()

    def wait(self, until: float) -> None:
        """Let time pass; the world is only worked out when somebody looks."""
        self._open()
        self._pace.wait(until)

    def close(self) -> None:
        """Nothing may be asked of it any more."""
        self._closed = True

    def _open(self) -> None:
        if self._closed:
            raise CohelmError("the robot is closed: make a new one")
