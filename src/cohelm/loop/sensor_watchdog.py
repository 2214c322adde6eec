"""Checks readings: missing, stale, from the future, not a number, jumping."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.robot.contact_monitor import overdue
from cohelm.robot.model import RobotModel
from cohelm.robot.port import AHEAD, Odometry, Readings, Scan
from cohelm.robot.sensors import of_sensor


class SensorTimeouts(NamedTuple):
    """Limits on the age [s] and the plausibility of readings."""

    odometry: float
    scans: tuple[float, ...]
    """Of each LiDAR, the first one first."""
    max_ahead: float = AHEAD
    """Maximum stamp ahead of now [s]; beyond it, a clock has jumped."""
    max_jump: float = 0.15
    """Tolerance of an odometry step beyond what the robot's speed explains [m, rad]."""


def timeouts(model: RobotModel, period: float) -> SensorTimeouts:
    """By the rates of the robot's sensors: 3.5 missing readings, or a LiDAR's own time-out.
    period: of the loop [s]."""
    scans = (
        lidar.timeout_s or 3.5 / lidar.rate_hz + lidar.sweep_s + lidar.latency_s
        for lidar in model.lidars
    )
    odometry = max(3.5 / model.odometry.rate_hz, 0.07) + period
    return SensorTimeouts(odometry, tuple(scan + period for scan in scans))


class SensorWatchdog:
    """Checks each reading against the clock and the one before."""

    def __init__(self, model: RobotModel, timeouts: SensorTimeouts) -> None:
        self._timeouts = timeouts
        self._sensors = [lidar.name for lidar in model.lidars]
        self._contacts = model.contacts
        limits = model.bounds()
        self._fastest = min(limits.speed, limits.wheel_speed, 50.0)
        self._turns = min(limits.yaw_rate, 2.0 * limits.wheel_speed / limits.track, 50.0)
        self._last: Odometry | None = None
        self._checked = [-1] * len(self._sensors)

    def problem(self, now: float, readings: Readings) -> str:
        """What is wrong with the newest readings, as a sentence; empty: nothing."""
        problem = self._odometry(now, readings.odometry)
        for i, name in enumerate(self._sensors):
            if problem:
                return problem
            problem_ = self._scan(now, readings.of_lidar(name) if i else readings.scan, i)
            problem = of_sensor(name, problem_) if problem_ else ""
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
            return "the odometry is no number"
        age = now - odometry.stamp
        if age < -p.max_ahead:
            return f"the odometry comes {-1000.0 * age:.0f} ms from the future: a clock jumped"
        if age > p.odometry:
            return f"the odometry is {1000.0 * age:.0f} ms old"
        return self._step(odometry)

    def _step(self, odometry: Odometry) -> str:
        last, self._last = self._last, odometry
        if last is None or odometry is last:
            return ""
        dt = odometry.stamp - last.stamp
        if dt < 0.0:
            return f"the odometry's clock went back by {-1000.0 * dt:.0f} ms"
        way = math.hypot(odometry.pose.x - last.pose.x, odometry.pose.y - last.pose.y)
        turn = abs(math.remainder(odometry.pose.psi - last.pose.psi, 2.0 * math.pi))
        if way > 1.5 * self._fastest * dt + self._timeouts.max_jump:
            return f"the odometry jumped by {way:.2f} m"
        if turn > 1.5 * self._turns * dt + self._timeouts.max_jump:
            return f"the odometry jumped by {math.degrees(turn):.0f} deg"
        return ""

    def _scan(self, now: float, scan: Scan | None, lidar: int) -> str:
        if scan is None:
            return "there is no scan"
        if not (math.isfinite(scan.stamp) and math.isfinite(scan.duration)):
            return "the scan's time is no number"
        age = now - scan.stamp - scan.duration
        if age < -self._timeouts.max_ahead:
            return f"the scan comes {-1000.0 * age:.0f} ms from the future: a clock jumped"
        if age > self._timeouts.scans[lidar]:
            return f"the scan is {1000.0 * age:.0f} ms old"
        if scan.number != self._checked[lidar]:
            if np.isnan(scan.ranges).all():
                return "the scan is no number"
            self._checked[lidar] = scan.number
        return ""
