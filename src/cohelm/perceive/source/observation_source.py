"""What one LiDAR has shown: points that stand, and what moves. Each forgets only what it sees gone
itself, as another may look over it or past it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.clusters import Look, looked
from cohelm.perceive.scan.deskew import DeskewedScan, sweep
from cohelm.perceive.scan.odometry_buffer import pose_at
from cohelm.perceive.scan.range_filter import steadied
from cohelm.perceive.space.free_space_memory import doubted
from cohelm.perceive.space.scan_memory import ScanMemoryParams, renew
from cohelm.perceive.track.track import MOVES, RADIUS, TX, TY
from cohelm.perceive.track.tracker import NONE, TrackerParams, follow
from cohelm.robot.port import Scan
from cohelm.robot.sensors import Lidar

NOTHING: Floats = np.empty((0, 2))
_APART = 0.06  # sweeps nearer in time are not asked who moves: too little has happened [s]

OnMap = Callable[[DeskewedScan, Pose], NDArray[np.bool_] | None]
"""Which points of a sweep from an `odom` pose are on the map's walls; None where nobody knows."""


class ObservationSource:
    """One LiDAR and its memory."""

    def __init__(
        self, lidar: Lidar, sensor: str, remembering: ScanMemoryParams, watching: TrackerParams
    ) -> None:
        """sensor: as its scans name it."""
        self.lidar, self.sensor = lidar, sensor
        self._care, self._watching = remembering, watching
        self.points = NOTHING
        """Standing things, (p, 2), in `odom` [m]."""
        self.movers = NONE
        self.look: Look | None = None
        """The newest sweep."""
        self.stamp = -math.inf
        """Of its last beam [s]."""
        self._number: int | None = None

    def new(self, scan: Scan) -> bool:
        """Whether it is another one than the last."""
        return scan.number != self._number

    def take(self, scan: Scan, trail: Floats, on_map: OnMap) -> tuple[DeskewedScan, Pose] | None:
        """A new scan: its sweep without what moves, and the `odom` pose that it is from; None for
        what is no scan of this LiDAR."""
        self._number = scan.number
        if len(scan.ranges) != len(self.lidar.beams) or not math.isfinite(scan.stamp):
            return None
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        seen = whole = sweep(self.lidar, ranges, scan.stamp, scan.duration, trail)
        self.stamp = scan.stamp + scan.duration
        pose = pose_at(trail, self.stamp)
        if self.stamp - self.movers.stamp > _APART:
            may_move = np.ones(len(seen.points), dtype=np.bool_)
            things = seen
            if scan.edges is not None:  # no edge of a floor moves, whatever noise makes of it
                may_move = ~scan.edges[seen.beams]
                ranges = np.where(scan.edges, math.nan, seen.ranges)
                things = DeskewedScan(
                    seen.points[may_move], seen.beams[may_move], ranges, seen.duration
                )
            self.movers = follow(
                self.movers, self.lidar, things, pose, self.stamp, self._watching,
                on_map(things, pose),
            )  # fmt: skip
            if self.movers.mine.any():
                may_move[may_move] = self.movers.mine
                seen = self._without(seen, may_move)
        calm = steadied(seen.ranges, self.lidar.noise)
        points = renew(self.points, pose, self.lidar, calm, self._care)
        self.points = self._outside(points)
        self.look = looked(self.lidar, whole, pose, self.stamp)
        return seen, pose

    def doubt(self, places: Floats) -> None:
        """Somebody may be at these places in `odom`, (p, 2), where nothing looks: whoever is seen
        there next may move."""
        if len(places):
            ground = doubted(self.movers.ground, places, self.movers.worn)
            self.movers = self.movers._replace(ground=ground)

    def _without(self, seen: DeskewedScan, mine: NDArray[np.bool_]) -> DeskewedScan:
        """The sweep without the points of movers: they tell nothing about what stands."""
        ranges = seen.ranges.copy()
        ranges[_shadow(self.lidar, seen.points[mine])] = math.nan
        return DeskewedScan(seen.points[~mine], seen.beams[~mine], ranges, seen.duration)

    def _outside(self, points: Floats) -> Floats:
        """Points that no mover covers: what was remembered of it before it was known to move."""
        for x, y, radius in self.movers.tracks[self.movers.tracks[:, MOVES] > 0][
            :, [TX, TY, RADIUS]
        ]:
            points = points[np.hypot(points[:, 0] - x, points[:, 1] - y) > radius + 0.05]
        return points


def _shadow(lidar: Lidar, points: Floats) -> NDArray[np.int64]:
    """The beams that body-frame points are seen in."""
    c, s = math.cos(lidar.mount.psi), math.sin(lidar.mount.psi)
    dx, dy = points[:, 0] - lidar.mount.x, points[:, 1] - lidar.mount.y
    bearing = np.arctan2(-s * dx + c * dy, c * dx + s * dy) - lidar.first
    beams = np.rint(
        np.where(bearing < -0.5 * lidar.step, bearing + 2.0 * math.pi, bearing) / lidar.step
    )
    return beams[(beams >= 0) & (beams < len(lidar.beams))].astype(np.int64)
