"""Surfaces as points with normals, with a grid to look up the nearest one.

A wall is a row of points, each with its normal. `nearest` is a grid of the nearest surface to each
cell, so that matching needs no search.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose
from cohelm.robot.sensors import Lidar

_HALF = 0.15  # neighbourhood of a normal [m]
_MOST = 16  # beams on either side at most
_FLAT = 0.04  # largest rms distance from the fitted line [m]
MOST_CELLS = 64_000_000
"""Limit of a map, or of an index of surfaces: 400 m x 400 m at 5 cm, which takes half a GB."""


class FlatPoints(NamedTuple):
    """Points on flat surfaces, and the unit normal of the surface at each, (n, 2) both [m]."""

    points: Floats
    normals: Floats


class Surfaces(NamedTuple):
    """points: (n, 2) [m]. normals: (n, 2), unit, of either sign, or towards the visible side.
    nearest: (rows, columns), row of the nearest surface to a cell's centre, -1 where none is
    within reach; rows run along y. resolution: side of a cell [m]. (x, y): outer corner of cell
    (0, 0) [m]. back: (n,), row of the nearest surface that faces the other way, as the other
    side of a wall does, -1 where there is none; empty where normals are of either sign."""

    points: Floats
    normals: Floats
    nearest: NDArray[np.int32]
    resolution: float
    x: float
    y: float
    back: Ints


_NO_BACK: Ints = np.empty(0, np.int64)
_BAND = 256  # rows filled in at a time
_THICK = 0.3  # largest thickness of a wall with two sides [m]


@jit
def flat_points(points: Floats, beams: Ints, lidar: Lidar) -> FlatPoints:
    """The points of a sweep that lie on a flat surface, and its normals there, towards the LiDAR:
    a beam shows the side of a wall that faces it.

    points: (m, 2) body frame, in the order of the beams. The line is fitted to neighbours within
    15 cm, at least to the next beam on either side, so that 1 degree between beams is enough for
    walls.
    """
    m = len(points)
    kept, normals = np.empty((m, 2)), np.empty((m, 2))
    k = 0
    for i in range(m):
        r = math.hypot(points[i, 0], points[i, 1])
        jump = max(0.12, 4.0 * r * lidar.step)
        count, sx, sy, sxx, sxy, syy = 1, 0.0, 0.0, 0.0, 0.0, 0.0
        sides = 0
        for direction in (-1, 1):
            before = i
            for far in range(1, _MOST + 1):
                j = i + direction * far
                if not 0 <= j < m or abs(beams[j] - beams[before]) > 3:
                    break
                gap = math.hypot(points[j, 0] - points[before, 0], points[j, 1] - points[before, 1])
                dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                if gap > jump or (far > 1 and dx * dx + dy * dy > _HALF * _HALF):
                    break
                if far == 1:
                    sides += 1
                count += 1
                sx, sy = sx + dx, sy + dy
                sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
                before = j
        if sides < 2 or count < 3:
            continue
        a, b, c = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
        half, middle = 0.5 * (a - c), 0.5 * (a + c)
        root = math.hypot(half, b)
        thickness = max(middle - root, 0.0) / count
        long = (middle + root) / count
        if thickness > _FLAT * _FLAT or long < 9.0 * thickness or long <= 0.0:
            continue
        turn = 0.5 * math.atan2(2.0 * b, a - c)
        kept[k, 0], kept[k, 1] = points[i, 0], points[i, 1]
        normals[k, 0], normals[k, 1] = -math.sin(turn), math.cos(turn)
        k += 1
    return facing(FlatPoints(kept[:k].copy(), normals[:k].copy()), lidar.mount.x, lidar.mount.y)


@jit
def facing(flat: FlatPoints, x: float, y: float) -> FlatPoints:
    """With each normal turned towards the place (x, y)."""
    points, normals = flat.points, flat.normals
    out = normals.copy()
    for i in range(len(points)):
        if (points[i, 0] - x) * normals[i, 0] + (points[i, 1] - y) * normals[i, 1] > 0.0:
            out[i, 0], out[i, 1] = -normals[i, 0], -normals[i, 1]
    return FlatPoints(points, out)


@jit
def moved(pose: Pose, vectors: Floats, place: bool) -> Floats:
    """Vectors (n, 2) of a body frame in that of its pose; only rotated if not `place`."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    x, y = (pose.x, pose.y) if place else (0.0, 0.0)
    out = np.empty_like(vectors)
    for i in range(len(vectors)):
        out[i, 0] = x + c * vectors[i, 0] - s * vectors[i, 1]
        out[i, 1] = y + s * vectors[i, 0] + c * vectors[i, 1]
    return out


def seen_from(pose: Pose, flat: FlatPoints) -> FlatPoints:
    """Those of a body frame in that of its pose."""
    return FlatPoints(moved(pose, flat.points, True), moved(pose, flat.normals, False))


def stacked(some: Iterable[FlatPoints]) -> FlatPoints:
    """All of them, one after the other; at least one."""
    return FlatPoints(*(np.vstack(parts) for parts in zip(*some, strict=True)))


def surfaces(flat: FlatPoints, resolution: float, reach: float, back: bool = False) -> Surfaces:
    """Index points with normals; places farther than `reach` from all have no nearest [m].

    back: normals face the visible side.

    Raises CohelmError for more than MOST_CELLS.
    """
    points = flat.points
    if len(points) == 0:
        nothing = np.empty((0, 0), np.int32)
        return Surfaces(*flat, nothing, resolution, 0.0, 0.0, _NO_BACK)
    low = points.min(axis=0) - reach - resolution
    size = np.ceil((points.max(axis=0) + reach + resolution - low) / resolution)
    if not float(size[0]) * float(size[1]) <= MOST_CELLS:
        wide, deep = (float(n) * resolution for n in size)
        raise CohelmError(
            f"what was seen spans {wide:.4g} x {deep:.4g} m, more than {MOST_CELLS // 10**6} "
            f"million cells of {resolution:g} m: check the odometry for jumps, or cut the map"
        )
    size = size.astype(int)
    nearest = np.full((int(size[1]), int(size[0])), -1, np.int32)
    other = _opposite_sides(flat) if back else _NO_BACK
    made = Surfaces(*flat, nearest, resolution, float(low[0]), float(low[1]), other)
    _spread(made, reach)
    return made


def _opposite_sides(flat: FlatPoints) -> Ints:
    points, normals = flat
    count = min(24, len(points))
    nearest = range(1, count + 1)
    near = scipy.spatial.cKDTree(points).query(points, list(nearest), distance_upper_bound=_THICK)
    there = np.isfinite(np.asarray(near[0], dtype=np.float64))
    rows = np.where(there, np.asarray(near[1], dtype=np.int64), 0)
    facing = there & (np.einsum("ij,ikj->ik", normals, normals[rows]) < -0.85)
    first = facing.argmax(axis=1)
    found = rows[np.arange(len(points)), first]
    return np.where(facing.any(axis=1), found, -1).astype(np.int64)


@jit
def behind(made: Surfaces) -> Ints:
    """(n,): row of the nearest surface behind each that faces the other way, as the other side of
    a wall does; -1 where there is none. Normals face the visible side."""
    found = np.full(len(made.points), -1, np.int64)
    for k in range(len(made.points)):
        px, py = made.points[k, 0], made.points[k, 1]
        nx, ny = made.normals[k, 0], made.normals[k, 1]
        least = _THICK * _THICK
        for n in range(math.ceil(_THICK / made.resolution) + 1):
            deep = n * made.resolution
            j = row_at(made, px - deep * nx, py - deep * ny)
            if j < 0 or made.normals[j, 0] * nx + made.normals[j, 1] * ny > -0.85:
                continue
            dx, dy = made.points[j, 0] - px, made.points[j, 1] - py
            if dx * dx + dy * dy < least:
                least = dx * dx + dy * dy
                found[k] = j
    return found


def one_each(flat: FlatPoints, side: float) -> FlatPoints:
    """One point of each square cell for each of the four directions that it may face [m]."""
    x, y = flat.normals.T
    quarter = np.floor(np.arctan2(y, x) / (0.5 * math.pi) + 0.5) % 4
    return _one_each(flat, side, quarter.astype(np.int64))


def thinned(flat: FlatPoints, side: float) -> FlatPoints:
    """One point of each square cell: the mean of those in it with the same direction [m]."""
    return _one_each(flat, side, np.zeros(len(flat.points), np.int64))


def _one_each(flat: FlatPoints, side: float, group: Ints) -> FlatPoints:
    keys = _keys(flat.points, side, group)
    n = len(flat.points)
    # no two are equal, so that the fastest order is as good as a stable one
    return _means(flat, keys, np.argsort(keys * n + np.arange(n)))


@jit
def _keys(points: Floats, side: float, group: Ints) -> Ints:
    """(n,): one number for each group and square cell."""
    n = len(points)
    cells = np.empty((n, 2), np.int64)
    for i in range(n):
        cells[i, 0] = math.floor(points[i, 0] / side)
        cells[i, 1] = math.floor(points[i, 1] / side)
    if n == 0:
        return group
    u, v = cells[:, 0].min(), cells[:, 1].min()
    wide, high = cells[:, 0].max() + 1 - u, cells[:, 1].max() + 1 - v
    return (group * wide + cells[:, 0] - u) * high + cells[:, 1] - v


@jit
def _spread(made: Surfaces, reach: float) -> None:
    """Fill in the nearest surface of every cell.

    Each point is compared with a block of cells of fixed width and without a branch, which the
    processor does several cells at a time. It is wider than the reach: `square` bounds it. That
    holds a band of rows, since the whole of a large map would take longer to be handed out than
    to be filled in.
    """
    rows, columns = made.nearest.shape
    square = np.empty((min(rows, _BAND), columns))
    wide = math.ceil(reach / made.resolution)
    block = min(columns, 16 * math.ceil((2 * wide + 1) / 16))
    along = np.empty(block)
    for top in range(0, rows, _BAND):
        square[:] = reach * reach
        for k in range(len(made.points)):
            v = (made.points[k, 1] - made.y) / made.resolution
            low, high = max(int(v) - wide, top), min(int(v) + wide + 1, top + _BAND, rows)
            if low >= high:
                continue
            u = (made.points[k, 0] - made.x) / made.resolution
            first = max(min(int(u) - wide, columns - block), 0)
            for j in range(block):
                dx = (first + j + 0.5 - u) * made.resolution
                along[j] = dx * dx
            for i in range(low, high):
                dy = (i + 0.5 - v) * made.resolution
                across = dy * dy
                least = square[i - top, first : first + block]
                row = made.nearest[i, first : first + block]
                for j in range(block):
                    d = along[j] + across
                    closer = d < least[j]
                    least[j] = d if closer else least[j]
                    row[j] = np.int32(k) if closer else row[j]


@jit_inline
def row_at(known: Surfaces, x: float, y: float) -> int:
    """Row of the surface nearest to a place, -1 where there is none."""
    rows, columns = known.nearest.shape
    u, v = (x - known.x) / known.resolution, (y - known.y) / known.resolution
    if not (0.0 <= u < columns and 0.0 <= v < rows):
        return -1
    return int(known.nearest[int(v), int(u)])


@jit
def _means(flat: FlatPoints, keys: Ints, order: Ints) -> FlatPoints:
    """The mean of each of those with the same key and direction."""
    points, normals = flat.points, flat.normals
    n = len(points)
    kept, out = np.empty((n, 2)), np.empty((n, 2))
    k, a = 0, 0
    while a < n:
        b = a
        first = order[a]
        x, y, nx, ny, count = 0.0, 0.0, 0.0, 0.0, 0
        while b < n and keys[order[b]] == keys[first]:
            i = order[b]
            same = normals[i, 0] * normals[first, 0] + normals[i, 1] * normals[first, 1]
            if abs(same) > 0.9:
                sign = 1.0 if same > 0.0 else -1.0
                x, y, count = x + points[i, 0], y + points[i, 1], count + 1
                nx, ny = nx + sign * normals[i, 0], ny + sign * normals[i, 1]
            b += 1
        size = math.hypot(nx, ny)
        kept[k, 0], kept[k, 1] = x / count, y / count
        out[k, 0], out[k, 1] = nx / size, ny / size
        k += 1
        a = b
    return FlatPoints(kept[:k].copy(), out[:k].copy())
