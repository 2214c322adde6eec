"""The plausibility monitor: no sense is believed alone.

Every reading is held against the one before, against the other senses and against what the wheels
were told. What can not be is a fault; what is odd for a moment makes the robot stand for that
moment, and is a fault when it comes again; what is worse than it should be makes it slow.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cohelm.core.types import Twist
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.plausibility.finding import Action, Finding, fault
from cohelm.robot.plausibility.rehearsal import rehearse
from cohelm.robot.plausibility.source import PlausibilitySource
from cohelm.robot.plausibility.trail import Trail, extended
from cohelm.robot.plausibility.wheels import Following, consistent
from cohelm.robot.port import AHEAD, Odometry, Readings

_BACK = 1.0  # and odometry that goes back by so much begins anew [s]
_STANDS = 0.5  # what is odd keeps the robot standing for so long after [s]
_AGAIN = 6.0  # odd things within so long of each other are counted [s]
_TIMES = 2  # so many of them, each after things were well, are no accident
_LASTS = 1.0  # odd for so long, while the wheels turn, is no accident either [s]
_SHOWN = 1.0  # a slow-down stays for so long after its cause [s]


class PlausibilityMonitor:
    """A `robot.monitor.Monitor`."""

    def __init__(self, model: RobotModel) -> None:
        rehearse()
        self._reach = model.reach
        self._trail, self._commands = Trail(5), Trail(2)
        self._following = Following(model)
        self._sources = [
            PlausibilitySource(lidar, i == 0)
            for i, lidar in enumerate(model.lidars) if not lidar.range_sensor
        ]  # fmt: skip
        self._last: Odometry | None = None
        self._clock = -math.inf
        self._odd_since = self._odd_at = -math.inf
        self._odd: deque[float] = deque(maxlen=_TIMES)
        self._hold = ""
        self._slow: dict[tuple[str, str], tuple[float, Finding]] = {}

    def observe(
        self, now: float, readings: Readings, applied: Twist, stopped: bool = False
    ) -> Restriction:
        """All checks that these readings have something new for."""
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
        """The speed of the fastest part of the outline, where there is a limit to it."""
        fastest = abs(twist.v) + self._reach * abs(twist.omega)
        limit, reason = self._limit(now, twist)
        if not fastest > limit:
            return UNRESTRICTED
        return Restriction(limit / fastest, reason)

    def _forget(self) -> None:
        """The clock jumped, or nobody looked for a while: what was before tells nothing."""
        for source in self._sources:
            source.forget()
        self._odd_at = self._odd_since = -math.inf
        self._last = None

    def _wheels(self, now: float, odometry: Odometry | None, stopped: bool) -> list[Finding]:
        if odometry is None or odometry is self._last:
            return []
        self._last = odometry
        numbers = (odometry.stamp, *odometry.pose, *odometry.twist)
        if not all(map(math.isfinite, numbers)) or odometry.stamp > now + AHEAD:
            return []  # who proposes by what is from the future is refused
        if 0.0 <= self._trail.newest - odometry.stamp < _BACK:
            return []
        way = abs(odometry.twist.v) * min(odometry.stamp - self._trail.newest, 1.0)
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
            return Restriction(0.0, faults[0].said, fault=True)
        if now - self._odd_at < _STANDS:
            return Restriction(0.0, self._hold)
        return UNRESTRICTED

    def _oddity(self, now: float, one: Finding) -> list[Finding]:
        """Something odd: it is a fault when it lasts, or comes again and again."""
        if now - self._odd_at > _STANDS:
            self._odd_since = now
            self._odd.append(now)
            self._hold = one.said
        self._odd_at = now
        again = len(self._odd) == _TIMES and now - self._odd[0] < _AGAIN
        rows = self._trail.since(now - 0.3)
        rolls = bool(len(rows)) and float(np.abs(rows[:, 4:6]).max()) > 0.05
        if again or (rolls and now - self._odd_since > _LASTS):
            return [fault(one.said)]
        return []

    def _limit(self, now: float, twist: Twist) -> tuple[float, str]:
        speed, reason = math.inf, ""
        for key, (at, one) in list(self._slow.items()):
            if now - at > _SHOWN:
                del self._slow[key]
            elif one.speed < speed:
                speed, reason = one.speed, one.said
        for source in self._sources:
            if doubt := source.doubt():
                return doubt.speed, doubt.said
        if twist.v == 0.0:
            return speed, reason
        bearing = 0.0 if twist.v > 0.0 else math.pi
        looking = [source for source in self._sources if source.looks(bearing)] or self._sources
        for source in looking:
            if limit := source.limit(bearing):
                return limit.speed, limit.said
        return speed, reason
