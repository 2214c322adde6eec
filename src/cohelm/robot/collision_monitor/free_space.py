"""Free-space memory: unobserved ground, in view of no beam now or before, may hold anything.

A LiDAR that does not look all round leaves some beside or behind the robot; several, what none
of them looks at. Cells of a window that moves with the sensor remember which ground has been in
view, as well as odometry allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints, Pose
from cohelm.robot.collision_monitor.carried import Carried
from cohelm.robot.collision_monitor.odometry import placed_at, seen_from
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.collision_monitor.surroundings import BESIDE, NOTHING, MonitorSurroundings
from cohelm.robot.collision_monitor.sweep import Outline, edge_distances

CELL = 0.05
"""Side of a cell of the window [m]."""
HALF = round(BESIDE / CELL) - 3
"""Cells from the sensor to where ground is forgotten, all round: 2.85 m, nearer than the distance
at which `surroundings` forgets, wherever in the outline the sensor is. The three are for its motion
in a scan and before the next look, and for half a cell. The filter forgets sooner
(`tests/pilot/test_ground_memories.py`), so it requests no ground that is refused."""
VOUCHED = 0.2
"""Margin around the turning circle within which ground counts as free where the robot is switched
on: the operator has looked; and from there it can turn and look for itself [m]."""
UNWATCHED = 1e-6
"""Error of unobserved floor [m]: none, as it is exactly there; tells it from obstacles."""
CORNER = math.sqrt(0.5) * CELL
"""From the middle of a cell to its corners; largest distance of the sensor from its cell's [m]."""
STEADY, TURNED = CELL, 0.05
"""A sensor that has moved less [m, rad] sees the same ground."""

_X, _Y = np.meshgrid(np.arange(-HALF, HALF + 1), np.arange(-HALF, HALF + 1), indexing="ij")
_DISTANCE = CELL * np.hypot(_X, _Y)
_BEARING = np.arctan2(_Y, _X).astype(np.float64)
_WIDE = np.arcsin(np.minimum(2.0 * CORNER / np.maximum(_DISTANCE, CELL), 1.0))
"""Half the angle under which a cell may be seen, wherever in the middle one the sensor is."""
_INDEX = np.column_stack((_X.ravel(), _Y.ravel())).astype(np.int64)


class FreeSpace:
    """Ground that one sensor has observed. All poses are in the odometry's frame."""

    def __init__(self, sensor: Sensor, shape: Outline, within: float, floor: bool = False) -> None:
        """within: ground farther than this beyond the turning circle does not matter yet [m].
        floor: only floor that it sees counts, within the distances at which it looks for it, and
        unknown floor is not crawled onto: there may be none."""
        self._sensor, self._own, self._floor = sensor, shape, floor
        self._error = UNWATCHED if floor else -math.inf
        self._at: Pose | None = None
        self.reshape(shape, within)
        self._known: NDArray[np.bool_] = np.zeros(_DISTANCE.shape, dtype=np.bool_)
        self._cell = (0, 0)
        self._vouched = False
        self._carried = Carried(sensor, _DISTANCE.ravel(), _BEARING.ravel()) if floor else None
        self.unknown = NOTHING
        """Unobserved ground within reach, by the newest look."""
        self.cells: Ints | None = None
        """Its cells, (n, 2), counted from the frame's origin; None before the first look."""

    def reshape(self, shape: Outline, within: float) -> None:
        """Change the robot's outline. within: as above."""
        self._at = None  # the unknown ground changes, too
        mount = self._sensor.mount
        self._shape = shape
        self._vouches = shape.reach + VOUCHED
        if self._floor:
            self._vouches = max(self._vouches, self._sensor.vouched)
        away = math.hypot(mount.x, mount.y)
        self._near = (away + shape.reach + within > _DISTANCE).ravel()
        self._kept = _DISTANCE <= CELL * HALF + min(shape.reach - away, 0.0)
        self._matters = self._kept.ravel() | self._near

    def forget(self) -> None:
        """Forget all of it: as if it were switched on anew."""
        self._known[:] = False
        self._at, self._vouched = None, False
        if self._carried is not None:
            self._carried.drives()
        self.unknown, self.cells = NOTHING, None

    def look(
        self, ranges: Floats, pose: Pose, turned: float, seen: float
    ) -> MonitorSurroundings | None:
        """Take a scan from a pose; unknown ground within reach, or None where that is unchanged.

        turned: angle by which the robot turned during the scan [rad]. seen: time of that [s].
        """
        sensor, mount = self._sensor, self._sensor.mount
        x, y = placed_at(mount.x, mount.y, pose)
        psi = pose.psi + mount.psi
        reach = ranges
        if self._floor:
            beside = np.minimum(np.roll(ranges, 1), np.roll(ranges, -1))
            reach = np.where(np.isnan(ranges), beside, ranges)  # floor is seen by several beams
        carried, before = self._carried, self._at
        if (
            before is not None
            and math.hypot(x - before.x, y - before.y) < STEADY
            and abs(psi - before.psi) < TURNED
        ):
            known, about = self._known.ravel(), partial(self._about, pose)
            if carried is None or not carried.look(known, about, reach, psi, seen):
                return None
        else:
            self._at = Pose(x, y, psi)
            self._move(round(x / CELL), round(y / CELL))
            if carried is not None:
                carried.drives()
        first = math.remainder(psi + sensor.bearings[0], 2.0 * math.pi)
        span = float(sensor.bearings[-1] - sensor.bearings[0])
        new = np.flatnonzero(self._matters & ~self._known.ravel())  # what is known stays known
        distance = _DISTANCE.ravel()[new]
        along = _BEARING.ravel()[new] - first  # from the first beam
        along[along < 0.0] += 2.0 * math.pi
        wide = 0.5 * abs(turned) + (0.0 if self._floor else _WIDE.ravel()[new])
        looks = (along >= wide) & (along <= span - wide)
        beams = np.minimum((along / sensor.step + 0.5).astype(np.intp), len(ranges) - 1)
        if self._floor:
            watched = (distance >= sensor.floor_from) & (distance <= sensor.floor_to)
            none_seen = new[looks & ~(reach[beams] > sensor.range_min)]
            looks &= watched & (reach[beams] > distance)  # not for NaN
            seen_free = looks
        else:
            none_seen = new[:0]
            seen_free = looks & (reach[beams] > distance - CELL)
        known = self._known.ravel()
        known[new[seen_free & self._kept.ravel()[new]]] = True
        if not self._vouched:
            self._vouch(pose, none_seen)
        cells = _INDEX[new[~(looks | known[new]) & self._near[new]]] + np.array(self._cell)
        points: Floats = CELL * cells.astype(np.float64)
        at = seen_from(points, pose)
        outside, own = (edge_distances(at, one).max(axis=1) for one in (self._shape, self._own))
        # The robot itself is there, and stands on it; an added load hangs over anything.
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

    def _vouch(self, pose: Pose, excluded: Ints) -> None:
        """Mark the ground about a pose as known, without these cells."""
        self._vouched = True
        near = self._about(pose)
        near.ravel()[excluded] = False
        self._known |= near

    def _about(self, pose: Pose) -> NDArray[np.bool_]:
        """The ground about a pose where a robot is switched on, or put down."""
        x, y = (CELL * (c + k) for c, k in zip(self._cell, (_X, _Y), strict=True))
        return np.asarray(np.hypot(x - pose.x, y - pose.y) < self._vouches)

    def _move(self, i: int, j: int) -> None:
        """Center the window on a cell; ground that stays in it stays known."""
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
    """Ground that no sensor looks at or has looked at before; sensors that have not looked yet do
    not count."""
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
    """For a row that moved by some cells: where its old contents are now, and where they were."""
    return slice(max(-by, 0), side - max(by, 0)), slice(max(by, 0), side - max(-by, 0))
