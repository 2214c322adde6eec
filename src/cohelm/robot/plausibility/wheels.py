"""Odometry against itself and against what the wheels were told."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats, Twist
from cohelm.robot.model import RobotModel
from cohelm.robot.plausibility.finding import Finding, fault, hold
from cohelm.robot.plausibility.trail import Trail


class Tolerance(NamedTuple):
    """How far apart they may be."""

    step: float = 0.03
    """Pose and twist over one reading [m, rad]: a filter's small correction."""
    drift: float = 0.05
    """Pose and twist over each of `windows` [m, rad]; a filtered twist lags by some 0.1 s."""
    share: float = 0.25
    """... and this of the way more: a twist is an average, or an instant."""
    windows: tuple[float, ...] = (0.5, 2.0)
    """Soon, and for what is slow [s]."""
    lag: float = 0.3
    """Drives may follow a command by so much later than the robot's `delay_s` [s]: on a slope, with
    a load, by a controller of their own."""
    speed: float = 0.12
    """Measured and commanded speed [m/s]; a wheel that spins or is held back shows more."""
    yaw_rate: float = 0.25
    """[rad/s]"""
    ratio: float = 0.15
    """... and this of the command more."""
    patience: float = 0.15
    """For so long they have to be apart [s]."""


TOLERANCE = Tolerance()


def consistent(trail: Trail, t: Tolerance = TOLERANCE) -> Finding | None:
    """Pose against twist: the way between two poses is what the speeds between them add up to."""
    rows = trail.rows
    if len(rows) < 2:
        return None
    last, before = rows[-1], rows[-2]
    dt = float(last[0] - before[0])
    steps = (math.hypot(last[1] - before[1], last[2] - before[2]), abs(last[3] - before[3]))
    told = (abs(last[4]) * dt, abs(last[5]) * dt)
    told_before = (abs(before[4]) * dt, abs(before[5]) * dt)
    for step, a, b, unit in zip(steps, told, told_before, ("m", "rad"), strict=True):
        if step > (1.0 + t.share) * max(a, b) + t.step:
            return fault(f"the odometry jumped by {step:.2f} {unit} against its speed")
    for window in t.windows:
        since = trail.since(trail.newest - window)
        gone, turned = _gone(since)
        for what, went, column in (("speed", gone, 4), ("yaw rate", turned, 5)):
            low, high = _added_up(since, column)
            room = t.drift + t.share * max(abs(low), abs(high), abs(went))
            if not low - room <= went <= high + room:
                said = f"{went:.2f} against {0.5 * (low + high):.2f} in {window} s"
                return fault(f"the odometry's pose and {what} disagree: {said}")
    return None


def _added_up(rows: Floats, column: int) -> tuple[float, float]:
    """What a speed adds up to, whether it is of the instant, or the mean since the last one."""
    dt = np.diff(rows[:, 0])
    sums = (float(rows[1:, column] @ dt), float(rows[:-1, column] @ dt))
    return min(sums), max(sums)


def _gone(rows: Floats) -> tuple[float, float]:
    """Along the headings it had, and round [m, rad]."""
    middle = 0.5 * (rows[1:, 3] + rows[:-1, 3])
    dx, dy = np.diff(rows[:, 1]), np.diff(rows[:, 2])
    along = np.cos(middle) * dx + np.sin(middle) * dy
    return float(along.sum()), float(rows[-1, 3] - rows[0, 3])


class Following:
    """Whether the wheels do what they are told, later and not quite: measured twist against the
    range of what was commanded over the time in which a command may take effect."""

    def __init__(self, model: RobotModel, tolerance: Tolerance = TOLERANCE) -> None:
        self._t, self._late = tolerance, model.delay_s + tolerance.lag
        self._apart = math.nan

    def watch(self, now: float, twist: Twist, commands: Trail) -> Finding | None:
        """A finding when they have been apart for long enough."""
        rows = commands.since(now - self._late)
        if not len(rows) or now - commands.rows[0, 0] < self._late:
            self._apart = math.nan
            return None
        why = self._wrong(twist, rows)
        if not why:
            self._apart = math.nan
            return None
        if math.isnan(self._apart):
            self._apart = now
        if now - self._apart < self._t.patience:
            return None
        driven = bool((np.abs(rows[:, 1:3]).max(axis=1) > 0.02).all())
        return fault(why) if driven else hold(why)

    def _wrong(self, twist: Twist, rows: Floats) -> str:
        t = self._t
        if _outside(twist.v, rows[:, 1], t.speed, t.ratio):
            told = float(rows[:, 1].mean())
            return f"the odometry says {twist.v:.2f} m/s where {told:.2f} m/s is commanded"
        if _outside(twist.omega, rows[:, 2], t.yaw_rate, t.ratio):
            told = float(rows[:, 2].mean())
            return f"the odometry says {twist.omega:.2f} rad/s where {told:.2f} rad/s is commanded"
        return ""


def _outside(measured: float, told: Floats, room: float, ratio: float) -> bool:
    """Beyond all that was told in that time."""
    low, high = float(told.min()), float(told.max())
    slack = room + ratio * max(abs(low), abs(high))
    return not low - slack <= measured <= high + slack
