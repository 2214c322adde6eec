"""Free-space memory: unobserved ground, in view of no beam now or before, may hold anything.

A LiDAR that does not look all round leaves some beside or behind the robot; several, what none
of them looks at. Cells of a window that moves with the sensor remember which ground has been in
view, as well as odometry allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints, Pose
from cohelm.robot.collision_monitor.carried import Carried
from cohelm.robot.collision_monitor.odometry import placed_at, seen_from
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.collision_monitor.surroundings import BESIDE, NOTHING, MonitorSurroundings, joined
from cohelm.robot.collision_monitor.sweep import Outline, edge_distances
from cohelm.robot.collision_monitor.switched_on import VOUCHED, surface, turning_radius

CELL = 0.05
"""Side of a cell of the window [m]."""
_MOTION = 3
"""Cells that ground is forgotten nearer than returns are: for the sensor's motion in a scan and
before the next look, and for half a cell."""
HALF = round(BESIDE / CELL) - _MOTION
"""Cells from the sensor to where ground is forgotten, all round: 2.85 m, nearer than the distance
at which `surroundings` forgets, wherever in the outline the sensor is. The filter forgets sooner
(`tests/pilot/test_ground_memories.py`), so it requests no ground that is refused. Of a robot that
reaches farther from its sensor, both are remembered farther."""
ROOM = 1.0 + _MOTION * CELL
"""Ground is remembered at least so far beyond the turning circle and VOUCHED [m], or a long robot
could not even turn in it: as far as the filter is told of, and this much more than by it."""
_BETWEEN = 64
"""Places looked at between a cell and a surface that may cover it."""
UNWATCHED = 1e-6
"""Error of unobserved floor [m]: none, as it is exactly there; tells it from obstacles."""
CORNER = math.sqrt(0.5) * CELL
"""From the middle of a cell to its corners; largest distance of the sensor from its cell's [m]."""
STEADY, TURNED = CELL, 0.05
"""A sensor that has moved less [m, rad] sees the same ground."""


class Window(NamedTuple):
    """Square of cells about the sensor's, row by row, (n,) each."""

    cells: Ints
    """(n, 2), counted from the sensor's cell."""
    distance: Floats
    """From the sensor's cell [m]."""
    bearing: Floats
    """[rad]"""
    wide: Floats
    """Half the angle under which a cell may be seen, wherever in the middle one the sensor is."""


@cache
def window(half: int) -> Window:
    """The window with so many cells to either side."""
    side = np.arange(-half, half + 1)
    cells = np.stack(np.meshgrid(side, side, indexing="ij"), axis=2).reshape(-1, 2)
    distance: Floats = CELL * np.hypot(*cells.T)
    bearing = np.arctan2(cells[:, 1], cells[:, 0]).astype(np.float64)
    wide = np.arcsin(np.minimum(2.0 * CORNER / np.maximum(distance, CELL), 1.0))
    return Window(cells.astype(np.int64), distance, bearing, wide)


class FreeSpace:
    """Ground that one sensor has observed. All poses are in the odometry's frame."""

    def __init__(self, sensor: Sensor, shape: Outline, within: float, floor: bool = False) -> None:
        """within: ground farther than this beyond the turning circle does not matter yet [m].
        floor: only floor that it sees counts, within the distances at which it looks for it, and
        unknown floor is not crawled onto: there may be none."""
        self._sensor, self._own, self._floor = sensor, shape, floor
        self._error = UNWATCHED if floor else -math.inf
        self._at: Pose | None = None
        self._known: NDArray[np.bool_] = np.zeros((1, 1), dtype=np.bool_)
        self._cell = (0, 0)
        self._vouched = False
        self._only_vouched: NDArray[np.bool_] = self._known
        """Of what is known, that which nothing has seen."""
        self._carried: Carried | None = None
        self._half = 0
        self.returns = 0.0
        """Distance from the body's origin within which returns have to be remembered, as ground is
        [m]."""
        self.reshape(shape, within)
        self.unknown = NOTHING
        """Unobserved ground within reach, by the newest look."""
        self.cells: Ints = np.empty((0, 2), dtype=np.int64)
        """Its cells, (n, 2), counted from the frame's origin."""
        self.looked = False

    def reshape(self, shape: Outline, within: float) -> None:
        """Change the robot's outline. within: as above."""
        self._at = None  # the unknown ground changes, too
        mount = self._sensor.mount
        self._shape = shape
        circle = shape.reach + VOUCHED
        if self._floor:
            circle = max(circle, self._sensor.vouched)
        self._vouches = circle if self._floor else turning_radius(self._sensor, shape)
        away = math.hypot(mount.x, mount.y)
        kept = max(CELL * HALF, away + circle + ROOM)
        self.returns = away + kept + _MOTION * CELL
        # Ground beyond what is kept is unknown: a cell more, which no way out of the window misses.
        self._resize(math.ceil(max(kept, away + shape.reach) / CELL) + 1)
        distance = self._window.distance
        self._near = away + shape.reach + within > distance
        self._kept = distance <= kept
        self._matters = self._kept | self._near

    def _resize(self, half: int) -> None:
        """Have so many cells to either side of the sensor's; what stays in view stays known."""
        self._window = window(half)
        if half == self._half:
            return
        self._known = _resized(self._known, half)
        self._only_vouched = _resized(self._only_vouched, half)
        self._half = half
        if self._floor:
            self._carried = Carried(self._sensor, self._window.distance, self._window.bearing)

    def beyond(self, cells: Ints) -> NDArray[np.bool_]:
        """Which cells, (n, 2), lie outside of its window."""
        outside = np.abs(cells - self._cell) > self._half
        return outside[:, 0] | outside[:, 1]

    def forget(self) -> None:
        """Forget all of it: as if it were switched on anew."""
        self._known[:] = self._only_vouched[:] = False
        self._at, self._vouched = None, False
        if self._carried is not None:
            self._carried.drives()
        self.unknown, self.cells, self.looked = NOTHING, self.cells[:0], False

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
        vouched = self._only_vouched.ravel()
        # What was seen stays known.
        new = np.flatnonzero(self._matters & ~(self._known.ravel() & ~vouched))
        distance = self._window.distance[new]
        along = self._window.bearing[new] - first  # from the first beam
        along[along < 0.0] += 2.0 * math.pi
        wide = 0.5 * abs(turned) + (0.0 if self._floor else self._window.wide[new])
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
        found = new[seen_free & self._kept[new]]
        known[found], vouched[found] = True, False
        if not self._vouched:
            self._vouch(pose, none_seen)
        vouched = self._only_vouched.ravel()
        if not self._floor and vouched.any() and abs(turned) < TURNED:
            hidden = new[~looks & vouched[new]]
            stood_on = self._stood_on(hidden, pose)
            vouched[hidden[stood_on]] = False
            hidden = hidden[~stood_on]
            known[hidden[self._covered(hidden, ranges, pose, Pose(x, y, psi))]] = False
        cells = self._window.cells[new[~(looks | known[new]) & self._near[new]]] + self._cell
        points: Floats = CELL * cells.astype(np.float64)
        at = seen_from(points, pose)
        outside, own = (edge_distances(at, one).max(axis=1) for one in (self._shape, self._own))
        # The robot itself is there, and stands on it; an added load hangs over anything.
        stood_on = np.maximum(outside, own) <= -CORNER
        under = (outside <= -CORNER) | ((outside <= CORNER) & (own > CORNER))
        self._known[tuple((cells[stood_on] + self._half - self._cell).T)] = True
        unknown: Floats = points[~under]
        n = len(unknown)
        self.cells, self.looked = cells[~under], True
        self.unknown = MonitorSurroundings(
            unknown, np.full(n, self._error), np.full(n, CORNER), np.full(n, seen)
        )  # fmt: skip
        return self.unknown

    def _vouch(self, pose: Pose, excluded: Ints) -> None:
        """Mark the ground about a pose as known, without these cells."""
        self._vouched = True
        near = self._about(pose) & self._kept & ~self._known.ravel()
        near[excluded] = False
        self._known |= near.reshape(self._known.shape)
        self._only_vouched = near.reshape(self._known.shape)

    def _stood_on(self, which: Ints, pose: Pose) -> NDArray[np.bool_]:
        """On which cells of the window the robot stands."""
        points: Floats = CELL * (self._window.cells[which] + self._cell).astype(np.float64)
        return edge_distances(seen_from(points, pose), self._own).max(axis=1) <= -CORNER

    def _covered(self, which: Ints, ranges: Floats, pose: Pose, eye: Pose) -> NDArray[np.bool_]:
        """Which cells of the window lie beyond a surface that the edge of the view cuts, by a cell
        at least (the filter takes all of a cell for covered of which any part is), and with no
        ground between that has been seen free. eye: pose of the sensor."""
        x, y, psi = eye
        here, side, bearings = np.array([x, y]), len(self._known), self._sensor.bearings
        turn = np.array([[math.cos(psi), math.sin(psi)], [-math.sin(psi), math.cos(psi)]])
        cells: Floats = CELL * (self._window.cells[which] + self._cell).astype(np.float64)
        seen, covered = self._known & ~self._only_vouched, np.zeros(len(which), dtype=np.bool_)
        for beams in (slice(None), slice(None, None, -1)):
            found = surface(ranges[beams], bearings[beams], self._sensor.noise)
            if found is None:
                continue
            at: Floats = here + found.at @ turn
            if edge_distances(seen_from(at[None], pose), self._shape).max() <= 0.0:
                continue  # its own body
            along: Floats = (cells - here) @ (found.normal @ turn)
            beyond = np.flatnonzero(along > found.offset + CELL)
            between: Floats = np.linspace(at, cells[beyond], _BETWEEN)
            i: Ints = np.round(between[..., 0] / CELL).astype(np.int64)
            j: Ints = np.round(between[..., 1] / CELL).astype(np.int64)
            angle: Floats = np.arctan2(CELL * j - y, CELL * i - x) - psi - bearings[0]
            i, j = i - self._cell[0] + self._half, j - self._cell[1] + self._half
            hidden = angle % (2.0 * math.pi) > bearings[-1] - bearings[0]
            hidden &= (np.maximum(i, j) < side) & (np.minimum(i, j) >= 0)
            free = seen[i.clip(0, side - 1), j.clip(0, side - 1)] & hidden
            covered[beyond[~free.any(axis=0)]] = True
        return covered

    def _about(self, pose: Pose) -> NDArray[np.bool_]:
        """The ground about a pose where a robot is switched on, or put down."""
        x, y = (CELL * (self._window.cells + self._cell)).T
        return np.asarray(np.hypot(x - pose.x, y - pose.y) < self._vouches)

    def _move(self, i: int, j: int) -> None:
        """Center the window on a cell; ground that stays in it stays known."""
        di, dj = i - self._cell[0], j - self._cell[1]
        self._cell = i, j
        side = len(self._known)
        kept = self._kept.reshape(self._known.shape)
        known, vouched = np.zeros_like(self._known), np.zeros_like(self._known)
        if abs(di) < side and abs(dj) < side:
            to_i, from_i = _overlap(di, side)
            to_j, from_j = _overlap(dj, side)
            known[to_i, to_j] = self._known[from_i, from_j]
            vouched[to_i, to_j] = self._only_vouched[from_i, from_j]
        self._known, self._only_vouched = known & kept, vouched & kept


def unknown_to_all(spaces: Sequence[FreeSpace]) -> MonitorSurroundings:
    """Ground that no sensor looks at or has looked at before; sensors that have not looked yet do
    not count. What is beyond a sensor's window is unknown to it."""
    looked = [space for space in spaces if space.looked]
    found = NOTHING
    for i, space in enumerate(looked):
        cells, own = space.cells, _keys(space)
        to_all = np.ones(len(own), dtype=np.bool_)
        for j, other in enumerate(looked):
            if j < i:  # what is in its window was found with it
                to_all &= other.beyond(cells)
            elif j > i:
                to_all &= other.beyond(cells) | np.isin(own, _keys(other))
        found = joined(found, MonitorSurroundings(*(column[to_all] for column in space.unknown)))
    return found


def _keys(space: FreeSpace) -> Ints:
    """A number for each of its cells."""
    cells = space.cells
    return (cells[:, 0] << 32) + cells[:, 1]


def _resized(cells: NDArray[np.bool_], half: int) -> NDArray[np.bool_]:
    """With so many cells to either side; new ones are False."""
    made = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.bool_)
    before = len(cells) // 2
    cut, off = max(before - half, 0), max(half - before, 0)
    inner = cells[cut : len(cells) - cut, cut : len(cells) - cut]
    made[off : off + len(inner), off : off + len(inner)] = inner
    return made


def _overlap(by: int, side: int) -> tuple[slice, slice]:
    """For a row that moved by some cells: where its old contents are now, and where they were."""
    return slice(max(-by, 0), side - max(by, 0)), slice(max(by, 0), side - max(-by, 0))
