"""What one sonar or infrared range sensor has shown: it measures one range for all of its cone, so
something counts as standing all across the cone at that range."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import inverse, placed
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.odometry_buffer import pose_at
from cohelm.perceive.track.tracker import EMPTY_STATE
from cohelm.robot.port import Scan
from cohelm.robot.sensors import LidarModel

_SURE = 3.0  # a thing may be nearer by so many standard deviations: there is one measurement only
_BEHIND = 0.10  # what is remembered so far behind what is measured now is hidden, not gone [m]
_NOTHING: Floats = np.empty((0, 2))


class RangeSource:
    """One range sensor and its memory. Of movers it can tell nothing, and it vouches for no ground.

    What is in its cone now replaces what was there; what it does not see any more counts for
    `forget_s`.
    """

    def __init__(self, model: LidarModel) -> None:
        self._model, self.lidar, self.sensor = model, model.lidar(), model.name
        self.points = _NOTHING
        """Standing things, (p, 2), in `odom` [m]."""
        self._seen: Floats = np.empty(0)
        """When each was seen, (p,) [s]."""
        self.movers = EMPTY_STATE
        self.stamp = -math.inf
        """Of the newest measurement [s]."""
        self._number: int | None = None

    def new(self, scan: Scan) -> bool:
        """Whether it is another one than the last."""
        return scan.number != self._number

    def take(self, scan: Scan, trail: Floats) -> None:
        """A new measurement, as a scan of its beams: the nearest of them counts for all."""
        self._number = scan.number
        lidar, stamp = self.lidar, scan.stamp + scan.duration
        if len(scan.ranges) != len(lidar.beams) or not math.isfinite(stamp):
            return
        reach = float(np.min(scan.ranges))
        if math.isnan(reach):
            return
        self.stamp = stamp
        pose = pose_at(trail, stamp)
        stays = (stamp - self._seen <= self._model.forget_s) & ~self._looked_at(pose, reach)
        made = placed(placed(self._arcs(reach), lidar.mount), pose)
        self.points = np.vstack((self.points[stays], made))
        self._seen = np.concatenate((self._seen[stays], np.full(len(made), stamp)))

    def _looked_at(self, pose: Pose, reach: float) -> NDArray[np.bool_]:
        """Which of the points are in the cone, and not hidden by what is measured now, (p,)."""
        lidar = self.lidar
        there = placed(placed(self.points, inverse(pose)), inverse(lidar.mount))
        half = -lidar.first + 0.5 * lidar.step
        near = np.hypot(there[:, 0], there[:, 1]) <= min(reach, lidar.range_max) + _BEHIND
        return near & (np.abs(np.arctan2(there[:, 1], there[:, 0])) <= half)

    def _arcs(self, reach: float) -> Floats:
        """What a measurement shows, (n, 2), in the sensor's frame [m]; too near to be measured
        (-inf) is between the sensor and its least range, and stands at both."""
        if reach == math.inf:
            return _NOTHING
        lidar = self.lidar
        near, far = 0.0, lidar.range_min
        if reach >= 0.0:
            near = far = max(reach - _SURE * lidar.noise, 0.0)
        arc = far * lidar.beams
        return arc if near == far else np.vstack((near * lidar.beams[:1], arc))
