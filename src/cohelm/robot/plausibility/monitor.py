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
from cohelm.robot.plausibility.arrival import Arrival, usable
from cohelm.robot.plausibility.content import CRAWL, Content
from cohelm.robot.plausibility.finding import Action, Finding, fault
from cohelm.robot.plausibility.motion import Motion
from cohelm.robot.plausibility.sight import sighted
from cohelm.robot.plausibility.trail import Trail, extended
from cohelm.robot.plausibility.view import View
from cohelm.robot.plausibility.wheels import Following, consistent
from cohelm.robot.port import Odometry, Readings, Scan

_STANDS = 0.5  # what is odd keeps the robot standing for so long after [s]
_AGAIN = 6.0  # odd things within so long of each other are counted [s]
_TIMES = 2  # so many of them, each after things were well, are no accident
_LASTS = 1.0  # odd for so long, while the wheels turn, is no accident either [s]
_VOUCHED = 0.25  # of range_max: where nothing was within it, so far is still clear after
_WAITS = 0.06  # for odometry of a scan's own time [s]
_APART = 0.05  # sights nearer in time are not compared [s]
_SHOWN = 1.0  # a slow-down stays for so long after its cause [s]
_BLIND = math.radians(25.0)  # a LiDAR that lost so much is broken or covered


class PlausibilityMonitor:
    """A `robot.monitor.Monitor`."""

    def __init__(self, model: RobotModel) -> None:
        self._lidar = None if model.lidar is None else model.lidar.lidar()
        self._reach = model.reach
        self._trail, self._commands = Trail(5), Trail(2)
        self._following = Following(model)
        self._arrival = None if model.lidar is None else Arrival(model.lidar)
        self._content = None if model.lidar is None else Content(model.lidar)
        self._motion = None if self._lidar is None else Motion(self._lidar)
        self._view = None if self._lidar is None else View(self._lidar)
        self._pending: deque[Scan] = deque(maxlen=3)
        self._looked = -math.inf
        self._way = math.inf
        """Gone since a scan last showed anything [m]."""
        self._last: Odometry | None = None
        self._clock = -math.inf
        self._odd_since = self._odd_at = -math.inf
        self._odd: deque[float] = deque(maxlen=_TIMES)
        self._hold = ""
        self._fault = Finding(Action.FAULT, "")
        self._fault_at = -math.inf
        self._slow: dict[str, tuple[float, Finding]] = {}

    def observe(self, now: float, readings: Readings, applied: Twist) -> Restriction:
        """All checks that these readings have something new for."""
        if not math.isfinite(now):
            return UNRESTRICTED  # the gate faults by itself
        if not 0.0 <= now - self._clock < 1.0:
            self._forget()
        self._clock = now
        self._commands.add(now, applied.v, applied.omega)
        found = [*self._wheels(now, readings.odometry), *self._scans(now, readings.scan)]
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
        for part in (self._arrival, self._content, self._motion, self._view):
            if part is not None:
                part.forget()
        self._pending.clear()
        self._odd_at = self._odd_since = -math.inf
        self._last = None

    def _wheels(self, now: float, odometry: Odometry | None) -> list[Finding]:
        if odometry is None or odometry is self._last:
            return []
        self._last = odometry
        numbers = (odometry.stamp, *odometry.pose, *odometry.twist)
        if not all(map(math.isfinite, numbers)) or odometry.stamp <= self._trail.newest:
            return []
        self._way += abs(odometry.twist.v) * min(odometry.stamp - self._trail.newest, 1.0)
        extended(self._trail, odometry)
        found = (
            consistent(self._trail), self._following.watch(now, odometry.twist, self._commands)
        )  # fmt: skip
        return [one for one in found if one is not None]

    def _scans(self, now: float, scan: Scan | None) -> list[Finding]:
        arrival, content, lidar = self._arrival, self._content, self._lidar
        if arrival is None or content is None or lidar is None:
            return []
        found: list[Finding] = []
        if scan is not None and usable(scan) and arrival.new(scan):
            found += arrival.take(now, scan)
            found += content.look(scan)
            if len(scan.ranges) == len(lidar.beams):
                self._pending.append(scan)
        while self._pending:
            first = self._pending[0]
            end = first.stamp + first.duration
            if (self._trail.newest < end and now - end < _WAITS) or not len(self._trail):
                break
            found += self._look(self._pending.popleft())
        return found

    def _look(self, scan: Scan) -> list[Finding]:
        """A scan whose time odometry has reached."""
        motion, view, lidar = self._motion, self._view, self._lidar
        if motion is None or view is None or lidar is None:
            return []
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        if scan.stamp + scan.duration - self._looked < _APART:
            return []
        sight = sighted(lidar, ranges, scan.stamp, scan.duration, self._trail)
        self._looked = sight.stamp
        found = motion.take(sight)
        angle = view.take(ranges, motion.blinded)
        if not view.blank:
            self._way = 0.0
        if angle > _BLIND:
            wide = math.degrees(angle)
            found.append(fault(f"{wide:.0f} deg of the scan are empty where things stood"))
        return found

    def _decided(self, now: float, found: list[Finding]) -> Restriction:
        faults = [one for one in found if one.action == Action.FAULT]
        odd = [one for one in found if one.action == Action.HOLD]
        for one in found:
            if one.action == Action.SLOW:
                self._slow[one.reason[:24]] = (now, one)
        if odd:
            faults += self._oddity(now, odd[0])
        if faults:
            return Restriction(0.0, faults[0].reason, fault=True)
        if now - self._odd_at < _STANDS:
            return Restriction(0.0, self._hold)
        return UNRESTRICTED

    def _oddity(self, now: float, one: Finding) -> list[Finding]:
        """Something odd: it is a fault when it lasts, or comes again and again."""
        if now - self._odd_at > _STANDS:
            self._odd_since = now
            self._odd.append(now)
            self._hold = one.reason
        self._odd_at = now
        again = len(self._odd) == _TIMES and now - self._odd[0] < _AGAIN
        rows = self._trail.since(now - 0.3)
        rolls = bool(len(rows)) and float(np.abs(rows[:, 4:6]).max()) > 0.05
        if again or (rolls and now - self._odd_since > _LASTS):
            return [fault(one.reason)]
        return []

    def _limit(self, now: float, twist: Twist) -> tuple[float, str]:
        speed, reason = math.inf, ""
        for key, (at, one) in list(self._slow.items()):
            if now - at > _SHOWN:
                del self._slow[key]
            elif one.speed < speed:
                speed, reason = one.speed, one.reason
        view = self._view
        if self._motion is not None and self._motion.doubted:
            return CRAWL, "scans and odometry disagreed, and have to agree first over some way"
        if view is None or twist.v == 0.0:
            return speed, reason
        if self._way > _VOUCHED * (self._lidar.range_max if self._lidar else 0.0):
            return CRAWL, "the scan shows nothing at all: it vouches for no ground"
        if not view.vouches(0.0 if twist.v > 0.0 else math.pi):
            return CRAWL, "the LiDAR has not shown that it sees what lies ahead"
        return speed, reason
