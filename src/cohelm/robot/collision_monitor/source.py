"""One LiDAR of the collision monitor: its newest scan, its returns, and its unobserved ground.

Each LiDAR has its own beams, stamps and time-out. Returns that leave its view are remembered even
where another LiDAR looks, which may look over them; unless both look in one plane.
"""

from __future__ import annotations

import math

from cohelm.robot.collision_monitor.free_space import FreeSpace
from cohelm.robot.collision_monitor.odometry import PoseHistory, seen_from
from cohelm.robot.collision_monitor.returns import Sensor, returns
from cohelm.robot.collision_monitor.surroundings import (
    BESIDE,
    LEVEL,
    NOTHING,
    MonitorSurroundings,
    ScanWithPoses,
    all_round,
    joined,
    looked_past,
    of_scan,
    out_of_sight,
)
from cohelm.robot.collision_monitor.sweep import Outline, edge_distances
from cohelm.robot.port import AHEAD, Readings, Scan
from cohelm.robot.sensors import of_sensor

MISSED = 3.0
"""Periods without a scan before the LiDAR is stale: two lost scans in a row are ordinary."""


class MonitorSource:
    """The scans of one LiDAR."""

    def __init__(
        self, sensor: Sensor, first: bool, shape: Outline, farthest: float, remembers: bool
    ) -> None:
        """first: whether its scans come as `Readings.scan`. farthest: distance beyond the turning
        circle from which nothing matters [m]. remembers: whether ground may be unknown."""
        self._sensor, self._first = sensor, first
        usual = MISSED / sensor.rate + sensor.sweep + sensor.latency
        self._patience = usual if math.isnan(sensor.timeout) else sensor.timeout
        self._around, self._own = all_round(sensor), shape
        self._near = 0.0
        """Returns farther from the sensor than this do not matter [m]."""
        self._reach = 0.0
        """Returns out of view are remembered within BESIDE of this, from the body's origin [m]."""
        vouches = sensor.forgets == math.inf
        self.ground = FreeSpace(sensor, shape, farthest) if remembers and vouches else None
        """Ground that it has observed."""
        watches = sensor.floor_from > 0.0
        self.floor = FreeSpace(sensor, shape, farthest, floor=True) if watches else None
        """Floor that it has seen, if it watches the floor."""
        self._spaces = [one for one in (self.ground, self.floor) if one is not None]
        self.reshape(shape, farthest)
        self._scan: Scan | None = None
        self._newest: ScanWithPoses | None = None
        self.by_odometry = NOTHING
        """Returns of the newest scan, in the frame of the odometry's poses, and remembered ones."""
        self.by_command = NOTHING
        """Returns of the newest scan in the frame of the poses reckoned from the commands sent."""

    def reshape(self, shape: Outline, farthest: float) -> None:
        """Change the robot's outline. farthest: as above."""
        across = max(shape.reach, math.hypot(self._sensor.mount.x, self._sensor.mount.y))
        beyond = farthest if self._around else max(farthest, BESIDE)
        self._near = across + shape.reach + beyond
        self._reach = shape.reach
        for space in self._spaces:
            space.reshape(shape, farthest)
            self._near = max(self._near, space.returns)
            self._reach = max(self._reach, space.returns - BESIDE)

    def forget(self) -> None:
        """Forget what was placed by odometry, which began anew."""
        self._scan = self._newest = None
        self.by_odometry = NOTHING
        for space in self._spaces:
            space.forget()

    def look(
        self, now: float, readings: Readings, measured: PoseHistory, commanded: PoseHistory
    ) -> tuple[bool, str]:
        """Take its scan: whether there was a new one, and what is wrong, or an empty string."""
        scan = readings.scan if self._first else readings.of_lidar(self._sensor.name)
        if scan is None:
            return False, self._text("there is no scan")
        if scan is self._scan:
            return False, ""
        sensor = self._sensor
        if len(scan.ranges) != len(sensor.bearings):
            text = f"a scan of {len(scan.ranges)} beams, and not {len(sensor.bearings)}"
            return False, self._text(text)
        if not math.isfinite(scan.stamp + scan.duration):
            return False, self._text("the scan's time is not a number")
        if scan.stamp + scan.duration > now + AHEAD:
            return False, self._text("the scan comes from the future")
        first, last = (measured.at(scan.stamp + t) for t in (0.0, scan.duration))
        before = out_of_sight(
            self.by_odometry, scan.stamp, first, last, sensor, self._reach, scan.ranges
        )  # fmt: skip
        # What was too near to be measured may have been as near as the sensor itself, but not where
        # the robot is now.
        here = seen_from(before.points, last)
        ended = (before.margins == 0.0) & (edge_distances(here, self._own).max(axis=1) < 0.0)
        before = MonitorSurroundings(*(column[~ended] for column in before))
        if sensor.forgets < math.inf:
            lately = scan.stamp - before.seen <= sensor.forgets
            before = MonitorSurroundings(*(column[lately] for column in before))
        self._scan, self._newest = scan, ScanWithPoses(sensor, scan, first, last)
        found = returns(scan.ranges, sensor, self._near)
        self.by_odometry = joined(of_scan(found, scan, measured), before)
        self.by_command = of_scan(found, scan, commanded)
        when = scan.stamp + 0.5 * scan.duration
        for space in self._spaces:
            space.look(scan.ranges, measured.at(when), last.psi - first.psi, when)
        return True, ""

    def forget_passed(self, other: MonitorSource) -> None:
        """Forget remembered returns that another LiDAR's newest scan looks past."""
        look, own = other._newest, self._scan
        if look is None or own is None:
            return
        if abs(look.sensor.height - self._sensor.height) <= LEVEL:  # not for NaN
            old = self.by_odometry
            stays = (old.seen >= own.stamp) | ~looked_past(old, look)
            self.by_odometry = MonitorSurroundings(*(column[stays] for column in old))

    def stale(self, now: float) -> str:
        """What is wrong with the newest scan's age, or an empty string."""
        if self._scan is None:
            return self._text("there is no scan")
        age = now - self._scan.stamp - self._scan.duration
        if age > self._patience:
            return self._text(f"no scan for {1000.0 * age:.0f} ms")
        return ""

    def _text(self, what: str) -> str:
        return of_sensor(self._sensor.name, what)
