"""Distance field: distance of every cell of a grid from the nearest obstacle point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.robot.clearance import point_gap


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
    place = np.rint((points - np.array(low)) / resolution)
    inside = ((place >= 0.0) & (place < (columns, rows))).all(axis=1)
    cells = place[inside].astype(np.int64)
    if len(cells) == 0:
        return DistanceField(np.full((rows, columns), math.inf), resolution, low[0], low[1])
    flat = cells[:, 1] * columns + cells[:, 0]
    order = np.argsort(flat, kind="stable")
    count = np.bincount(flat, minlength=rows * columns)
    first = np.concatenate(([0], np.cumsum(count)))
    nearest: NDArray[np.int32] = scipy.ndimage.distance_transform_edt(
        (count == 0).reshape(rows, columns),
        return_distances=False,
        return_indices=True,
    )
    made = DistanceField(np.empty((rows, columns)), resolution, low[0], low[1])
    _measure(made, points[inside][order], first, nearest)
    return made


@jit
def _measure(field: DistanceField, points: Floats, first: Ints, nearest: NDArray[np.int32]) -> None:
    """Fill in the clearance: of each cell to the points of the cell that is nearest to it.

    points: in the order of their cells. first: (cells + 1,), where those of each cell begin.
    nearest: (2, rows, columns), row and column of the nearest cell that holds any.
    """
    rows, columns = field.clearance.shape
    for i in range(rows):
        y = field.y + field.resolution * i
        for j in range(columns):
            x = field.x + field.resolution * j
            cell = nearest[0, i, j] * columns + nearest[1, i, j]
            square = math.inf
            for p in range(first[cell], first[cell + 1]):
                dx, dy = points[p, 0] - x, points[p, 1] - y
                square = min(square, dx * dx + dy * dy)
            field.clearance[i, j] = math.sqrt(square)


@jit
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
    edges = np.roll(outline, -1, axis=0) - outline
    across = outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]
    return float((across / np.hypot(edges[:, 0], edges[:, 1])).min())


@jit
def swept_clearances(points: Floats, outline: Floats, poses: Floats) -> Floats:
    """The clearance of a convex outline (k, 2) to the nearest point, at each of (n, 3) poses [m].

    0 where a point is inside or touched, inf without points.
    """
    reach = 0.0
    for k in range(len(outline)):
        reach = max(reach, math.hypot(outline[k, 0], outline[k, 1]))
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
