"""Keep-out and speed zones, which no sensor shows.

They are in the map's frame, so as accurate as the localization, beside the obstacles of LiDARs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.frames import between, placed
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Floats, Pose
from cohelm.robot.achievable import stopping_distance
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.limits import Limits
from cohelm.robot.model import LONGEST_DELAY

CELL = 0.05
"""Largest cell of keep-out zones, so that nothing passes between the points of two [m]."""
FAR = 7.0
"""Radius in which zones are sampled, larger than plans look ahead, at least [m]."""
_MOVED = 0.5
"""Distance after which they are sampled anew [m]."""
_EDGE = 1.5
"""Depth of border cells, in cells: those beside the outside, or at a corner of it."""
_BEYOND = 0.1
"""In a zone, cells deeper than the robot by this are obstacles [m]."""


class Cells(NamedTuple):
    """A raster: (rows, columns) of `values`, row 0 at the smallest y of its own axes. origin: pose
    of the outer corner of cell (0, 0) in the map."""

    values: NDArray[np.float32]
    resolution: float
    origin: Pose

    def at(self, points: Floats) -> Floats:
        """The values at points (p, 2) of the map; 0 outside."""
        x, y, psi = self.origin
        c, s = math.cos(psi), math.sin(psi)
        dx, dy = points[:, 0] - x, points[:, 1] - y
        columns = np.floor((c * dx + s * dy) / self.resolution).astype(np.int64)
        rows = np.floor((c * dy - s * dx) / self.resolution).astype(np.int64)
        height, width = self.values.shape
        on = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        found = np.zeros(len(points))
        found[on] = self.values[rows[on], columns[on]]
        return found

    def centres(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Floats:
        """Centres of cells, (p, 2) in the map [m]."""
        own: Floats = np.column_stack((columns, rows)).astype(np.float64) + 0.5
        return placed(own * self.resolution, self.origin)

    def bounds(self) -> Floats:
        """Its smallest and largest x and y in the map, (2, 2) [m]."""
        height, width = self.values.shape
        ends = np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=np.float64)
        corners = placed(ends * self.resolution, self.origin)
        return np.stack((corners.min(axis=0), corners.max(axis=0)))


class KeepOut(NamedTuple):
    """Keep-out zones."""

    depth: Cells
    """Distance to the border of the zone [m]; 0 outside."""
    zone: NDArray[np.int32]
    """Number of a cell's zone, from 1; 0: none. Of the shape of `depth`."""


def keep_out(marked: NDArray[np.bool_], resolution: float, origin: Pose) -> KeepOut:
    """From marked cells, (rows, columns); coarse cells are divided."""
    parts = max(math.ceil(resolution / CELL - 1e-6), 1)
    fine = np.repeat(np.repeat(marked, parts, axis=0), parts, axis=1)
    side = resolution / parts
    inside = np.pad(fine, 1)
    depth = scipy.ndimage.distance_transform_edt(inside)[1:-1, 1:-1] * side
    zone = np.asarray(scipy.ndimage.label(fine, np.ones((3, 3), np.int64))[0], np.int32)
    return KeepOut(Cells(depth.astype(np.float32), side, origin), zone)


class Fence:
    """The keep-out zones as obstacle points for one robot.

    A zone that the robot's outline is clear of stands as a whole. Of one that it is in, only what
    is deeper stands than its deepest point was at its least: it can leave in every direction in
    which it gets no deeper, and what it has left is closed behind it. Where it is suddenly deeper,
    as localization has found it elsewhere, it begins from there.
    """

    def __init__(self, zones: KeepOut, outline: Floats, stopping: float = 0.0) -> None:
        """outline: (k, 2), convex, counter-clockwise [m]. stopping: distance in which the robot
        stops from full speed [m]."""
        self.zones, self._stopping = zones, stopping
        self._beyond = _BEYOND + zones.depth.resolution
        self.reshape(outline)
        self._allowed: dict[int, float] = {}
        """Allowed depth in each zone that the robot is in [m]."""
        self._points: Floats = np.empty((0, 2))
        self._shown: dict[int, float] | None = None
        cells = zones.depth
        i, j = np.nonzero((zones.zone > 0) & (cells.values <= _EDGE * cells.resolution))
        self._border, self._of = cells.centres(i, j), zones.zone[i, j]
        self._near = np.zeros(len(i), np.bool_)
        self._standing(self._near, self._window(Pose(0.0, 0.0, 0.0)))  # compiles what is needed

    def reshape(self, outline: Floats) -> None:
        """Use another outline from now on."""
        self._samples = covering(outline, CELL)
        self._pose: Pose | None = None
        reach = farthest_corner(outline)
        most = math.hypot(*self.zones.depth.values.shape) * self.zones.depth.resolution
        self._far = max(FAR, min(reach + self._stopping, most)) + _MOVED
        self._here: Pose | None = None

    def points(self, pose: Pose) -> Floats:
        """(p, 2), in the map [m], for a robot there."""
        if pose == self._pose:
            return self._points
        self._pose = pose
        body = placed(self._samples, pose)
        deepest = self._deepest(body)
        beyond = self._beyond
        self._allowed = {
            zone: depth if self._allowed.get(zone, -math.inf) + beyond < depth
            else min(depth, self._allowed[zone])
            for zone, depth in deepest.items()
        }  # fmt: skip
        if self._here is None or _far(self._here, pose) > _MOVED:
            self._here = pose
            off = self._border - np.array(pose[:2])
            self._near = np.hypot(off[:, 0], off[:, 1]) < self._far
            self._shown = None
        if self._shown is None or not _alike(self._shown, self._allowed):
            self._shown = dict(self._allowed)
            self._points = self._standing(self._near, self._window(pose))
        return self._points

    @property
    def inside(self) -> bool:
        """Whether the last pose was in a zone."""
        return bool(self._allowed)

    def _deepest(self, body: Floats) -> dict[int, float]:
        """Depth in each zone that the robot is in [m]."""
        zones = self.zones
        of = zones.depth._replace(values=zones.zone).at(body).astype(np.int64)
        if not of.any():
            return {}
        depth = zones.depth.at(body)
        return {int(zone): float(depth[of == zone].max()) for zone in np.unique(of[of > 0])}

    def everywhere(self, pose: Pose) -> Floats:
        """The same of the whole map, (p, 2) [m]."""
        self.points(pose)
        return self._standing(np.ones(len(self._border), np.bool_), np.s_[:, :])

    def _standing(self, near: NDArray[np.bool_], window: tuple[slice, slice]) -> Floats:
        """The border of the zones, (p, 2) [m]. near: which border points of whole zones. window:
        part of the raster that is searched for the border of the others."""
        zones, cells = self.zones, self.zones.depth
        found = [self._border[near & ~np.isin(self._of, list(self._allowed))]]
        top, left = (part.start or 0 for part in window)
        for one, depth in self._allowed.items():
            least, here = depth + self._beyond, cells.values[window]
            edge = (here > least) & (here <= least + _EDGE * cells.resolution)
            i, j = np.nonzero(edge & (zones.zone[window] == one))
            found.append(cells.centres(i + top, j + left))
        return np.ascontiguousarray(np.vstack(found))

    def _window(self, pose: Pose) -> tuple[slice, slice]:
        """The part of the raster around a pose."""
        cells = self.zones.depth
        here = between(cells.origin, pose)
        reach = math.ceil(self._far / cells.resolution)
        parts: list[slice] = []
        for middle, most in zip((here.y, here.x), cells.values.shape, strict=True):
            at = math.floor(middle / cells.resolution)
            parts.append(slice(min(max(at - reach, 0), most), min(max(at + reach, 0), most)))
        return parts[0], parts[1]


class SpeedZones(NamedTuple):
    """Zones with a speed limit."""

    limits: Cells
    """Shares of the usual speed, or [m/s]; 0: none."""
    share: bool
    """Whether they are shares."""

    def limit(self, body: Floats) -> float:
        """The lowest limit at points (p, 2) of the map; infinite without one."""
        found = self.limits.at(body)
        return float(found[found > 0.0].min()) if (found > 0.0).any() else math.inf


class Zones(NamedTuple):
    """The zones of one map, false where there are none; None: none of that kind."""

    keep_out: KeepOut | None = None
    slow: SpeedZones | None = None

    def __bool__(self) -> bool:
        return self.keep_out is not None or self.slow is not None

    def over(self, other: Zones) -> Zones:
        """Of each kind these, where there are some, else the other's."""
        return Zones(self.keep_out or other.keep_out, self.slow or other.slow)


UNZONED = Zones()
"""No zones."""


class Zoned:
    """The zones of one robot."""

    def __init__(self, zones: Zones, outline: Floats, u_d: float, limits: Limits) -> None:
        """outline: (k, 2), convex, counter-clockwise [m]. u_d: the usual speed [m/s]. limits: of
        the robot, which has to stop clear of the zones."""
        kept_out, self._slow = zones
        self._fence = None
        if kept_out is not None:
            stopping = stopping_distance(limits, LONGEST_DELAY)
            self._fence = Fence(kept_out, outline, stopping if math.isfinite(stopping) else 0.0)
        self._u_d = u_d
        self.reshape(outline)

    def reshape(self, outline: Floats) -> None:
        """Use another outline from now on."""
        self._body = covering(outline, CELL)
        if self._fence is not None:
            self._fence.reshape(outline)

    def points(self, pose: Pose) -> Floats:
        """The keep-out zones as points, (p, 2), in the map [m]; the same array while nothing
        changes."""
        return _NOTHING if self._fence is None else self._fence.points(pose)

    def beside(self, obstacles: Surroundings, pose: Pose) -> Surroundings:
        """The obstacles, with the points of those zones behind theirs. All in the map."""
        return obstacles._replace(points=np.vstack((obstacles.points, self.points(pose))))

    @property
    def inside(self) -> bool:
        """Whether the last pose was in a keep-out zone."""
        return self._fence is not None and self._fence.inside

    def limit(self, pose: Pose) -> tuple[float, str]:
        """The limit of the speed zones that it is in [m/s], and the reason; infinite without
        one."""
        if self._slow is None:
            return math.inf, ""
        limit = self._slow.limit(placed(self._body, pose))
        if math.isinf(limit):
            return math.inf, ""
        if self._slow.share:
            return limit * self._u_d, f"speed zone, {100.0 * limit:.0f} %"
        return limit, f"speed zone, {limit:g} m/s"


_NOTHING: Floats = np.empty((0, 2))


def covering(outline: Floats, side: float) -> Floats:
    """Points on and in a convex outline (k, 2), spaced at most so far, (p, 2) [m]."""
    xs, ys = _spaced(outline[:, 0], side), _spaced(outline[:, 1], side)
    grid = np.column_stack((np.repeat(xs, len(ys)), np.tile(ys, len(xs))))
    edges = np.roll(outline, -1, axis=0) - outline
    off = grid[:, None] - outline[None]
    inside = (edges[None, :, 0] * off[..., 1] - edges[None, :, 1] * off[..., 0] >= 0.0).all(axis=1)
    parts: list[Floats] = [grid[inside]]
    for corner, edge in zip(outline, edges, strict=True):
        share = np.linspace(0.0, 1.0, math.ceil(float(np.hypot(*edge)) / side) + 1)
        parts.append(corner + share[:, None] * edge)
    return np.vstack(parts)


def _spaced(values: Floats, side: float) -> Floats:
    """From the smallest to the largest, spaced at most so far."""
    low, high = float(values.min()), float(values.max())
    made: Floats = np.linspace(low, high, math.ceil((high - low) / side) + 1)
    return made


def _far(a: Pose, b: Pose) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _alike(a: dict[int, float], b: dict[int, float]) -> bool:
    """Whether the allowed depths are equal, to a centimetre."""
    return a.keys() == b.keys() and all(abs(a[zone] - b[zone]) < 0.01 for zone in a)
