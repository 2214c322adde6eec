"""Checks readings: missing, stale, from the future, not a number, jumping."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.perceive.scan.odometry_buffer import fastest, jump
from cohelm.robot.contact_monitor import overdue
from cohelm.robot.model import RobotModel
from cohelm.robot.port import AHEAD, Odometry, Readings, Scan
from cohelm.robot.sensors import of_sensor

_LATE = 1.0
"""What comes so long after its stamp shows two clocks that differ, and no delay [s]."""
_LASTS = 0.5
"""A reading counts as new for so long [s]."""
_SET = "if it stays so, set both clocks (chrony, ntp) and start again"


class SensorTimeouts(NamedTuple):
    """Limits on the age of readings [s]."""

    odometry: float
    scans: tuple[float, ...]
    """Of each LiDAR, the first one first."""


def timeouts(model: RobotModel, period: float) -> SensorTimeouts:
    """By the rates of the robot's sensors: 3.5 missing readings, or a LiDAR's own time-out.
    period: of the loop [s]."""
    odometry = max(3.5 / model.odometry.rate_hz, 0.07) + period
    return SensorTimeouts(odometry, tuple(lidar.timeout + period for lidar in model.lidars))


class SensorWatchdog:
    """Checks each reading against the clock and the one before."""

    def __init__(self, model: RobotModel, timeouts: SensorTimeouts) -> None:
        self._timeouts = timeouts
        self._sensors = [lidar.name for lidar in model.lidars]
        self._contacts = model.contacts
        self._fastest = fastest(model.bounds(), model.delay_s)
        self._last: Odometry | None = None
        self._checked = [-1] * len(self._sensors)
        self._newest: dict[str, tuple[float, float]] = {}
        """Of each sensor, the stamp of its newest reading, and when it was new [s]."""
        self.measures = self.sees = False
        """Whether the newest odometry is valid, and whether the newest scans are, too."""

    def problem(self, now: float, readings: Readings) -> str:
        """What is wrong with the newest readings, as a sentence; empty: nothing."""
        problem = self._odometry(now, readings.odometry)
        self.measures, self.sees = not problem, False
        for i, name in enumerate(self._sensors):
            if problem:
                return problem
            problem_ = self._scan(now, readings.of_lidar(name) if i else readings.scan, i)
            problem = of_sensor(name, problem_) if problem_ else ""
        self.sees = not problem
        if not problem and self._contacts:
            newest = {one.sensor: one for one in readings.contacts}
            each = (overdue(one, newest.get(one.name), now) for one in self._contacts)
            problem = next((problem_ for problem_ in each if problem_), "")
        return problem

    def _odometry(self, now: float, odometry: Odometry | None) -> str:
        p = self._timeouts
        if odometry is None:
            return "there is no odometry"
        if not all(map(math.isfinite, (odometry.stamp, *odometry.pose, *odometry.twist))):
            return "the odometry is not a number"
        age = now - odometry.stamp
        problem = self._aged("the odometry", "", now, odometry.stamp, age, p.odometry)
        return problem or self._step(odometry)

    def _aged(
        self, what: str, sensor: str, now: float, stamp: float, age: float, most: float
    ) -> str:  # fmt: skip
        """What is wrong with the age of a reading [s]."""
        before, since = self._newest.get(what + sensor, (math.nan, -math.inf))
        if stamp != before:
            since = now if math.isfinite(before) else -math.inf
            self._newest[what + sensor] = stamp, since
        if age < -AHEAD:
            ahead = _duration(-age)
            return f"{what} comes {ahead} from the future: a clock jumped; {_SET}"
        if age <= most:
            return ""
        if age > _LATE and now - since < _LASTS:
            return f"{what} comes {_duration(age)} after its stamp: a clock jumped; {_SET}"
        return f"{what} is {1000.0 * age:.0f} ms old"

    def _step(self, odometry: Odometry) -> str:
        last, self._last = self._last, odometry
        if last is None or odometry is last:
            return ""
        dt = odometry.stamp - last.stamp
        if dt < 0.0:
            return f"the odometry's clock went back by {-1000.0 * dt:.0f} ms"
        by = jump(last, odometry, self._fastest)
        return f"the odometry jumped by {by}" if by else ""

    def _scan(self, now: float, scan: Scan | None, lidar: int) -> str:
        if scan is None:
            return "there is no scan"
        if not (math.isfinite(scan.stamp) and math.isfinite(scan.duration)):
            return "the scan's time is not a number"
        age = now - scan.stamp - scan.duration
        most = self._timeouts.scans[lidar]
        problem = self._aged("the scan", self._sensors[lidar], now, scan.stamp, age, most)
        if problem:
            return problem
        if scan.number != self._checked[lidar]:
            if np.isnan(scan.ranges).all():
                return "the scan is not a number"
            self._checked[lidar] = scan.number
        return ""


def _duration(seconds: float) -> str:
    """As a person reads it."""
    return f"{1000.0 * seconds:.0f} ms" if seconds < 10.0 else f"{seconds:.0f} s"
