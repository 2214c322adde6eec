"""Ground that no beam looks at, and that none has looked at before: it may hold anything.

A LiDAR that does not look all round leaves some beside or behind the robot; of several, what none
of them looks at. Cells of a window that
moves with the sensor remember which ground has been in view, as far as odometry is right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints, Pose
from cohelm.robot.collision_monitor.odometry import placed_at, seen_from
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.collision_monitor.surroundings import BESIDE, NOTHING, MonitorSurroundings
from cohelm.robot.collision_monitor.sweep import Outline, edge_distances

CELL = 0.05
"""Of the window [m]."""
HALF = round(BESIDE / CELL) - 3
"""Cells from the sensor to where ground is forgotten, all round: 2.85 m, so that what
`surroundings` forgets as too far away is farther, wherever in the outline the sensor is. The three
are for how far it moves in a scan and before the next look, and for half a cell. The filter forgets
sooner (`tests/pilot/test_ground_memories.py`), so it asks for no ground that is refused."""
VOUCHED = 0.2
"""So far beyond its turning circle, ground is taken to be free where the robot is switched on: who
does that has looked; and from there it can turn and look for itself [m]."""
UNWATCHED = 1e-6
"""Error of floor that nobody has seen [m]: it stands where it begins, and is told from things."""
CORNER = math.sqrt(0.5) * CELL
"""From the middle of a cell to its corners, and at most from the sensor to that of its cell [m]."""
STEADY, TURNED = CELL, 0.05
"""A sensor that has moved less [m, rad] sees the same ground."""

_X, _Y = np.meshgrid(np.arange(-HALF, HALF + 1), np.arange(-HALF, HALF + 1), indexing="ij")
_FAR = CELL * np.hypot(_X, _Y)
_BEARING = np.arctan2(_Y, _X).astype(np.float64)
_WIDE = np.arcsin(np.minimum(2.0 * CORNER / np.maximum(_FAR, CELL), 1.0))
"""Half the angle under which a cell may be seen, wherever in the middle one the sensor is."""
_INDEX = np.column_stack((_X.ravel(), _Y.ravel())).astype(np.int64)


class FreeSpace:
    """What one sensor has looked at. All poses are of the odometry's frame."""

    def __init__(self, sensor: Sensor, shape: Outline, within: float, floor: bool = False) -> None:
        """within: ground farther than this beyond the turning circle can not matter yet [m].
        floor: only the floor that it sees counts, from where to where it looks for that, and what
        is unknown is not for crawling: there may be none."""
        self._sensor, self._own, self._floor = sensor, shape, floor
        self._error = UNWATCHED if floor else -math.inf
        self._at: Pose | None = None
        self.reshape(shape, within)
        self._known: NDArray[np.bool_] = np.zeros(_FAR.shape, dtype=np.bool_)
        self._cell = (0, 0)
        self._vouched = False
        self.unknown = NOTHING
        """What it has not looked at within reach, by the newest look."""
        self.cells: Ints | None = None
        """The cells of that, (n, 2), counted from the frame's origin; None before the first look.
        """

    def reshape(self, shape: Outline, within: float) -> None:
        """The robot has another outline from now on. within: as above."""
        self._at = None  # what is unknown is another ground from now on
        mount = self._sensor.mount
        self._shape = shape
        self._vouches = shape.reach + VOUCHED
        if self._floor:
            self._vouches = max(self._vouches, self._sensor.vouched)
        away = math.hypot(mount.x, mount.y)
        self._near = (away + shape.reach + within > _FAR).ravel()
        self._kept = _FAR <= CELL * HALF + min(shape.reach - away, 0.0)
        self._matters = self._kept.ravel() | self._near

    def forget(self) -> None:
        """All of it: as if it were switched on anew."""
        self._known[:] = False
        self._at, self._vouched = None, False
        self.unknown, self.cells = NOTHING, None

    def look(
        self, ranges: Floats, pose: Pose, turned: float, seen: float
    ) -> MonitorSurroundings | None:
        """After a scan from a pose: what is unknown within reach, or None where that is as before.

        turned: by how much the robot turned during the scan [rad]. seen: when that was [s].
        """
        sensor, mount = self._sensor, self._sensor.mount
        x, y = placed_at(mount.x, mount.y, pose)
        psi = pose.psi + mount.psi
        before = self._at
        if (
            before is not None
            and math.hypot(x - before.x, y - before.y) < STEADY
            and abs(psi - before.psi) < TURNED
        ):
            return None
        self._at = Pose(x, y, psi)
        self._move(round(x / CELL), round(y / CELL))
        first = math.remainder(psi + sensor.bearings[0], 2.0 * math.pi)
        span = float(sensor.bearings[-1] - sensor.bearings[0])
        new = np.flatnonzero(self._matters & ~self._known.ravel())  # what is known stays known
        far = _FAR.ravel()[new]
        along = _BEARING.ravel()[new] - first  # from the first beam
        along[along < 0.0] += 2.0 * math.pi
        wide = 0.5 * abs(turned) + (0.0 if self._floor else _WIDE.ravel()[new])
        looks = (along >= wide) & (along <= span - wide)
        beams = np.minimum((along / sensor.step + 0.5).astype(np.intp), len(ranges) - 1)
        if self._floor:
            watched = (far >= sensor.floor_from) & (far <= sensor.floor_to)
            beside = np.minimum(np.roll(ranges, 1), np.roll(ranges, -1))
            reach = np.where(np.isnan(ranges), beside, ranges)  # floor is seen by several beams
            looks &= watched & (reach[beams] > far)  # not for NaN
            seen_free = looks
        else:
            seen_free = looks & (ranges[beams] > far - CELL)
        known = self._known.ravel()
        known[new[seen_free & self._kept.ravel()[new]]] = True
        if not self._vouched:
            self._vouch(pose)
        cells = _INDEX[new[~(looks | known[new]) & self._near[new]]] + np.array(self._cell)
        points: Floats = CELL * cells.astype(np.float64)
        at = seen_from(points, pose)
        outside, own = (edge_distances(at, one).max(axis=1) for one in (self._shape, self._own))
        # The robot itself is there, and stands on it; a load that it was given hangs over anything.
        stood_on = np.maximum(outside, own) <= -CORNER
        under = (outside <= -CORNER) | ((outside <= CORNER) & (own > CORNER))
        self._known[tuple((cells[stood_on] + HALF - np.array(self._cell)).T)] = True
        unknown: Floats = points[~under]
        n = len(unknown)
        self.cells = cells[~under]
        self.unknown = MonitorSurroundings(
            unknown, np.full(n, self._error), np.full(n, CORNER), np.full(n, seen)
        )  # fmt: skip
        return self.unknown

    def _vouch(self, pose: Pose) -> None:
        """For the ground about a pose."""
        self._vouched = True
        x, y = (CELL * (c + k) for c, k in zip(self._cell, (_X, _Y), strict=True))
        self._known |= np.hypot(x - pose.x, y - pose.y) < self._vouches

    def _move(self, i: int, j: int) -> None:
        """The window about a cell: what was in it and still is stays known."""
        di, dj = i - self._cell[0], j - self._cell[1]
        self._cell = i, j
        side = 2 * HALF + 1
        known = np.zeros_like(self._known)
        if abs(di) < side and abs(dj) < side:
            to_i, from_i = _overlap(di, side)
            to_j, from_j = _overlap(dj, side)
            known[to_i, to_j] = self._known[from_i, from_j]
        self._known = known & self._kept


def unknown_to_all(spaces: Sequence[FreeSpace]) -> MonitorSurroundings:
    """Ground that no sensor looks at or has looked at before; of those that have not looked yet,
    nothing is asked."""
    looked = [space for space in spaces if space.cells is not None]
    if not looked:
        return NOTHING
    first, *others = looked
    found, own = first.unknown, _keys(first)
    for other in others:
        both = np.isin(own, _keys(other))
        found, own = MonitorSurroundings(*(column[both] for column in found)), own[both]
    return found


def _keys(space: FreeSpace) -> Ints:
    """A number for each of its cells."""
    cells = space.cells
    return np.empty(0, np.int64) if cells is None else (cells[:, 0] << 32) + cells[:, 1]


def _overlap(by: int, side: int) -> tuple[slice, slice]:
    """Where of a row that moved by so many cells is what it had, and where that was."""
    return slice(max(-by, 0), side - max(by, 0)), slice(max(by, 0), side - max(-by, 0))
