"""Checks readings: missing, stale, from the future, not a number, jumping."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.robot.contact_monitor import unheard
from cohelm.robot.model import RobotModel
from cohelm.robot.port import AHEAD, Odometry, Readings, Scan
from cohelm.robot.sensors import of_sensor


class Patience(NamedTuple):
    """How old a reading may be [s], and how odd."""

    odometry: float
    scans: tuple[float, ...]
    """Of each LiDAR, the first one first."""
    ahead: float = AHEAD
    """From the future by more than this: a clock has jumped."""
    spring: float = 0.15
    """The odometry may be off by this much more than the robot's own speed explains [m, rad]."""


def patience(model: RobotModel, period: float) -> Patience:
    """By the rates of the robot's sensors; three and a half readings may be missing, or as many
    scans as a LiDAR's own time-out allows."""
    scans = (
        lidar.timeout_s or 3.5 / lidar.rate_hz + lidar.sweep_s + lidar.latency_s
        for lidar in model.lidars
    )
    odometry = max(3.5 / model.odometry.rate_hz, 0.07) + period
    return Patience(odometry, tuple(scan + period for scan in scans))


class SensorWatchdog:
    """Remembers just enough of the last readings to see that the next ones fit."""

    def __init__(self, model: RobotModel, patience: Patience) -> None:
        self._patience = patience
        self._sensors = [lidar.name for lidar in model.lidars]
        self._contacts = model.contacts
        limits = model.bounds()
        self._fastest = min(limits.speed, limits.wheel_speed, 50.0)
        self._turns = min(limits.yaw_rate, 2.0 * limits.wheel_speed / limits.track, 50.0)
        self._last: Odometry | None = None
        self._checked = [-1] * len(self._sensors)

    def wrong(self, now: float, readings: Readings) -> str:
        """What is wrong with the newest readings, in words for the record; empty: nothing."""
        wrong = self._odometry(now, readings.odometry)
        for i, name in enumerate(self._sensors):
            if wrong:
                return wrong
            said = self._scan(now, readings.of_lidar(name) if i else readings.scan, i)
            wrong = of_sensor(name, said) if said else ""
        if not wrong and self._contacts:
            newest = {one.sensor: one for one in readings.contacts}
            each = (unheard(one, newest.get(one.name), now) for one in self._contacts)
            wrong = next((said for said in each if said), "")
        return wrong

    def _odometry(self, now: float, odometry: Odometry | None) -> str:
        p = self._patience
        if odometry is None:
            return "there is no odometry"
        if not all(map(math.isfinite, (odometry.stamp, *odometry.pose, *odometry.twist))):
            return "the odometry is no number"
        age = now - odometry.stamp
        if age < -p.ahead:
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
        if way > 1.5 * self._fastest * dt + self._patience.spring:
            return f"the odometry jumped by {way:.2f} m"
        if turn > 1.5 * self._turns * dt + self._patience.spring:
            return f"the odometry jumped by {math.degrees(turn):.0f} deg"
        return ""

    def _scan(self, now: float, scan: Scan | None, lidar: int) -> str:
        if scan is None:
            return "there is no scan"
        if not (math.isfinite(scan.stamp) and math.isfinite(scan.duration)):
            return "the scan's time is no number"
        age = now - scan.stamp - scan.duration
        if age < -self._patience.ahead:
            return f"the scan comes {-1000.0 * age:.0f} ms from the future: a clock jumped"
        if age > self._patience.scans[lidar]:
            return f"the scan is {1000.0 * age:.0f} ms old"
        if scan.number != self._checked[lidar]:
            if np.isnan(scan.ranges).all():
                return "the scan is no number"
            self._checked[lidar] = scan.number
        return ""
