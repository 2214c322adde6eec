"""The plausibility monitor: no sensor is trusted alone.

Checks every reading against the one before, the other sensors and the commands sent. What is
impossible is a fault; what is implausible for a moment makes the robot stand for that moment, and
is a fault when it repeats; a degraded sensor makes the robot slow.
"""

from __future__ import annotations

import math
from collections import deque
from functools import cache

import numpy as np

from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.plausibility.content import Content
from cohelm.robot.plausibility.finding import Action, Finding, fault
from cohelm.robot.plausibility.match import Match, match
from cohelm.robot.plausibility.sight import sighted
from cohelm.robot.plausibility.source import PlausibilitySource
from cohelm.robot.plausibility.trail import Trail, extended
from cohelm.robot.plausibility.view import farther, vanished
from cohelm.robot.plausibility.wheels import Following, commanded, consistent
from cohelm.robot.port import AHEAD, Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel

_RESET = 1.0  # odometry whose stamps go back by at least this begins anew [s]
_HOLD_TIME = 0.5  # the robot stands for this long after a hold finding [s]
_REPEAT_WINDOW = 6.0  # hold findings within this time of each other are counted [s]
_MAX_HOLDS = 2  # this many of them, each after a time without, are a fault
_MAX_HOLD_TIME = 1.0  # one that lasts longer while the wheels turn is a fault, too [s]
_SLOW_TIME = 1.0  # a speed limit stays for this long after its cause [s]


class PlausibilityMonitor:
    """A `robot.monitor.Monitor`."""

    def __init__(self, model: RobotModel) -> None:
        warm_up()
        self._reach = model.reach
        self._trail, self._commands = Trail(5), Trail(2)
        self._following = Following(model)
        half_width = float(np.abs(model.outline[:, 1]).max())
        self._sources = [
            PlausibilitySource(lidar, i == 0, half_width)
            for i, lidar in enumerate(model.lidars) if not lidar.range_sensor
        ]  # fmt: skip
        self._last: Odometry | None = None
        self._clock = -math.inf
        self._odd_since = self._odd_at = -math.inf
        self._odd: deque[float] = deque(maxlen=_MAX_HOLDS)
        self._hold = ""
        self._slow: dict[tuple[str, str], tuple[float, Finding]] = {}

    def observe(
        self, now: float, readings: Readings, applied: Twist, stopped: bool = False
    ) -> Restriction:
        """Run all checks for which these readings have new data."""
        if not math.isfinite(now):
            return UNRESTRICTED  # the gate faults by itself
        if not 0.0 <= now - self._clock < 1.0:
            self._forget()
        self._clock = now
        self._commands.add(now, applied.v, applied.omega)
        found = self._wheels(now, readings.odometry, stopped)
        for source in self._sources:
            found += source.take(now, readings, self._trail)
        return self._decided(now, found)

    def restrict(self, now: float, twist: Twist) -> Restriction:
        """Limit the speed of the fastest part of the outline."""
        fastest = abs(twist.v) + self._reach * abs(twist.omega)
        limit, reason = self._limit(now, twist)
        if math.isinf(limit):
            return UNRESTRICTED
        if not fastest > limit:
            return Restriction(limit=limit, limit_reason=reason)
        return Restriction(limit / fastest, reason, limit=limit, limit_reason=reason)

    def _forget(self) -> None:
        """Reset, after the clock jumped or `observe` was not called for a while."""
        for source in self._sources:
            source.forget()
        self._odd_at = self._odd_since = -math.inf
        self._odd.clear()
        self._slow.clear()
        self._last = None

    def _wheels(self, now: float, odometry: Odometry | None, stopped: bool) -> list[Finding]:
        if odometry is None or odometry is self._last:
            return []
        self._last = odometry
        numbers = (odometry.stamp, *odometry.pose, *odometry.twist)
        if not all(map(math.isfinite, numbers)) or odometry.stamp > now + AHEAD:
            return []  # the gate refuses proposals made from readings of the future
        if 0.0 <= self._trail.newest - odometry.stamp < _RESET:
            return []
        way = abs(odometry.twist.v) * min(max(odometry.stamp - self._trail.newest, 0.0), 1.0)
        for source in self._sources:
            source.moved(way)
        extended(self._trail, odometry)
        found = (
            consistent(self._trail),
            self._following.watch(now, odometry.twist, self._commands, stopped),
        )
        return [one for one in found if one is not None]

    def _decided(self, now: float, found: list[Finding]) -> Restriction:
        faults = [one for one in found if one.action == Action.FAULT]
        odd = [one for one in found if one.action == Action.HOLD]
        for one in found:
            if one.action == Action.SLOW:
                self._slow[one.sensor, one.reason[:24]] = (now, one)
        if odd:
            faults += self._oddity(now, odd[0])
        if faults:
            return Restriction(0.0, faults[0].text, fault=True)
        if now - self._odd_at < _HOLD_TIME:
            return Restriction(0.0, self._hold)
        return UNRESTRICTED

    def _oddity(self, now: float, one: Finding) -> list[Finding]:
        """A hold finding; it is a fault when it lasts or repeats."""
        if now - self._odd_at > _HOLD_TIME:
            self._odd_since = now
            self._odd.append(now)
            self._hold = one.text
        self._odd_at = now
        repeated = len(self._odd) == _MAX_HOLDS and now - self._odd[0] < _REPEAT_WINDOW
        rows = self._trail.since(now - 0.3)
        rolls = bool(len(rows)) and float(np.abs(rows[:, 4:6]).max()) > 0.05
        if repeated or (rolls and now - self._odd_since > _MAX_HOLD_TIME):
            return [fault(one.text)]
        return []

    def _limit(self, now: float, twist: Twist) -> tuple[float, str]:
        speed, reason = math.inf, ""
        for key, (at, one) in list(self._slow.items()):
            if now - at > _SLOW_TIME:
                del self._slow[key]
            elif one.speed < speed:
                speed, reason = one.speed, one.text
        for source in self._sources:
            if doubt := source.doubt():
                return doubt.speed, doubt.text
        if twist.v == 0.0:
            return speed, reason
        bearing = 0.0 if twist.v > 0.0 else math.pi
        looking = [source for source in self._sources if source.looks(bearing)] or self._sources
        for source in looking:
            if limit := source.limit(bearing):
                return limit.speed, limit.text
        return speed, reason


@cache
def warm_up() -> None:
    """Run every compiled function before the gate process is in use, on three scans of a small room
    that seems to grow."""
    model = LidarModel(
        beams=181, field_of_view_deg=180.0, range_min_m=0.05, range_max_m=10.0, rate_hz=10.0,
        noise_m=0.01,
    )  # fmt: skip
    lidar, content, trail = model.lidar(), Content(model), Trail(5)
    for k in range(20):
        extended(trail, Odometry(0.05 * k, Pose(0.01 * k, 0.0, 0.01 * k), Twist(0.2, 0.2)))
    consistent(trail)
    commanded(trail.rows, 0.0)
    room: Floats = 2.0 / np.abs(lidar.beams).max(axis=1)
    scans = [Scan(0.1 * k, k, (1.0 + 0.2 * k) * room, 0.05) for k in range(3)]
    for scan in scans:
        content.look(scan)
    a, b, c = (sighted(lidar, scan.ranges, scan.stamp, scan.duration, trail) for scan in scans)
    vanished(a, b, lidar, 0.0)
    farther(b, c, lidar)
    for least in (0.0, 1e-9):
        match(a, b, lidar, least)
    Match(np.zeros(3), np.zeros((3, 3)), 0.0, 0.0).seen(1.0, 0.0)  # also called by itself
