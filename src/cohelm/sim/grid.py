"""Occupancy maps as worlds: square cells, solid or free, cast through exactly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import placed
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose

_FARTHEST = 60_000  # cells; a jump must fit into 16 bits
MOST_WALLS = 500_000
"""Borders of solid cells along one axis: a building has thousands, noise has as many as cells."""


class Grid(NamedTuple):
    """Cells (row, column) laid into the world; what is outside them is free.

    free: (rows, columns), 0 in a solid cell, else the chessboard distance to the nearest solid
    cell: all cells nearer than that are free, so a ray may jump over them. resolution: side of a
    cell [m]. origin: world pose of the outer corner of cell (0, 0); columns run along its x axis
    and rows along its y axis, as in nav_msgs/OccupancyGrid.
    """

    free: NDArray[np.uint16]
    resolution: float
    origin: Pose


def grid(solid: NDArray[np.bool_], resolution: float, origin: Pose) -> Grid:
    """A grid from solid cells, (rows, columns).

    Raises CohelmError unless the resolution is positive and the origin finite.
    """
    if solid.ndim != 2:
        raise CohelmError(f"an occupancy map has rows and columns, got shape {solid.shape}")
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise CohelmError(f"a map's resolution must be a positive number of m, got {resolution}")
    if not all(math.isfinite(value) for value in origin):
        raise CohelmError(f"a map's origin must be finite, got {tuple(origin)}")
    if solid.any():
        distance = scipy.ndimage.distance_transform_cdt(~solid, metric="chessboard")
        free = np.minimum(distance, _FARTHEST).astype(np.uint16)
    else:
        free = np.full(solid.shape, min(max(solid.shape), _FARTHEST), dtype=np.uint16)
    place = Pose(*(float(value) for value in origin))
    return Grid(np.ascontiguousarray(free), float(resolution), place)


NO_GRID = grid(np.zeros((0, 0), dtype=np.bool_), 1.0, Pose(0.0, 0.0, 0.0))
"""For worlds without an occupancy map."""


@jit
def cast(grid: Grid, x: float, y: float, dx: float, dy: float, reach: float) -> float:
    """Distance along the ray from (x, y) to the first solid cell [m], inf beyond `reach`.

    (dx, dy) is a unit vector; both are in the world frame. Cell borders are crossed in order
    (Amanatides & Woo 1987), and runs of free cells are jumped over at once; a border's distance
    is always computed from its index, so the result is the same with and without the jumps.
    """
    rows, columns = grid.free.shape
    c, s = math.cos(grid.origin.psi), math.sin(grid.origin.psi)
    wx, wy = x - grid.origin.x, y - grid.origin.y
    # in cells, in the grid's own axes
    x0, y0 = (c * wx + s * wy) / grid.resolution, (-s * wx + c * wy) / grid.resolution
    ex, ey = c * dx + s * dy, -s * dx + c * dy
    end = reach / grid.resolution
    enter, leave = 0.0, end
    for start, slope, size in ((x0, ex, columns), (y0, ey, rows)):
        if slope != 0.0:
            a, b = -start / slope, (size - start) / slope
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        elif not 0.0 <= start < size:
            return math.inf
    if not enter <= leave:  # passes by, or something is not a number
        return math.inf
    t = enter
    i = min(max(math.floor(x0 + t * ex), 0), columns - 1)
    j = min(max(math.floor(y0 + t * ey), 0), rows - 1)
    while True:
        d = int(grid.free[j, i])
        if d == 0:
            return t * grid.resolution
        # leave the block of free cells around (i, j) through its nearer border
        bx = i + d if ex > 0.0 else i - d + 1
        by = j + d if ey > 0.0 else j - d + 1
        tx = (bx - x0) / ex if ex != 0.0 else math.inf
        ty = (by - y0) / ey if ey != 0.0 else math.inf
        if tx < ty:
            t = tx
            i = bx if ex > 0.0 else bx - 1
            j = _index(y0, ey, t, j, d, True)
        else:
            t = ty
            j = by if ey > 0.0 else by - 1
            i = _index(x0, ex, t, i, d, False)
        if not t < end or not (0 <= i < columns and 0 <= j < rows):
            return math.inf


@jit
def _index(start: float, slope: float, t: float, before: int, d: int, first: bool) -> int:
    """The cell in which a coordinate is at t, having been in `before`, at most d - 1 away.

    The guess from the position is put right by the same comparison of border distances that a
    step-by-step walk makes, so that rounding can not put the ray on the other side of a corner.
    Exactly through a corner the walk crosses the border in y `first`.
    """
    if slope == 0.0:
        return before
    guess = math.floor(start + t * slope)
    if slope > 0.0:
        guess = min(max(guess, before), before + d - 1)
        while guess < before + d - 1 and _crossed((guess + 1 - start) / slope, t, first):
            guess += 1
        while guess > before and not _crossed((guess - start) / slope, t, first):
            guess -= 1
    else:
        guess = max(min(guess, before), before - d + 1)
        while guess > before - d + 1 and _crossed((guess - start) / slope, t, first):
            guess -= 1
        while guess < before and not _crossed((guess + 1 - start) / slope, t, first):
            guess += 1
    return guess


@jit
def _crossed(border: float, t: float, first: bool) -> bool:
    return border <= t if first else border < t


def solid_at(grid: Grid, x: float, y: float) -> bool:
    """Whether a world point is in a solid cell."""
    c, s = math.cos(grid.origin.psi), math.sin(grid.origin.psi)
    dx, dy = x - grid.origin.x, y - grid.origin.y
    column = math.floor((c * dx + s * dy) / grid.resolution)
    row = math.floor((-s * dx + c * dy) / grid.resolution)
    rows, columns = grid.free.shape
    return 0 <= row < rows and 0 <= column < columns and bool(grid.free[row, column] == 0)


def borders(grid: Grid) -> Floats:
    """The borders between solid and free cells as walls, (s, 4) segments in the world frame [m].

    Runs along a row or column are one wall. What is outside the grid counts as free. Raises
    CohelmError for more than MOST_WALLS.
    """
    solid = np.pad(grid.free == 0, 1)
    cells: list[Floats] = []
    for turned in (False, True):
        edge = np.diff((solid.T if turned else solid).astype(np.int8), axis=0) != 0
        step = np.diff(edge.astype(np.int8), axis=1)  # the padding keeps the ends of rows False
        found = int(np.count_nonzero(step == 1))
        if found > MOST_WALLS:
            raise CohelmError(
                f"the map has {found} borders of solid cells, and {MOST_WALLS} are the most that a "
                "world may have: clear it of noise, or make it coarser"
            )
        line, first = np.nonzero(step == 1)
        _, last = np.nonzero(step == -1)
        across = line.astype(np.float64)
        ends = (first.astype(np.float64), across, last.astype(np.float64), across)
        order = (1, 0, 3, 2) if turned else (0, 1, 2, 3)
        cells.append(np.column_stack([ends[k] for k in order]))
    local = np.concatenate(cells).reshape(-1, 2) * grid.resolution
    return placed(local, grid.origin).reshape(-1, 4)
