"""One LiDAR of the plausibility monitor: checks the arrival of its scans, their content, the motion
that they show, and the directions in which it sees."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cohelm.robot.plausibility.content import CAREFUL, CRAWL, Content
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

    def __init__(self, model: LidarModel, first: bool, half_width: float) -> None:
        """first: whether its scans come as `Readings.scan`. half_width: of the robot [m]."""
        self._name, self._first, self._lidar = model.name, first, model.lidar()
        self._arrival, self._content = Arrival(model), Content(model)
        self._motion, self._view = Motion(self._lidar), ScanView(self._lidar, half_width)
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
        motion = self._motion
        return self._crawl(
            f"after {motion.cause}, for up to {motion.to_go:g} m: drive on until scans and "
            "odometry agree"
        )

    def _look(self, scan: Scan, trail: Trail) -> list[Finding]:
        """Check a scan whose time odometry has reached."""
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        if scan.stamp + scan.duration - self._looked < _APART:
            return []
        sight = sighted(self._lidar, ranges, scan.stamp, scan.duration, trail)
        self._looked = sight.stamp
        found = self._motion.take(sight)
        if found and np.isnan(ranges).all():
            self._motion.cause = "a scan that was not a number"
        angle = self._view.take(ranges, self._motion.blinded)
        if not self._view.blank:
            self._way = 0.0
        if angle > _MAX_BLINDED:
            wide = math.degrees(angle)
            found.append(fault(f"{wide:.0f} deg of the scan are empty where things stood"))
        return found

    def _crawl(self, reason: str) -> Finding:
        return slow(CRAWL, reason)._replace(sensor=self._name)


_SLACK = 0.1
"""Delay of a scan allowed beyond its LiDAR's latency [s]: the loop reads every 20 to 100 ms."""
_PATIENCE = 5  # scans in a row
_TOO_OFTEN = 3
"""... in a row stamped too close together: more than reading late explains."""


class Arrival:
    """Checks stamps and numbers of one LiDAR's scans against the times at which they arrive."""

    def __init__(self, lidar: LidarModel) -> None:
        self._usual = lidar.latency_s + _SLACK
        self._period = 1.0 / lidar.rate_hz
        self._last: Scan | None = None
        self._late = self._often = 0

    def forget(self) -> None:
        """Reset: as if no scan had arrived."""
        self._last, self._late, self._often = None, 0, 0

    def new(self, scan: Scan) -> bool:
        """Whether this scan differs from the last one."""
        last = self._last
        return last is None or scan.number != last.number or scan.stamp != last.stamp

    def take(self, now: float, scan: Scan) -> list[Finding]:
        """Check a new scan."""
        last, self._last = self._last, scan
        late = now - scan.stamp - scan.duration > self._usual
        self._late = self._late + 1 if late else 0
        if last is not None:
            if scan.number == last.number:
                return [fault(f"the scan's number stays {scan.number} while its stamps go on")]
            if scan.number < last.number:
                return [fault(f"the scans' numbers went back from {last.number} to {scan.number}")]
            if scan.stamp == last.stamp:
                return [fault("the scans' stamps stand still")]
            if scan.stamp < last.stamp:
                back = last.stamp - scan.stamp
                return [
                    fault(f"the scans' stamps went back by {back:.2f} s, as if a clock was set")
                ]
            skipped = scan.number - last.number
            often = scan.stamp - last.stamp < 0.4 * self._period * skipped
            self._often = self._often + 1 if often else 0
            if self._often >= _TOO_OFTEN:
                step = 1000.0 * (scan.stamp - last.stamp) / skipped
                return [fault(f"scans are stamped {step:.0f} ms apart, more often than they come")]
        if self._late >= _PATIENCE:
            age = 1000.0 * (now - scan.stamp - scan.duration)
            return [slow(CAREFUL, f"scans come {age:.0f} ms late")]
        return []


def usable(scan: Scan) -> bool:
    """Whether its stamp and duration are finite."""
    return math.isfinite(scan.stamp) and math.isfinite(scan.duration) and scan.duration >= 0.0
