"""Unobserved space: out of view now, and never in view or possibly occupied by a mover since.

LiDARs that do not look all round leave some beside or behind the robot. Its border is reported as
static points, so that the robot does not back into ground that it has never seen, or turn into a
mover that has just gone behind it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.scan.deskew import DeskewedScan, beam_at
from cohelm.perceive.space.cell_window import CELL, NEVER, SIDE, cell, holds, nowhere
from cohelm.perceive.space.free_space_memory import NEAR
from cohelm.perceive.track.departed import HVX, HVY, HX, HY, REACH, UNSEEN, in_view
from cohelm.robot.clearance import disc_clearance
from cohelm.robot.sensors import Lidar, vouched_floor

ASSUMED_FREE = 0.2
"""Ground is assumed free so far beyond the turning circle where the robot is switched on, so that
it can turn and look [m]."""

KEPT = 2.7
"""Ground is remembered up to this distance from the LiDAR: less than by the collision monitor
(`free_space`, 2.85 m and half a step), which would stop the robot on it [m]. Of a robot that
reaches farther from its LiDAR it is remembered farther, as by the monitor."""

_ARRIVAL_TIME = 4.0  # a mover that left the view farther away matters if it arrives within it [s]
_APART = 0.03  # minimum distance of a mover out of view from the outline [m]
_JUST_LEFT = 0.25  # a mover seen so recently is where it is predicted [s]
_REPORTED = 1.0  # beyond the turning circle, within which the border is reported, at least [m]


class View(NamedTuple):
    """The view of a LiDAR: its beams, and its pose in `odom` at its newest sweep."""

    lidar: Lidar
    sensor: Pose


class ObservedCells(NamedTuple):
    """A window of cells that have been in view, see `perceive.space.cell_window`.

    occupied: (n, n), whether a mover that left the view may be in a cell.
    """

    which: Ints
    occupied: NDArray[np.bool_]


class Extent(NamedTuple):
    """How far ground matters and is remembered."""

    kept: float
    """From each LiDAR [m]."""
    seen: float
    """From each LiDAR, up to which ground in its view becomes known [m]."""
    reported: float
    """From the body's origin, within which the border is reported [m]."""
    side: int
    """Cells along one side of a window that holds all of that, wherever the LiDARs are."""


def extent(lidars: Sequence[Lidar], reach: float, free: float, stopping: float) -> Extent:
    """The extent for a robot. reach: of its outline. free: radius of the ground that is assumed
    free where it is switched on. stopping: distance in which it stops from full speed [m]."""
    away = max(math.hypot(one.mount.x, one.mount.y) for one in lidars)
    kept = max(KEPT, away + free + _REPORTED)
    # Beyond what is kept nothing borders on observed ground.
    reported = reach + min(max(_REPORTED, stopping), kept + away + CELL)
    side = max(SIDE, 2 * math.ceil((kept + away) / CELL) + 2)
    return Extent(kept, kept - (KEPT - NEAR), reported, side)


def no_cells(side: int = SIDE) -> ObservedCells:
    """No cell has been in view."""
    return ObservedCells(nowhere(side), np.zeros((side, side), np.bool_))


def enlarged(cells: ObservedCells, side: int) -> ObservedCells:
    """The same cells in a window of at least so many to a side."""
    if side <= len(cells.which):
        return cells
    made, held = no_cells(side), cells.which[..., 0] != NEVER
    i, j = cells.which[held].T
    made.which[i % side, j % side] = cells.which[held]
    made.occupied[i % side, j % side] = cells.occupied[held]
    return made


@jit
def assumed_free(cells: ObservedCells, x: float, y: float, radius: float) -> ObservedCells:
    """With the ground around an `odom` point assumed observed."""
    which, occupied = cells.which.copy(), cells.occupied.copy()
    low_x, low_y = cell(x - radius), cell(y - radius)
    wide = math.ceil(2.0 * radius / CELL) + 1
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if math.hypot((i + 0.5) * CELL - x, (j + 0.5) * CELL - y) < radius:
                _set_observed(which, occupied, i, j)
    return ObservedCells(which, occupied)


@jit
def with_scan(
    cells: ObservedCells, lidar: Lidar, sweep: DeskewedScan, kept: float, seen: float,
    floor: bool = False,
) -> ObservedCells:  # fmt: skip
    """With the ground in view of a sweep, up to its returns; or with the floor that it sees, within
    the sensor's floor range and before its returns.

    kept: cells farther than this from the LiDAR are forgotten [m]. seen: and those farther than
    this not seen [m]."""
    which, occupied = cells.which.copy(), cells.occupied.copy()
    sensor, n, side = sweep.sensor, len(sweep.ranges), len(cells.which)
    _forget(which, sensor, kept)
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = cell(sensor.x - seen), cell(sensor.y - seen)
    wide = math.ceil(2.0 * seen / CELL)
    for i in range(low_x, low_x + wide):
        wx = (i + 0.5) * CELL - sensor.x
        for j in range(low_y, low_y + wide):
            wy = (j + 0.5) * CELL - sensor.y
            far = math.hypot(wx, wy)
            if far > seen or (holds(which, i, j) and not occupied[i % side, j % side]):
                continue
            if floor and not lidar.floor_from <= far <= lidar.floor_to:
                continue
            beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
            if not 0 <= beam < n:
                continue
            reach = sweep.ranges[beam]
            # NaN of an obstacle; the floor beside it was seen
            if floor and math.isnan(reach) and 0 < beam < n - 1:
                reach = min(sweep.ranges[beam - 1], sweep.ranges[beam + 1])
            if reach > (far if floor else far - CELL):
                _set_observed(which, occupied, i, j)
    return ObservedCells(which, occupied)


@jit_inline
def _forget(which: Ints, sensor: Pose, kept: float) -> None:
    for a in range(len(which)):
        for b in range(len(which)):
            wx = (which[a, b, 0] + 0.5) * CELL - sensor.x
            wy = (which[a, b, 1] + 0.5) * CELL - sensor.y
            if wx * wx + wy * wy > kept * kept:
                which[a, b, 0] = NEVER


@jit_inline
def _in_view(views: tuple[View, ...], x: float, y: float) -> bool:
    """Whether any LiDAR has a beam towards an `odom` point, occluded or not."""
    seen = False
    for k in range(len(views)):
        seen = seen or in_view(views[k].lidar, views[k].sensor, x, y)
    return seen


@jit
def approaching(out_of_view: Floats, pose: Pose, far: float) -> Floats:
    """Movers out of view, see `track.departed`, that are within `far` [m] of a pose, or were
    heading there when they left the view."""
    near = np.zeros(len(out_of_view), np.bool_)
    for k in range(len(out_of_view)):
        vx, vy, ago = out_of_view[k, HVX], out_of_view[k, HVY], out_of_view[k, UNSEEN]
        wx, wy = out_of_view[k, HX] - ago * vx - pose.x, out_of_view[k, HY] - ago * vy - pose.y
        t = min(max(-(wx * vx + wy * vy) / max(vx * vx + vy * vy, 1e-6), 0.0), _ARRIVAL_TIME)
        near[k] = math.hypot(wx + t * vx, wy + t * vy) < far
    return out_of_view[near]


@jit
def occupied(
    cells: ObservedCells, views: tuple[View, ...], out_of_view: Floats, pose: Pose, outline: Floats,
    fastest: float, dt: float, kept: float,
) -> ObservedCells:  # fmt: skip
    """With the cells that movers out of view may occupy dt [s] later: where they left the view, and
    what they can reach from there, or from beyond the known cells, over unobserved cells within
    the bounds of their predicted tracks.

    fastest: assumed largest speed, unless one was observed to be faster [m/s]. kept: within this of
    the body's origin [m].
    """
    before, side = cells.occupied, len(cells.which)
    after = np.zeros_like(before)
    if not len(out_of_view):
        return ObservedCells(cells.which, after)
    speed, any_away = fastest, False
    for k in range(len(out_of_view)):
        any_away = any_away or out_of_view[k, UNSEEN] >= _JUST_LEFT
        speed = max(speed, math.hypot(out_of_view[k, HVX], out_of_view[k, HVY]))
    steps = math.ceil(speed * dt / CELL)
    low_x, low_y = cell(pose.x - kept), cell(pose.y - kept)
    wide = math.ceil(2.0 * kept / CELL) + 1
    reachable, filled = np.zeros((wide, wide), np.bool_), np.zeros((wide, wide), np.bool_)
    for a in range(wide):
        for b in range(wide):
            i, j = low_x + a, low_y + b
            x, y = (i + 0.5) * CELL, (j + 0.5) * CELL
            if _in_view(views, x, y) or disc_clearance(pose, outline, x, y, 0.0) < _APART:
                continue
            for k in range(len(out_of_view)):
                away = math.hypot(x - out_of_view[k, HX], y - out_of_view[k, HY])
                if away < out_of_view[k, REACH]:
                    reachable[a, b] = True
                    filled[a, b] |= out_of_view[k, UNSEEN] < _JUST_LEFT
            filled[a, b] |= before[i % side, j % side] or (
                any_away and not holds(cells.which, i, j)
            )
            filled[a, b] &= reachable[a, b]
    for _ in range(steps):
        previous = filled.copy()
        for a in range(1, wide - 1):
            for b in range(1, wide - 1):
                if reachable[a, b] and not previous[a, b]:
                    filled[a, b] = (
                        previous[a - 1, b] or previous[a + 1, b] or previous[a,
                        b - 1] or previous[a, b + 1]
                        or previous[a - 1, b - 1] or previous[a - 1, b + 1]
                        or previous[a + 1, b - 1] or previous[a + 1, b + 1]
                    )  # fmt: skip
    for a in range(wide):
        for b in range(wide):
            after[(low_x + a) % side, (low_y + b) % side] = filled[a, b]
    return ObservedCells(cells.which, after)


@jit
def possibly_occupied(cells: ObservedCells, pose: Pose, kept: float) -> Floats:
    """Centres of the cells that movers out of view may occupy near a pose, (p, 2), in `odom`."""
    side = len(cells.which)
    low_x, low_y = cell(pose.x - kept), cell(pose.y - kept)
    wide = math.ceil(2.0 * kept / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if cells.occupied[i % side, j % side]:
                out[k, 0], out[k, 1] = (i + 0.5) * CELL, (j + 0.5) * CELL
                k += 1
    return out[:k].copy()


@jit
def unobserved_border(
    cells: ObservedCells, views: tuple[View, ...], pose: Pose, outline: Floats, far: float,
    floor: bool = False,
) -> Floats:  # fmt: skip
    """The border of unobserved ground, or floor, (p, 2), in `odom`, within `far` [m] of a robot
    with this outline at this pose: cells beside an observed one, or beside the robot itself."""
    low_x, low_y = cell(pose.x - far), cell(pose.y - far)
    wide = math.ceil(2.0 * far / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        px = (i + 0.5) * CELL
        for j in range(low_y, low_y + wide):
            py = (j + 0.5) * CELL
            if math.hypot(px - pose.x, py - pose.y) > far or _is_free(cells, i, j):
                continue
            if not floor and _in_view(views, px, py):
                continue  # occluded by a return
            clearance = disc_clearance(pose, outline, px, py, 0.0)
            if clearance <= 0.0:
                continue
            if (
                clearance < _APART + 1.5 * CELL
                or _is_free(cells, i - 1, j) or _is_free(cells, i + 1, j)
                or _is_free(cells, i, j - 1) or _is_free(cells, i, j + 1)
            ):  # fmt: skip
                out[k, 0], out[k, 1] = px, py
                k += 1
    return out[:k].copy()


@jit_inline
def _set_observed(which: Ints, occupied: NDArray[np.bool_], i: int, j: int) -> None:
    a, b = i % len(which), j % len(which)
    which[a, b, 0], which[a, b, 1] = i, j
    occupied[a, b] = False


@jit_inline
def _is_free(cells: ObservedCells, i: int, j: int) -> bool:
    side = len(cells.which)
    return holds(cells.which, i, j) and not cells.occupied[i % side, j % side]


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
        reach = float(np.hypot(*outline.T).max())
        self._free = max(reach + ASSUMED_FREE, self._least)
        self._extent = extent(self._lidars, reach, self._free, self._stopping)
        if self._cells is not None:
            self._cells = enlarged(self._cells, self._extent.side)

    def _before(self, pose: Pose, free: float) -> ObservedCells:
        """The cells before a sweep. free: radius assumed free before the first one [m]."""
        if self._cells is not None:
            return self._cells
        return assumed_free(no_cells(self._extent.side), pose.x, pose.y, free)


class UnobservedSpace(_Ground):
    """Unobserved space of a robot none of whose LiDARs looks all round."""

    def __init__(self, outline: Floats, lidars: Sequence[Lidar], stopping: float) -> None:
        """outline: (k, 2) of the robot [m]. lidars: all of them. stopping: distance in which it
        stops from full speed [m]."""
        super().__init__(outline, lidars, stopping)
        self._stamp = -math.inf

    def points(
        self, lidar: Lidar, sweep: DeskewedScan, sweeps: list[tuple[Lidar, DeskewedScan]],
        out_of_view: Floats, fastest: float,
    ) -> Floats:  # fmt: skip
        """The border of unobserved ground after a sweep, (p, 2), in `odom`.

        sweeps: each LiDAR with its newest sweep, this one too. out_of_view: movers, as in
        `track.departed`. fastest: assumed largest speed, unless observed faster [m/s].
        """
        kept, seen, far, _ = self._extent
        pose = sweep.pose
        views = tuple(View(its_lidar, its.sensor) for its_lidar, its in sweeps)
        cells = with_scan(self._before(pose, self._free), lidar, sweep, kept, seen)
        dt, self._stamp = min(max(sweep.stamp - self._stamp, 0.0), 1.0), sweep.stamp
        near = approaching(out_of_view, pose, far)
        self._cells = occupied(cells, views, near, pose, self._outline, fastest, dt, kept)
        return unobserved_border(self._cells, views, pose, self._outline, far)

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
        least = float(np.hypot(*outline.T).max()) + ASSUMED_FREE
        free = max(vouched_floor(lidar, outline, least) for lidar in floor_lidars)
        super().__init__(outline, floor_lidars, stopping, free)

    def points(self, lidar: Lidar, sweep: DeskewedScan) -> Floats:
        """The border of unobserved floor after a sweep of one of these, (p, 2), in `odom`."""
        kept, seen, far, _ = self._extent
        before = self._before(sweep.pose, self._least)
        self._cells = with_scan(before, lidar, sweep, kept, seen, True)
        view = (View(lidar, sweep.sensor),)
        return unobserved_border(self._cells, view, sweep.pose, self._outline, far, True)
