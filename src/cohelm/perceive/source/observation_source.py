"""Observation source: the static points and movers of one LiDAR. Each clears only what it sees gone
itself, as another may look over or past it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import compose
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap, on_walls
from cohelm.perceive.scan.deskew import DeskewedScan, deskew
from cohelm.perceive.scan.odometry_buffer import is_placeable
from cohelm.perceive.space.free_space_memory import with_possibly_occupied
from cohelm.perceive.space.scan_memory import renew
from cohelm.perceive.track.params import TrackerParams
from cohelm.perceive.track.track import MOVES, RADIUS, TX, TY
from cohelm.perceive.track.tracker import empty_state, update_tracker
from cohelm.robot.port import Scan
from cohelm.robot.sensors import Lidar

NOTHING: Floats = np.empty((0, 2))
_APART = 0.06  # minimum time between two updates of the tracker [s]
_RESET = 1.0  # scans whose stamps go back by at least this are tracked anew [s]
_ON_WALL = 0.1  # a return as near to a wall of the map as this is on it [m]


class ObservationSource:
    """One LiDAR with its scan memory and tracker."""

    def __init__(
        self, lidar: Lidar, sensor: str, keep: float, tracker_params: TrackerParams
    ) -> None:
        """sensor: as its scans name it. keep: as for `scan_memory.renew` [m]."""
        self.lidar, self.sensor = lidar, sensor
        self._keep, self._tracker_params = keep, tracker_params
        self.points = NOTHING
        """Static points, (p, 2), in `odom` [m]."""
        self.tracked = empty_state(self.lidar, self._tracker_params)
        self.sweep: DeskewedScan | None = None
        """The newest sweep."""
        self.number: int | None = None
        """Of the newest scan."""

    def take(
        self, scan: Scan, buffer: Floats, known: LocalizationMap | None, map_odom: Pose
    ) -> DeskewedScan | None:
        """Take a new scan. Returns it deskewed and without movers; None for what is no scan of this
        LiDAR, or from where nobody knows. known: the map, if the robot is localized on it."""
        self.number = scan.number
        if not is_placeable(buffer, scan, len(self.lidar.beams)):
            return None
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        sweep = static = deskew(self.lidar, ranges, scan.stamp, scan.duration, buffer)
        self.sweep = sweep
        if self.tracked.stamp - sweep.stamp >= _RESET:
            self.tracked = empty_state(self.lidar, self._tracker_params)
        if sweep.stamp - self.tracked.stamp > _APART:
            may_move, trackable = np.ones(len(sweep.points), dtype=np.bool_), sweep
            if scan.edges is not None:  # the edge of a floor does not move, whatever the noise
                may_move = ~scan.edges[sweep.beams]
                trackable = sweep.part(may_move, np.where(scan.edges, math.nan, sweep.ranges))
            fixed = np.zeros(len(trackable.points), np.bool_)
            if known is not None:
                there = compose(map_odom, sweep.pose)
                fixed = on_walls(known, there, trackable.points, _ON_WALL)
            self.tracked = update_tracker(self.tracked, trackable, self._tracker_params, fixed)
            if self.tracked.of_movers.any():
                of_movers = np.zeros(len(sweep.points), dtype=np.bool_)
                of_movers[may_move] = self.tracked.of_movers
                static = self._without(sweep, of_movers)
        filtered = filtered_ranges(static.ranges, self.lidar.noise)
        points = renew(self.points, sweep.pose, self.lidar, filtered, self._keep)
        self.points = self._outside(points)
        return static

    def mark_possibly_occupied(self, places: Floats) -> None:
        """A mover out of view may occupy these places in `odom`, (p, 2): a return there next may be
        a mover."""
        if len(places):
            appeared = self.tracked.appeared
            free_space = with_possibly_occupied(appeared.free_space, places, appeared.clock)
            appeared = appeared._replace(free_space=free_space)
            self.tracked = self.tracked._replace(appeared=appeared)

    def _without(self, sweep: DeskewedScan, of_movers: NDArray[np.bool_]) -> DeskewedScan:
        ranges = sweep.ranges.copy()
        ranges[_shadow(self.lidar, sweep.points[of_movers])] = math.nan
        return sweep.part(~of_movers, ranges)

    def _outside(self, points: Floats) -> Floats:
        """Points outside of movers: points of them from before they were known to move are
        deleted."""
        for x, y, radius in self.tracked.tracks[self.tracked.tracks[:, MOVES] > 0][
            :, [TX, TY, RADIUS]
        ]:
            points = points[np.hypot(points[:, 0] - x, points[:, 1] - y) > radius + 0.05]
        return points


def _shadow(lidar: Lidar, points: Floats) -> NDArray[np.int64]:
    """The beams of body-frame points."""
    c, s = math.cos(lidar.mount.psi), math.sin(lidar.mount.psi)
    dx, dy = points[:, 0] - lidar.mount.x, points[:, 1] - lidar.mount.y
    bearing = np.arctan2(-s * dx + c * dy, c * dx + s * dy) - lidar.first
    beams = np.rint(
        np.where(bearing < -0.5 * lidar.step, bearing + 2.0 * math.pi, bearing) / lidar.step
    )
    return beams[(beams >= 0) & (beams < len(lidar.beams))].astype(np.int64)


_SIGMAS = 4.5  # a range farther from the median than so many is another object
_EDGE = 10.0  # a beam so many sigmas longer than its neighbour passes its surface


@jit
def filtered_ranges(ranges: Floats, noise: float) -> Floats:
    """Each range replaced by the median of it and two beams on either side [m].

    A range that differs from that by more than the noise is kept: a thin leg in front of a wall.
    So is one whose neighbour passes its surface, if the median is farther away: the end of a wall
    seen along its length would recede by a hand's breadth. On a wall or disc the median halves the
    scatter, and removes single outliers, which would stop the averaging over a surface. Only beams
    with a return count; with fewer than three of them the range is kept too. noise: of a range, one
    sigma [m].
    """
    n = len(ranges)
    out = ranges.copy()
    if not noise > 0.0:
        return out
    five = np.empty(5)
    for i in range(n):
        if not -math.inf < ranges[i] < math.inf:
            continue
        k = 0
        for j in range(max(i - 2, 0), min(i + 3, n)):
            r = ranges[j]
            if -math.inf < r < math.inf:
                five[k] = r
                k += 1
        if k < 3 or k % 2 == 0:
            continue  # an even number has no median beam
        middle = np.sort(five[:k])[k // 2]
        if abs(ranges[i] - middle) <= _SIGMAS * noise and not (
            middle > ranges[i] and _ends(ranges, i, _EDGE * noise)
        ):
            out[i] = middle
    return out


@jit
def _ends(ranges: Floats, i: int, jump: float) -> bool:
    """Whether a surface ends beside a beam: a neighbour is much longer."""
    n = len(ranges)
    before = i > 0 and ranges[i - 1] > ranges[i] + jump
    return before or (i + 1 < n and ranges[i + 1] > ranges[i] + jump)
