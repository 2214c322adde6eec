"""Plans a path around obstacles: A* on a distance field, then an elastic band."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.types import Floats, Ints, Pose
from cohelm.plan.distance_field import (
    DistanceField,
    clearance,
    distance_field,
    inscribed_radius,
    swept_clearances,
)
from cohelm.plan.distance_transform import nearest_occupied
from cohelm.plan.elastic_band import band, distances, pull, spread, tangents
from cohelm.plan.heap import pop, push
from cohelm.robot.footprint import farthest_corner

_LEAVE = 0.4  # radius within which a start in a tight place may be left [m]
_BLOCKED_RADIUS = 0.1  # radius blocked around a pose in collision before the next try [m]
_BACK = 0.5  # nearer again, a line has come back, and is not only winding [m]
_TRIES = 3  # paths whose swept outline collides, before giving up


class PathParams(NamedTuple):
    """Parameters of the path planner."""

    clearance: float = 0.04
    """Smallest clearance of the swept outline [m]."""
    room: float = 0.3
    """Clearance beside the robot above which the cost no longer decreases [m]."""
    shy: float = 3.0
    """Additional cost factor at the smallest clearance."""
    beside: float = 0.5
    """Distance from the line's end at which a path may end if that is occupied [m]."""
    stray: float = 0.15
    """Relative cost per metre of distance from the given line; 0 to ignore the line [1/m]."""
    loyal: float = 0.2
    """Relative cost at half a metre or more from the previous path, so that the robot does not
    switch between two similar paths."""
    border: float = 1.5
    """Border of the grid around robot and line [m]; three times as much if there is no path."""
    resolution: float = 0.05
    """Cell size of the grid [m]."""
    spacing: float = 0.1
    """Between the waypoints [m]."""
    rounds: int = 120
    """Iterations of the elastic band."""
    gaps: bool = True
    """Whether to go straight through a gap in which the outline would not fit askew; not where
    movers are about: between them it closes."""


_PATH_PARAMS = PathParams()
_NONE: Floats = np.empty((0, 2))


class Goal(NamedTuple):
    """A goal position, world frame [m]."""

    x: float
    y: float


class PlannedPath(NamedTuple):
    """Waypoints to follow, and their clearance."""

    points: Floats
    """From the robot to the re-entry point of the line, (m, 2), world frame [m]; a single one if
    the robot is there already."""
    rejoined: int
    """Row of the given line at which the path ends."""
    clearance: float
    """Smallest clearance of the outline along it, with the heading of the path [m]."""


def plan_path(
    pose: Pose, points: Floats, line: Floats, outline: Floats,
    path_params: PathParams = _PATH_PARAMS, here: int = 0, horizon: float = math.inf,
    farther: bool = True, chosen: Floats = _NONE,
) -> PlannedPath | None:  # fmt: skip
    """A path from the robot back onto a line, around all points; None if none is found.

    pose, points (p, 2), line (k, 2) with k >= 2, about `spacing` apart: world frame [m].
    outline: (n, 2), convex, counter-clockwise. here: the row of the line where the robot is.
    The path ends on the line `horizon` metres farther on, or before that where the line begins to
    come back, so that it is not cut short; farther on if that can not be reached, at the latest at
    the line's end, or up to `beside` from it. Unknown space counts as free. farther: whether to
    search beyond `border`, which takes longer, if there is none nearer. chosen: (m, 2), the current
    path [m]; see `PathParams.loyal`.
    """
    aim = here + _outward(line[here:], horizon)
    min_clearance = inscribed_radius(outline) + path_params.clearance
    turning_clearance = farthest_corner(outline) + path_params.clearance
    for border in (path_params.border, 3.0 * path_params.border)[: 2 if farther else 1]:
        span = np.vstack((line[here:], [pose[:2]]))
        low, high = span.min(axis=0) - border, span.max(axis=0) + border
        field = distance_field(points, (low[0], low[1]), (high[0], high[1]), path_params.resolution)
        cells = _cells(field, line[here:])
        cell_costs = line_costs(field, cells, path_params)
        if len(chosen):
            cell_costs *= switching_costs(field, chosen, path_params)
        for _ in range(_TRIES):
            found = cheapest_path(
                field, cell_costs, cells, pose, line, here, aim, min_clearance, turning_clearance,
                path_params,
            )  # fmt: skip
            if found is None:
                break
            path, rejoined = found
            if len(path) == 1:
                return PlannedPath(path, rejoined, math.inf)
            smooth = band(
                field, path, pose, min_clearance + path_params.room, path_params.spacing,
                path_params.rounds,
            )  # fmt: skip
            poses, clearances = _swept(smooth, points, outline)
            if clearances.min() >= path_params.clearance:
                return PlannedPath(smooth, rejoined, float(clearances.min()))
            straight = None
            if path_params.gaps:
                straight = _through_gaps(field, smooth, points, outline, min_clearance, path_params)
            if straight is not None:
                return PlannedPath(straight[0], rejoined, straight[1])
            if clearances[-1] < path_params.clearance:  # it can not face there as the path ends
                ends = field.clearance[cells[aim - here :, 0], cells[aim - here :, 1]]
                aim += int(np.argmax(ends >= turning_clearance))
            for x, y, _psi in poses[clearances < path_params.clearance]:
                field.clearance[_within(field, _cell(field, (x, y)), _BLOCKED_RADIUS)] = 0.0
    return None


def _swept(line: Floats, points: Floats, outline: Floats) -> tuple[Floats, Floats]:
    """The poses along a path, and the outline's clearances there; infinite at the first, where the
    robot is already, with any heading."""
    poses = tangents(line)
    clearances = swept_clearances(points, outline, poses)
    clearances[0] = math.inf
    return poses, clearances


def _through_gaps(
    field: DistanceField, line: Floats, points: Floats, outline: Floats, min_clearance: float,
    path_params: PathParams,
) -> tuple[Floats, float] | None:  # fmt: skip
    """A path that goes straight through the gaps in which the outline is too near to obstacles, and
    its smallest clearance; None if that is still too small [m]."""
    for _ in range(_TRIES):
        _, clearances = _swept(line, points, outline)
        tight = clearances < path_params.clearance
        if not tight.any():
            return line, float(clearances.min())
        straight = through_gap(
            field, line, int(np.argmax(tight)), points, outline, min_clearance, path_params
        )
        if straight is None:
            break
        line = straight
    return None


def through_gap(
    field: DistanceField, line: Floats, k: int, points: Floats, outline: Floats,
    min_clearance: float, path_params: PathParams,
) -> Floats | None:  # fmt: skip
    """A path (m, 2) that goes straight through the gap at its point k; None where there is none.

    A band is as short as it can be, so it turns in a door, where a robot that is longer than wide
    does not fit. While any part of it is between the nearest obstacles left and right of the path,
    it goes along their perpendicular bisector instead.
    """
    reach = farthest_corner(outline)
    beyond = 2.0 * path_params.spacing
    before, after = float(outline[:, 0].max()) + beyond, float(-outline[:, 0].min()) + beyond
    along = distances(line)
    near = np.flatnonzero(np.abs(along - along[k]) <= reach)
    m = int(near[np.argmin([clearance(field, x, y) for x, y in line[near]])])
    gap = _gap(line, m, points, 2.0 * (reach + path_params.clearance))
    if gap is None:
        return None
    middle, normal = gap
    off = (line - middle) @ normal
    enters, leaves = np.flatnonzero(off[:m] < -before), np.flatnonzero(off[m:] > after)
    if not len(enters) or not len(leaves):
        return None
    a, b = middle - before * normal, middle + after * normal
    to = spread(np.vstack((line[: enters[-1] + 1], a)), path_params.spacing)
    back = spread(np.vstack((b, line[m + leaves[0] :])), path_params.spacing)
    wanted = min_clearance + path_params.room
    pull(field, to, min(2, len(to)), wanted, path_params.rounds)
    pull(field, back, 1, wanted, path_params.rounds)
    return np.vstack((to, spread(np.vstack((a, b)), path_params.spacing)[1:-1], back))


def _gap(line: Floats, m: int, points: Floats, widest: float) -> tuple[Floats, Floats] | None:
    """The middle of the gap at point m of a path, and its direction, (2,) each; None without
    obstacles on both sides, or where they are farther apart than `widest` [m]."""
    ahead = line[min(m + 1, len(line) - 1)] - line[max(m - 1, 0)]
    off = points - line[m]
    left = ahead[0] * off[:, 1] - ahead[1] * off[:, 0]
    away = np.hypot(off[:, 0], off[:, 1])
    if not (left > 0.0).any() or not (left < 0.0).any():
        return None
    one = points[np.argmin(np.where(left > 0.0, away, math.inf))]
    other = points[np.argmin(np.where(left < 0.0, away, math.inf))]
    across = one - other
    width = float(np.hypot(*across))
    if not 0.0 < width <= widest:
        return None
    normal = np.array([across[1], -across[0]]) / width
    return 0.5 * (one + other), normal if normal @ ahead > 0.0 else -normal


def _outward(line: Floats, horizon: float) -> int:
    """The row of a line that is farthest from its first, before it comes back by `_BACK` or is
    longer than `horizon` [m]."""
    within = int(np.searchsorted(distances(line), horizon)) + 1
    away = np.hypot(*(line[:within] - line[0]).T)
    back = int(np.argmax(np.maximum.accumulate(away) - away > _BACK))  # 0: it does not
    return int(np.argmax(away[: back or None]))


def line_costs(field: DistanceField, cells: Ints, path_params: PathParams) -> Floats:
    """Cost factor of each cell by its distance from the cells (k, 2) of a line."""
    if path_params.stray == 0.0:
        return np.ones(field.clearance.shape)
    return 1.0 + path_params.stray * _distance_to(field, cells, 3.0)


def switching_costs(field: DistanceField, chosen: Floats, path_params: PathParams) -> Floats:
    """Cost factor of each cell by its distance from a path, (m, 2) [m]."""
    return 1.0 + path_params.loyal * 2.0 * _distance_to(field, _cells(field, chosen), 0.5)


@jit
def _distance_to(field: DistanceField, cells: Ints, most: float) -> Floats:
    """The distance of each cell from the nearest of some (k, 2), k >= 1, at most `most` [m]."""
    distances = np.full(field.clearance.shape, most)
    border = math.ceil(most / field.resolution)
    top, left = max(cells[:, 0].min() - border, 0), max(cells[:, 1].min() - border, 0)
    part = distances[top : cells[:, 0].max() + border + 1, left : cells[:, 1].max() + border + 1]
    on = np.zeros(part.shape, np.bool_)
    for k in range(len(cells)):
        on[cells[k, 0] - top, cells[k, 1] - left] = True
    nearest = nearest_occupied(on)
    for i in range(part.shape[0]):
        for j in range(part.shape[1]):
            di, dj = nearest[i, j] // part.shape[1] - i, nearest[i, j] % part.shape[1] - j
            part[i, j] = min(math.sqrt(float(di * di + dj * dj)) * field.resolution, most)
    return distances


def cheapest_path(
    field: DistanceField, cell_costs: Floats, cells: Ints, start: Pose, line: Floats, here: int,
    aim: int, min_clearance: float, turning_clearance: float, path_params: PathParams,
) -> tuple[Floats, int] | None:  # fmt: skip
    """Cell centres of the cheapest path from the robot to the line, (m, 2) [m].

    cell_costs: of the field's shape, factors; see `line_costs`. cells: (k, 2), of the line from row
    `here` on.

    It ends at the first point of the line, from row `aim` on, that can be reached; the row is
    the second result. All its cells have `min_clearance`, but a tighter start may be left through
    cells that are no tighter. If not even the line's end can be reached, it ends at the nearest
    cell in which the robot can turn (`turning_clearance`); else there is no path."""
    c = field.clearance
    a = _cell(field, start[:2])
    free = c >= min_clearance
    if not free[a]:
        free |= _within(field, a, _LEAVE) & (c >= min(c[a], min_clearance)) & (c > 0.0)
        free[a] = True
    cost = cell_costs * _tightness_costs(c, min_clearance, path_params.room, path_params.shy)
    columns = c.shape[1]
    root = a[0] * columns + a[1]
    beside = _turnable(field, cells[-1], path_params.beside, turning_clearance)
    ends = np.vstack((cells[aim - here :], beside))
    open_ends = np.flatnonzero(free[ends[:, 0], ends[:, 1]])
    if not open_ends.size:
        return None
    flat_ends = ends[:, 0] * columns + ends[:, 1]
    before = tree(free, cost, root, int(flat_ends[open_ends[0]]))
    reached = np.flatnonzero(before[flat_ends] != NOT_REACHED)
    if not reached.size:
        return None
    best = int(reached[0])
    rejoined = min(aim + best, len(line) - 1)
    end = line[rejoined]
    if aim + best >= len(line):
        end = np.array([field.x, field.y]) + field.resolution * ends[best, ::-1]
    visited = [int(flat_ends[best])]
    while visited[-1] != root:
        visited.append(int(before[visited[-1]]))
    i, j = np.divmod(np.array(visited[::-1]), columns)
    path = np.empty((len(visited), 2))
    path[:, 0] = field.x + field.resolution * j
    path[:, 1] = field.y + field.resolution * i
    path[-1] = end
    return path, rejoined


@jit
def _tightness_costs(clearance: Floats, least: float, room: float, shy: float) -> Floats:
    """Cost factor of each cell by its clearance: 1 from `room` above the least on [m]."""
    costs = np.empty(clearance.shape)
    for i in range(clearance.shape[0]):
        for j in range(clearance.shape[1]):
            tight = min(max((least + room - clearance[i, j]) / room, 0.0), 1.0)
            costs[i, j] = 1.0 + shy * tight * tight
    return costs


def _cell(field: DistanceField, at: Floats | tuple[float, ...]) -> tuple[int, int]:
    """Row and column of a world point, of the border for one outside."""
    rows, columns = field.clearance.shape
    i = round((at[1] - field.y) / field.resolution)
    j = round((at[0] - field.x) / field.resolution)
    return min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)


def _cells(field: DistanceField, points: Floats) -> Ints:
    """Row and column of many world points (k, 2), as `_cell` has them, (k, 2)."""
    rows, columns = field.clearance.shape
    off = (points - np.array([field.x, field.y])) / field.resolution
    found = np.rint(off[:, ::-1]).astype(np.int64)
    return np.clip(found, 0, np.array([rows - 1, columns - 1]))


def _within(field: DistanceField, cell: tuple[int, int], radius: float) -> NDArray[np.bool_]:
    """The cells within a radius of one [m]."""
    near = np.zeros(field.clearance.shape, np.bool_)
    far = radius / field.resolution
    top, left = max(cell[0] - int(far), 0), max(cell[1] - int(far), 0)
    part = near[top : cell[0] + int(far) + 1, left : cell[1] + int(far) + 1]
    i, j = np.ogrid[top : top + part.shape[0], left : left + part.shape[1]]
    part[:] = (i - cell[0]) ** 2 + (j - cell[1]) ** 2 <= far * far
    return near


@jit
def _turnable(field: DistanceField, cell: Ints, radius: float, least: float) -> Ints:
    """The cells within a radius of one [m] with at least a clearance [m], the nearest first,
    (k, 2)."""
    rows, columns = field.clearance.shape
    far = radius / field.resolution
    border = int(far)
    found, n = np.empty(((2 * border + 1) ** 2, 3), np.int64), 0
    for i in range(max(cell[0] - border, 0), min(cell[0] + border + 1, rows)):
        for j in range(max(cell[1] - border, 0), min(cell[1] + border + 1, columns)):
            square = (i - cell[0]) ** 2 + (j - cell[1]) ** 2
            if square <= far * far and field.clearance[i, j] >= least:
                found[n, 0], found[n, 1], found[n, 2] = square, i, j
                n += 1
    return found[:n][np.argsort(found[:n, 0], kind="mergesort"), 1:]


NOT_REACHED = -1


@jit
def tree(free: NDArray[np.bool_], cost: Floats, root: int, target: int) -> Ints:
    """The cheapest 8-connected paths from a free cell, until the target's is known: A* (Hart,
    Nilsson & Raphael 1968) on a binary heap.

    free, cost: (rows, columns); a step costs its length in cells times the mean cost of its two
    ends, and cost >= 1. root, target: flat indices. Returns for each cell the flat index of the
    one before it, the root for itself, NOT_REACHED where no path leads; (rows * columns,). Cells
    that cost more than the target are undefined; without a path to it, all are defined.
    """
    rows, columns = free.shape
    n = rows * columns
    before = np.full(n, NOT_REACHED)
    if not free.flat[root]:
        return before
    spent = np.full(n, math.inf)
    settled = np.zeros(n, dtype=np.bool_)
    keys, cells = np.empty(8 * n + 8), np.empty(8 * n + 8, dtype=np.int64)
    to_i, to_j = target // columns, target % columns
    spent[root], before[root] = 0.0, root
    size = push(keys, cells, 0, _at_least(root // columns, root % columns, to_i, to_j), root)
    while size > 0:
        cell = cells[0]
        size = pop(keys, cells, size)
        if settled[cell]:
            continue
        settled[cell] = True
        if cell == target:
            break
        i, j = cell // columns, cell % columns
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if (di == 0 and dj == 0) or not (0 <= a < rows and 0 <= b < columns):
                    continue
                if not free[a, b]:
                    continue
                other = a * columns + b
                length = 1.4142135623730951 if di != 0 and dj != 0 else 1.0
                mean = 0.5 * (cost[i, j] + cost[a, b])
                there = float(spent[cell] + length * mean)
                if there < spent[other]:
                    spent[other], before[other] = there, cell
                    guess = there + _at_least(a, b, to_i, to_j)
                    size = push(keys, cells, size, guess, other)
    return before


@jit_no_refcount
def _at_least(i: int, j: int, to_i: int, to_j: int) -> float:
    """The distance to the target where all is free and costs 1 [cells]."""
    di, dj = abs(i - to_i), abs(j - to_j)
    return max(di, dj) + 0.41421356237309503 * min(di, dj)
