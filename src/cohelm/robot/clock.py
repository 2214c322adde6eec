"""Clocks of simulated and replayed robots: as fast as possible, or in real time.

This is the only place where the two differ. Such a robot advances its world to `due()` in every
call, and `wait` is the only call that lets time pass.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from cohelm.core.errors import CohelmError
from cohelm.robot.model import RobotModel


def sleep_until(until: float, now: Callable[[], float]) -> None:
    """Return when `now()` has reached `until` [s]; at once, if it has passed."""
    while (left := until - now()) > 0.0:
        time.sleep(left)


class SteppedClock:
    """A clock that only `wait` advances: two equal runs are equal to the last bit."""

    def __init__(self) -> None:
        self._now = 0.0

    def due(self) -> float:
        """The time at which the last `wait` ended."""
        return self._now

    def wait(self, until: float) -> None:
        """Advance the clock; it never goes back."""
        self._now = max(self._now, until)


class WallClock:
    """The machine's monotonic clock, from the creation of this one."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def due(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start

    def wait(self, until: float) -> None:
        """Sleep; an `until` that has passed returns at once."""
        sleep_until(until, self.due)


RobotClock = SteppedClock | WallClock
"""The clock of a simulated robot [s], from 0: `due()`, to which its world has to be advanced."""


class ClockedRobot:
    """The part of the port that all simulated and replayed robots share: model, clock, closing."""

    def __init__(self, model: RobotModel, clock: RobotClock | None) -> None:
        """clock: None is as fast as possible."""
        self._model = model
        self._clock: RobotClock = SteppedClock() if clock is None else clock
        self._closed = False

    @property
    def model(self) -> RobotModel:
        """Outline, limits, sensors."""
        return self._model

    def now(self) -> float:
        """Seconds since its time began."""
        self._open()
        return self._clock.due()

    def wait(self, until: float) -> None:
        """Let time pass; the world is only advanced when it is read."""
        self._open()
        self._clock.wait(until)

    def close(self) -> None:
        """Close it; no further call is allowed."""
        self._closed = True

    def _open(self) -> None:
        if self._closed:
            raise CohelmError("the robot is closed: make a new one")
