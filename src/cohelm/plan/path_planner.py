"""Plans a path round obstacles: A* on the distance field, then an elastic band."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints, Pose
from cohelm.plan.astar import NOT_REACHED, tree
from cohelm.plan.distance_field import Chart, chart, inscribed, swept
from cohelm.plan.elastic_band import band, distances, tangents

_LEAVE = 0.4  # a start tighter than wished for may be left within this distance [m]
_REFUSED = 0.1  # around a pose that touches something, no second way is tried [m]
_TRIES = 3  # ways whose swept outline touches something before giving up


class PathParams(NamedTuple):
    """What makes a way good."""

    clearance: float = 0.04
    """Least clearance of the swept outline [m]."""
    room: float = 0.3
    """Clearance beside the robot from which more is not better [m]."""
    shy: float = 3.0
    """How many times dearer a metre is where it is tightest."""
    beside: float = 0.5
    """How far from the line's end a way may end where the end is taken [m]."""
    stray: float = 0.15
    """Share dearer a metre is, per metre away from the given line; 0 to ignore the line [1/m]."""
    loyal: float = 0.2
    """Share dearer a metre is, half a metre or more away from the way chosen before: of two that
    are about as good, the robot does not take now one, now the other."""
    border: float = 1.5
    """How far beyond robot and line a way is looked for [m]; three times as far if there is
    none."""
    resolution: float = 0.05
    """Cells of the chart [m]."""
    spacing: float = 0.1
    """Between the way-points [m]."""
    rounds: int = 120
    """Of pulling the band straight."""


_PATH_PARAMS = PathParams()
_NONE: Floats = np.empty((0, 2))


class Goal(NamedTuple):
    """Where to go, by whatever way, world frame [m]."""

    x: float
    y: float


class Way(NamedTuple):
    """Way-points to follow, and what they leave."""

    points: Floats
    """From the robot to the rejoined point of the line, (m, 2), world frame [m]; a single one
    where the robot is there already."""
    rejoined: int
    """Row of the given line at which the way ends."""
    clearance: float
    """Least clearance of the outline along it, with the heading of the way [m]."""


def way(
    pose: Pose, points: Floats, line: Floats, outline: Floats,
    path_params: PathParams = _PATH_PARAMS, begin: int = 0, horizon: float = math.inf,
    farther: bool = True, chosen: Floats = _NONE,
) -> Way | None:  # fmt: skip
    """A way from the robot back onto a line, around all points seen; None if none is known.

    pose, points (p, 2), line (k, 2) with k >= 2, about `spacing` apart: world frame [m].
    outline: (n, 2), convex, counter-clockwise. begin: the row of the line that is behind the
    robot for good. The way ends on the line `horizon` metres after the row nearest to the robot,
    or farther on where that can not be reached; at the latest at the line's end, or up to
    `beside` from it. What has not been seen counts as free. farther: whether to look beyond
    `border`, which takes a while, if there is none nearer. chosen: (m, 2), the way that the robot
    is on [m]; see `PathParams.loyal`.
    """
    off = line[begin:] - np.array(pose[:2])
    here = begin + int(np.argmin(np.hypot(off[:, 0], off[:, 1])))
    along = distances(line[here:])
    aim = here + min(int(np.searchsorted(along, horizon)), len(along) - 1)
    narrow = inscribed(outline) + path_params.clearance
    wide = float(np.hypot(outline[:, 0], outline[:, 1]).max()) + path_params.clearance
    for border in (path_params.border, 3.0 * path_params.border)[: 2 if farther else 1]:
        span = np.vstack((line[here:], [pose[:2]]))
        low, high = span.min(axis=0) - border, span.max(axis=0) + border
        known = chart(points, (low[0], low[1]), (high[0], high[1]), path_params.resolution)
        cells = _cells(known, line[here:])
        dear = straying(known, cells, path_params)
        if len(chosen):
            dear *= disloyal(known, chosen, path_params)
        for _ in range(_TRIES):
            found = cheapest(known, dear, cells, pose, line, here, aim, narrow, wide, path_params)
            if found is None:
                break
            path, rejoined = found
            if len(path) == 1:
                return Way(path, rejoined, math.inf)
            smooth = band(
                known,
                path,
                pose,
                narrow + path_params.room,
                path_params.spacing,
                path_params.rounds,
            )
            poses = tangents(smooth)
            clearances = swept(points, outline, poses)
            clearances[0] = math.inf  # the robot is there already, whatever its heading
            if clearances.min() >= path_params.clearance:
                return Way(smooth, rejoined, float(clearances.min()))
            for x, y, _psi in poses[clearances < path_params.clearance]:
                known.clearance[_within(known, _cell(known, (x, y)), _REFUSED)] = 0.0
    return None


def straying(chart: Chart, cells: Ints, path_params: PathParams) -> Floats:
    """How many times dearer each cell of a chart is for its distance from a line's (k, 2)."""
    if path_params.stray == 0.0:
        return np.ones(chart.clearance.shape)
    return 1.0 + path_params.stray * np.minimum(_away(chart, cells), 3.0)


def disloyal(chart: Chart, chosen: Floats, path_params: PathParams) -> Floats:
    """How many times dearer each cell of a chart is for its distance from a way, (m, 2) [m]."""
    away = _away(chart, _cells(chart, chosen))
    return 1.0 + path_params.loyal * np.minimum(2.0 * away, 1.0)


def _away(chart: Chart, cells: Ints) -> Floats:
    """The distance of each cell of a chart from the nearest of some (k, 2), k >= 1 [m]."""
    off = np.ones(chart.clearance.shape, dtype=np.bool_)
    off[cells[:, 0], cells[:, 1]] = False
    return np.asarray(scipy.ndimage.distance_transform_edt(off)) * chart.resolution


def cheapest(
    chart: Chart, dear: Floats, cells: Ints, start: Pose, line: Floats, here: int, aim: int,
    narrow: float, wide: float, path_params: PathParams,
) -> tuple[Floats, int] | None:  # fmt: skip
    """Cell centres from the robot to a point of the line, dear where it is tight, (m, 2) [m].

    dear: of the chart's shape, by what a cell costs more; see `straying`. cells: (k, 2), of the
    line from row `here` on.

    It ends at the first point of the line, from row `aim` on, that can be reached; the row is
    the second result. No cell nearer than `narrow` to what was seen is on it, but a tighter
    start may be left through cells that are no tighter. Where not even the line's end can be
    reached, the nearest cell is taken in which the robot can turn (`wide`), or there is no way.
    """
    c = chart.clearance
    a = _cell(chart, start[:2])
    free = c >= narrow
    if not free[a]:
        free |= _within(chart, a, _LEAVE) & (c >= min(c[a], narrow)) & (c > 0.0)
        free[a] = True
    tight = np.clip((narrow + path_params.room - c) / path_params.room, 0.0, 1.0)
    cost: Floats = (1.0 + path_params.shy * tight * tight) * dear
    columns = c.shape[1]
    root = a[0] * columns + a[1]
    target = cells[aim - here]
    flat = tree(free, cost, root, int(target[0] * columns + target[1]))
    before = flat.reshape(c.shape)
    rejoined = len(line) - 1
    reached = np.flatnonzero(before[cells[aim - here :, 0], cells[aim - here :, 1]] != NOT_REACHED)
    if reached.size:
        rejoined = aim + int(reached[0])
        b, end = (int(cells[rejoined - here, 0]), int(cells[rejoined - here, 1])), line[rejoined]
    else:
        last = (int(cells[-1, 0]), int(cells[-1, 1]))
        near = (before != NOT_REACHED) & (c >= wide) & _within(chart, last, path_params.beside)
        i, j = np.nonzero(near)
        if len(i) == 0:
            return None
        best = int(np.argmin((i - last[0]) ** 2 + (j - last[1]) ** 2))
        b = (int(i[best]), int(j[best]))
        end = np.array([chart.x + chart.resolution * b[1], chart.y + chart.resolution * b[0]])
    walk = [b[0] * columns + b[1]]
    while walk[-1] != root:
        walk.append(int(flat[walk[-1]]))
    i, j = np.divmod(np.array(walk[::-1]), columns)
    path = np.empty((len(walk), 2))
    path[:, 0] = chart.x + chart.resolution * j
    path[:, 1] = chart.y + chart.resolution * i
    path[-1] = end
    return path, rejoined


def _cell(chart: Chart, at: Floats | tuple[float, ...]) -> tuple[int, int]:
    """Row and column of a world point, of the border for one outside."""
    rows, columns = chart.clearance.shape
    i = round((at[1] - chart.y) / chart.resolution)
    j = round((at[0] - chart.x) / chart.resolution)
    return min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)


def _cells(chart: Chart, points: Floats) -> Ints:
    """Row and column of many world points (k, 2), as `_cell` has them, (k, 2)."""
    rows, columns = chart.clearance.shape
    off = (points - np.array([chart.x, chart.y])) / chart.resolution
    found = np.rint(off[:, ::-1]).astype(np.int64)
    return np.clip(found, 0, np.array([rows - 1, columns - 1]))


def _within(chart: Chart, cell: tuple[int, int], radius: float) -> NDArray[np.bool_]:
    """The cells within a radius [m] of one."""
    rows, columns = chart.clearance.shape
    i, j = np.ogrid[:rows, :columns]
    far = radius / chart.resolution
    return (i - cell[0]) ** 2 + (j - cell[1]) ** 2 <= far * far
