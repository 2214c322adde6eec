"""One LiDAR of the plausibility monitor: checks the arrival of its scans, their content, the motion
that they show, and the directions in which it sees."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cohelm.robot.plausibility.arrival import Arrival, usable
from cohelm.robot.plausibility.content import CRAWL, Content
from cohelm.robot.plausibility.finding import Finding, fault, slow
from cohelm.robot.plausibility.motion import Motion
from cohelm.robot.plausibility.sight import sighted
from cohelm.robot.plausibility.trail import Trail
from cohelm.robot.plausibility.view import ScanView
from cohelm.robot.port import Readings, Scan
from cohelm.robot.sensors import LidarModel

_VOUCHED = 0.25  # share of range_max that may be driven after the last scan with a return
_MAX_WAIT = 0.06  # for odometry of a scan's own time [s]
_APART = 0.05  # sights closer in time are not compared [s]
_MAX_BLINDED = math.radians(25.0)  # a LiDAR that lost more is broken or covered


class PlausibilitySource:
    """All checks of one LiDAR."""

    def __init__(self, model: LidarModel, first: bool) -> None:
        """first: whether its scans come as `Readings.scan`."""
        self._name, self._first, self._lidar = model.name, first, model.lidar()
        self._arrival, self._content = Arrival(model), Content(model)
        self._motion, self._view = Motion(self._lidar), ScanView(self._lidar)
        self._pending: deque[Scan] = deque(maxlen=3)
        self._looked = -math.inf
        self._way = math.inf
        """Driven since a scan last showed anything [m]."""

    def forget(self) -> None:
        """Reset, after the clock jumped or `take` was not called for a while."""
        for part in (self._arrival, self._content, self._motion, self._view):
            part.forget()
        self._pending.clear()
        self._looked = -math.inf

    def moved(self, way: float) -> None:
        """The robot has driven this far [m]."""
        self._way += way

    def take(self, now: float, readings: Readings, trail: Trail) -> list[Finding]:
        """Check a scan that is new, or that odometry has reached."""
        scan = readings.scan if self._first else readings.of_lidar(self._name)
        found: list[Finding] = []
        if scan is not None and usable(scan) and self._arrival.new(scan):
            found += self._arrival.take(now, scan)
            found += self._content.look(scan)
            if len(scan.ranges) == len(self._lidar.beams):
                self._pending.append(scan)
        while self._pending:
            first = self._pending[0]
            end = first.stamp + first.duration
            if (trail.newest < end and now - end < _MAX_WAIT) or not len(trail):
                break
            self._pending.popleft()
            if end - trail.newest <= _MAX_WAIT:  # else there is no odometry to compare it with
                found += self._look(first, trail)
        return [one._replace(sensor=self._name) for one in found]

    def looks(self, bearing: float) -> bool:
        """Whether it looks along a bearing in the body frame [rad]."""
        return self._view.looks(bearing)

    def limit(self, bearing: float) -> Finding | None:
        """The speed limit along a bearing [rad] in which the LiDAR has not returned anything."""
        if self._way > _VOUCHED * self._lidar.range_max:
            return self._crawl("the scan shows nothing at all: it does not confirm free space")
        if not self._view.vouches(bearing):
            return self._crawl("the LiDAR has not shown that it sees what lies ahead")
        return None

    def doubt(self) -> Finding | None:
        """The speed limit for any motion."""
        if not self._motion.doubted:
            return None
        return self._crawl(
            "scans and odometry disagreed, and have to agree first over some distance"
        )

    def _look(self, scan: Scan, trail: Trail) -> list[Finding]:
        """Check a scan whose time odometry has reached."""
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        if scan.stamp + scan.duration - self._looked < _APART:
            return []
        sight = sighted(self._lidar, ranges, scan.stamp, scan.duration, trail)
        self._looked = sight.stamp
        found = self._motion.take(sight)
        angle = self._view.take(ranges, self._motion.blinded)
        if not self._view.blank:
            self._way = 0.0
        if angle > _MAX_BLINDED:
            wide = math.degrees(angle)
            found.append(fault(f"{wide:.0f} deg of the scan are empty where things stood"))
        return found

    def _crawl(self, reason: str) -> Finding:
        return slow(CRAWL, reason)._replace(sensor=self._name)
