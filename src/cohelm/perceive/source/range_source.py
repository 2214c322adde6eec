"""Observation source of one sonar or infrared range sensor: it measures one range for its cone, so
points across the whole cone at that range are static."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import inverse, placed
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.odometry_buffer import is_placeable, pose_at
from cohelm.robot.port import Scan
from cohelm.robot.sensors import LidarModel

_SURE = 3.0  # standard deviations by which an obstacle may be nearer, by a single measurement
_BEHIND = 0.10  # a remembered point so far behind a measurement is occluded, not gone [m]
_NOTHING: Floats = np.empty((0, 2))


class RangeSource:
    """One range sensor and its memory. It detects no movers, and observes no ground.

    Points in its cone are replaced by a measurement; points outside of it are kept for
    `forget_s`.
    """

    def __init__(self, model: LidarModel) -> None:
        self._model, self.lidar, self.sensor = model, model.lidar(), model.name
        self.points = _NOTHING
        """Static points, (p, 2), in `odom` [m]."""
        self._seen: Floats = np.empty(0)
        """When each was measured, (p,) [s]."""
        self.number: int | None = None
        """Of the newest scan."""

    def take(self, scan: Scan, buffer: Floats) -> None:
        """Take a measurement, as a scan of its beams: the nearest of them counts for all."""
        self.number = scan.number
        lidar, stamp = self.lidar, scan.stamp + scan.duration
        if not is_placeable(buffer, scan, len(lidar.beams)) or np.isnan(scan.ranges).all():
            return
        reach = float(np.nanmin(scan.ranges))
        pose = pose_at(buffer, stamp)
        stays = (stamp - self._seen <= self._model.forget_s) & ~self._looked_at(pose, reach)
        made = placed(placed(self._arcs(reach), lidar.mount), pose)
        self.points = np.vstack((self.points[stays], made))
        self._seen = np.concatenate((self._seen[stays], np.full(len(made), stamp)))

    def _looked_at(self, pose: Pose, reach: float) -> NDArray[np.bool_]:
        """Which of the points are in the cone, and not occluded by the measurement, (p,)."""
        lidar = self.lidar
        there = placed(placed(self.points, inverse(pose)), inverse(lidar.mount))
        half = -lidar.first + 0.5 * lidar.step
        near = np.hypot(there[:, 0], there[:, 1]) <= min(reach, lidar.range_max) + _BEHIND
        return near & (np.abs(np.arctan2(there[:, 1], there[:, 0])) <= half)

    def _arcs(self, reach: float) -> Floats:
        """Points of a measurement, (n, 2), in the sensor's frame [m]; one below the minimum range
        (-inf) is put at the sensor and at the minimum."""
        if reach == math.inf:
            return _NOTHING
        lidar = self.lidar
        near, far = 0.0, lidar.range_min
        if reach >= 0.0:
            near = far = max(reach - _SURE * lidar.noise, 0.0)
        arc = far * lidar.beams
        return arc if near == far else np.vstack((near * lidar.beams[:1], arc))
