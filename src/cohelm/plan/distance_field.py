"""Distance field: distance of every cell of a grid from the nearest obstacle point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.types import Floats
from cohelm.plan.distance_transform import NONE, nearest_occupied
from cohelm.robot.clearance import circumscribed_radius, point_gap

_TOGETHER = 8  # so many poses of a path share their search for near points


class DistanceField(NamedTuple):
    """Clearance over a rectangle of the world.

    clearance: (rows, columns), distance from each cell's centre to the nearest point [m]; rows
    run along y, columns along x. resolution: side of a cell [m]. (x, y): centre of cell (0, 0).
    """

    clearance: Floats
    resolution: float
    x: float
    y: float


def distance_field(
    points: Floats, low: tuple[float, float], high: tuple[float, float], resolution: float
) -> DistanceField:
    """The chart of the rectangle from `low` to `high` for points (p, 2), world frame [m].

    The distance is to the nearest point of the nearest cell that has any. Without a point inside
    the rectangle it is infinite; points outside are ignored, so leave a border.
    """
    columns = math.ceil((high[0] - low[0]) / resolution) + 1
    rows = math.ceil((high[1] - low[1]) / resolution) + 1
    made = DistanceField(np.full((rows, columns), math.inf), resolution, low[0], low[1])
    _measure(made, points)
    return made


@jit
def _measure(field: DistanceField, points: Floats) -> None:
    """Fill in the clearance: of each cell to the points of the nearest cell that holds any."""
    rows, columns = field.clearance.shape
    cell_of = np.full(len(points), NONE)
    first = np.zeros(rows * columns + 1, np.int64)  # where the points of each cell begin in `order`
    occupied = np.zeros((rows, columns), np.bool_)
    for p in range(len(points)):
        i = np.rint((points[p, 1] - field.y) / field.resolution)
        j = np.rint((points[p, 0] - field.x) / field.resolution)
        if 0.0 <= i < rows and 0.0 <= j < columns:  # never for NaN
            occupied[int(i), int(j)] = True
            cell_of[p] = int(i) * columns + int(j)
            first[cell_of[p] + 1] += 1
    for cell in range(rows * columns):
        first[cell + 1] += first[cell]
    order, taken = np.empty(first[-1], np.int64), first.copy()
    for p in range(len(points)):
        if cell_of[p] != NONE:
            order[taken[cell_of[p]]] = p
            taken[cell_of[p]] += 1
    nearest = nearest_occupied(occupied)
    if len(order) == 0:
        return
    for i in range(rows):
        y = field.y + field.resolution * i
        for j in range(columns):
            x = field.x + field.resolution * j
            square = math.inf
            for k in range(first[nearest[i, j]], first[nearest[i, j] + 1]):
                dx, dy = points[order[k], 0] - x, points[order[k], 1] - y
                square = min(square, dx * dx + dy * dy)
            field.clearance[i, j] = math.sqrt(square)


@jit_no_refcount
def clearance(field: DistanceField, x: float, y: float) -> float:
    """The clearance at a world point, linear between cell centres; outside, of the border [m]."""
    rows, columns = field.clearance.shape
    u = min(max((x - field.x) / field.resolution, 0.0), columns - 1.0)
    v = min(max((y - field.y) / field.resolution, 0.0), rows - 1.0)
    j, i = min(int(u), columns - 2), min(int(v), rows - 2)
    s, t = u - j, v - i
    c = field.clearance
    if c[i, j] == math.inf:
        return math.inf
    return (1.0 - t) * ((1.0 - s) * c[i, j] + s * c[i, j + 1]) + t * (
        (1.0 - s) * c[i + 1, j] + s * c[i + 1, j + 1]
    )


def inscribed_radius(outline: Floats) -> float:
    """Radius of the largest circle around the body origin inside a convex outline (k, 2) [m]."""
    edges = np.concatenate((outline[1:], outline[:1])) - outline
    across = outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]
    return float((across / np.hypot(edges[:, 0], edges[:, 1])).min())


@jit
def swept_clearances(points: Floats, outline: Floats, poses: Floats) -> Floats:
    """The clearance of a convex outline (k, 2) to the nearest point, at each of (n, 3) poses [m].

    0 where a point is inside or touched, inf without points.
    """
    reach = circumscribed_radius(outline)
    clearances = np.empty(len(poses))
    for first in range(0, len(poses), _TOGETHER):
        part = poses[first : first + _TOGETHER]
        clearances[first : first + _TOGETHER] = _clearances(
            _nearby(points, reach, part), outline, reach, part
        )
    return clearances


@jit
def _nearby(points: Floats, reach: float, poses: Floats) -> Floats:
    """Those of the points (p, 2) that can be the nearest to an outline at one of some poses.

    reach: radius of the outline around its origin [m].
    """
    x, y, spread = poses[0, 0], poses[0, 1], 0.0
    for i in range(1, len(poses)):
        spread = max(spread, math.hypot(poses[i, 0] - x, poses[i, 1] - y))
    squares, least = np.empty(len(points)), math.inf
    for p in range(len(points)):
        dx, dy = points[p, 0] - x, points[p, 1] - y
        squares[p] = dx * dx + dy * dy
        least = min(least, squares[p])
    # From another pose's origin the point nearest to the first is `least + spread` away, from its
    # outline up to `reach` more; a point that is nearer to the outline is within `reach` of that.
    most = math.sqrt(least) + 2.0 * (spread + reach)
    return points[squares <= most * most * (1.0 + 1e-9)]


@jit
def _clearances(points: Floats, outline: Floats, reach: float, poses: Floats) -> Floats:
    """As `swept_clearances`, of a few poses."""
    clearances, nearest = np.empty(len(poses)), -1
    for i in range(len(poses)):
        x, y, c, s = poses[i, 0], poses[i, 1], math.cos(poses[i, 2]), math.sin(poses[i, 2])
        least = math.inf
        if nearest >= 0:  # of the pose before: it bounds the search for all others
            dx, dy = points[nearest, 0] - x, points[nearest, 1] - y
            least = max(point_gap(outline, c * dx + s * dy, -s * dx + c * dy), 0.0)
        far = (least + reach) * (least + reach)
        for p in range(len(points)):
            dx, dy = points[p, 0] - x, points[p, 1] - y
            if dx * dx + dy * dy < far:
                gap = max(point_gap(outline, c * dx + s * dy, -s * dx + c * dy), 0.0)
                if gap < least:
                    least, nearest = gap, p
                    far = (least + reach) * (least + reach)
        clearances[i] = least
    return clearances
