"""Unobserved space: out of view now, and never in view or possibly occupied by a mover since.

LiDARs that do not look all round leave some beside or behind the robot. Its border is reported as
static points, so that the robot does not back into ground that it has never seen, or turn into a
mover that has just gone behind it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.perceive.space.assumed import ASSUMED_FREE, cut_surfaces, turning_ground
from cohelm.perceive.space.cell_window import CELL
from cohelm.perceive.space.observed_cells import (
    ObservedCells,
    approaching,
    assumed_free,
    assumed_gap,
    enlarged,
    extent,
    no_cells,
    occupied,
    possibly_occupied,
    unobserved_border,
    with_scan,
    without_covered,
)
from cohelm.perceive.track.departed import HVX, HVY
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.sensors import Lidar, vouched_floor

_MOVED, _TURNED = 0.05, 0.05  # a LiDAR that moved less sees the same surfaces [m, rad]


class _Ground:
    """The ground that LiDARs have observed around a robot."""

    def __init__(
        self, outline: Floats, lidars: Sequence[Lidar], stopping: float, free: float = 0.0
    ) -> None:
        """outline: (k, 2) of the robot [m]. stopping: distance in which it stops from full speed.
        free: least radius of the ground assumed free where it is switched on [m]."""
        self._lidars, self._stopping, self._least = tuple(lidars), stopping, free
        self._cells: ObservedCells | None = None
        self.reshape(outline)

    def reshape(self, outline: Floats) -> None:
        """Use another outline from the next sweep on."""
        self._outline = outline
        reach = farthest_corner(outline)
        circle = max(reach + ASSUMED_FREE, self._least)
        self._extent = extent(self._lidars, reach, circle, self._stopping)
        if self._cells is not None:
            self._cells = enlarged(self._cells, self._extent.side)


class UnobservedSpace(_Ground):
    """Unobserved space of a robot none of whose LiDARs looks all round."""

    def __init__(self, outline: Floats, lidars: Sequence[Lidar], stopping: float) -> None:
        """outline: (k, 2) of the robot [m]. lidars: all of them. stopping: distance in which it
        stops from full speed [m]."""
        super().__init__(outline, lidars, stopping)
        self._stamp = -math.inf
        self._way = 0.0  # that a mover can have gone, of those now out of view [m]
        self._looked: dict[Pose, Pose] = {}  # where a LiDAR was, by its mount, for its surfaces

    def points(
        self, sweep: DeskewedScan, sweeps: tuple[DeskewedScan, ...], out_of_view: Floats,
        fastest: float,
    ) -> Floats:  # fmt: skip
        """The border of unobserved ground after a sweep, (p, 2), in `odom`.

        sweeps: the newest of each LiDAR, this one too. out_of_view: movers, as in
        `track.departed`. fastest: assumed largest speed, unless observed faster [m/s].
        """
        kept, seen, far, _ = self._extent
        pose = sweep.pose
        cells = self._cells
        if cells is None:
            free = turning_ground(self._outline, self._lidars)
            cells = assumed_free(no_cells(self._extent.side), pose, self._outline, free)
        cells = with_scan(cells, sweep, kept, seen)
        if self._moved(sweep.lidar.mount, sweep.sensor):
            surfaces = cut_surfaces(sweep.lidar, sweep.ranges, sweep.sensor)
            cells = without_covered(cells, surfaces, sweeps, pose, self._outline)
        dt, self._stamp = min(max(sweep.stamp - self._stamp, 0.0), 1.0), sweep.stamp
        near = approaching(out_of_view, pose, far)
        before = self._way if len(near) else 0.0
        speed = float(np.hypot(near[:, HVX], near[:, HVY]).max(initial=fastest))
        self._way = before + speed * dt
        steps = math.ceil(before / CELL), math.ceil(self._way / CELL)
        self._cells = occupied(cells, sweeps, near, pose, self._outline, steps, kept)
        return unobserved_border(self._cells, sweeps, pose, self._outline, far)

    def _moved(self, mount: Pose, sensor: Pose) -> bool:
        """Whether a LiDAR moved since its surfaces were last taken; remembers where it is now."""
        before = self._looked.get(mount)
        if (
            before is not None
            and math.hypot(sensor.x - before.x, sensor.y - before.y) < _MOVED
            and abs(math.remainder(sensor.psi - before.psi, 2.0 * math.pi)) < _TURNED
        ):
            return False
        self._looked[mount] = sensor
        return True

    def assumed_gap(self, pose: Pose) -> float:
        """Distance from ground that is only assumed free [m], as of the last sweep."""
        return math.inf if self._cells is None else assumed_gap(self._cells, pose, self._outline)

    def possibly_occupied(self, pose: Pose) -> Floats:
        """Places that movers out of view may occupy near a pose, (p, 2), in `odom`, as of the last
        sweep."""
        if self._cells is None:
            return np.empty((0, 2))
        return possibly_occupied(self._cells, pose, self._extent.kept)


class UnobservedFloor(_Ground):
    """The floor that the floor sensors of a robot have not seen.

    Only those count, and only where they see it: a planar LiDAR sees no stair. Floor beneath a new
    outline is not reported, and not assumed observed: a load may overhang anything.
    """

    def __init__(self, outline: Floats, floor_lidars: Sequence[Lidar], stopping: float) -> None:
        """outline: (k, 2) of the robot [m]. floor_lidars: the sensors that see the floor. stopping:
        distance in which it stops from full speed [m]."""
        least = farthest_corner(outline) + ASSUMED_FREE
        free = max(vouched_floor(lidar, outline, least) for lidar in floor_lidars)
        super().__init__(outline, floor_lidars, stopping, free)

    def points(self, sweep: DeskewedScan) -> Floats:
        """The border of unobserved floor after a sweep of one of these, (p, 2), in `odom`."""
        kept, seen, far, _ = self._extent
        pose, before = sweep.pose, self._cells
        if before is None:
            before = no_cells(self._extent.side)
            before = assumed_free(before, pose, self._outline, self._least)
        self._cells = with_scan(before, sweep, kept, seen, True)
        return unobserved_border(self._cells, (sweep,), pose, self._outline, far, True)
