"""A map for localization: wall surfaces, free space, distance field, and expected ranges."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import eye, placed, turned
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose
from cohelm.perceive.match.surfaces import FlatPoints, Surfaces, one_each, row_at, surfaces
from cohelm.robot.sensors import Lidar

_FARTHEST = 2.0  # cap of the distances to walls [m]
_REACH = 0.6  # surfaces are found from as far as this [m]
_SIDE = 0.2  # spacing of the places for the search [m]
_ROOM = 0.2  # and their least distance to a wall [m]
_LOOK = "look at the thresholds, negate and mode in its YAML file, or map it again"
MOST_BORDER = 500_000
"""Limit of occupied cells beside free ones: 12 km of wall, seen from both sides, at 5 cm. As many
take some seconds and a GB; a noisy map, in which every other cell is one, would take hours."""


class LocalizationMap(NamedTuple):
    """surfaces: of all walls, world frame. gap: (rows, columns), distance of a cell's centre to
    the nearest occupied one's, 2 m at most [m]. unknown: (rows, columns), unobserved
    cells. resolution [m]; origin: world pose of the outer corner of cell (0, 0). places: (k, 2),
    candidate positions for the search, world frame [m]."""

    surfaces: Surfaces
    gap: NDArray[np.float32]
    unknown: NDArray[np.bool_]
    resolution: float
    origin: Pose
    places: Floats


def map_from_occupancy(
    occupied: NDArray[np.bool_], free: NDArray[np.bool_], resolution: float, origin: Pose
) -> LocalizationMap:
    """From the cells of an occupancy map, (rows, columns), row 0 at the smallest y.

    Surfaces are where occupied cells border on free ones, on a line fitted to neighbours that face
    the same way: each side of a wall is its own surface, with a normal towards its free side.
    Raises CohelmError where nothing is occupied, nothing free, or more than MOST_BORDER cells are
    on a border."""
    if not occupied.any():
        raise CohelmError(f"the map has no occupied cell, so nothing to localise by: {_LOOK}")
    if not free.any():
        raise CohelmError(f"the map has no free cell, so nowhere to be: {_LOOK}")
    border = occupied & ~scipy.ndimage.binary_erosion(
        occupied, np.ones((3, 3), dtype=np.int64), border_value=1
    )
    found = int(np.count_nonzero(border))
    if found > MOST_BORDER:
        raise CohelmError(
            f"the map has {found} cells on the border of what is occupied, and {MOST_BORDER} are "
            "the most to localise by: clear it of noise, or make it coarser"
        )
    cells, facing = _faces(occupied, free)
    if 2 * len(cells) < found:  # free space does not reach half of the walls
        beside = scipy.ndimage.binary_dilation(free, iterations=3, mask=~occupied)
        cells, facing = _faces(occupied, beside)
    lined = _lined(cells * resolution, facing, max(0.15, 3.0 * resolution))
    points, normals = one_each(lined, max(0.03, resolution))
    flat = FlatPoints(placed(points, origin), turned(normals, origin.psi))
    distance = scipy.ndimage.distance_transform_edt(~occupied) * resolution
    gap = np.minimum(distance, _FARTHEST).astype(np.float32)
    every = max(round(_SIDE / resolution), 1)
    rows, columns = np.mgrid[every // 2 : len(free) : every, every // 2 : free.shape[1] : every]
    open_ = (free & (gap > _ROOM))[rows, columns]
    own = np.column_stack((columns[open_] + 0.5, rows[open_] + 0.5)) * resolution
    return LocalizationMap(
        surfaces(flat, max(resolution, 0.025), _REACH, back=True),
        gap, ~(occupied | free), float(resolution), origin, placed(own, origin),
    )  # fmt: skip


def _faces(occupied: NDArray[np.bool_], free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Sides of occupied cells that border on free ones: the cell's centre, and the direction to the
    free one, in cells, (n, 2) each. A wall one cell thick has a side on either hand."""
    cells: list[Floats] = []
    facing: list[Floats] = []
    wide = np.pad(free, 1)
    for column, row in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        height, width = occupied.shape
        beside = wide[1 + row : 1 + row + height, 1 + column : 1 + column + width]
        found = np.argwhere(occupied & beside)[:, ::-1]
        cells.append(np.asarray(found + 0.5, dtype=np.float64))
        facing.append(np.tile(np.array([float(column), float(row)]), (len(found), 1)))
    return np.vstack(cells), np.vstack(facing)


def _lined(points: Floats, facing: Floats, reach: float) -> FlatPoints:
    """Points on the line fitted to neighbours within `reach` [m] that do not face the other way,
    and its normal, to the side that they face."""
    pairs = scipy.spatial.cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", facing[pairs[:, 0]], facing[pairs[:, 1]]) > -0.5]
    return _fitted(points, facing, np.vstack((pairs, pairs[:, ::-1])))


@jit
def _fitted(points: Floats, facing: Floats, pairs: NDArray[np.int64]) -> FlatPoints:
    n = len(points)
    sums = np.zeros((n, 6))
    sides = facing.copy()
    for i in range(n):
        sums[i, 0] = 1.0
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        sums[i, 0] += 1.0
        sums[i, 1] += dx
        sums[i, 2] += dy
        sums[i, 3] += dx * dx
        sums[i, 4] += dx * dy
        sums[i, 5] += dy * dy
        sides[i] += facing[j]
    out, normals = np.empty((n, 2)), np.empty((n, 2))
    m = 0
    for i in range(n):
        k, sx, sy = sums[i, 0], sums[i, 1], sums[i, 2]
        if k < 3.0:
            continue
        a = sums[i, 3] - sx * sx / k
        b = sums[i, 4] - sx * sy / k
        c = sums[i, 5] - sy * sy / k
        turn = 0.5 * math.atan2(2.0 * b, a - c)
        nx, ny = -math.sin(turn), math.cos(turn)
        if nx * sides[i, 0] + ny * sides[i, 1] < 0.0:
            nx, ny = -nx, -ny
        off = (sx * nx + sy * ny) / k
        out[m, 0], out[m, 1] = points[i, 0] + off * nx, points[i, 1] + off * ny
        normals[m, 0], normals[m, 1] = nx, ny
        m += 1
    return FlatPoints(out[:m].copy(), normals[:m].copy())


@jit_inline
def _cell(known: LocalizationMap, x: float, y: float) -> tuple[int, int]:
    """Row and column of a world point; (-1, -1) outside the map."""
    c, s = math.cos(known.origin.psi), math.sin(known.origin.psi)
    dx, dy = x - known.origin.x, y - known.origin.y
    u, v = (c * dx + s * dy) / known.resolution, (-s * dx + c * dy) / known.resolution
    rows, columns = known.gap.shape
    if not (0.0 <= u < columns and 0.0 <= v < rows):
        return -1, -1
    return int(v), int(u)


@jit
def gap_at(known: LocalizationMap, x: float, y: float) -> float:
    """Distance of a world point to the nearest wall, 2 m at most; NaN outside the map [m]."""
    row, column = _cell(known, x, y)
    return math.nan if row < 0 else float(known.gap[row, column])


@jit
def on_walls(known: LocalizationMap, pose: Pose, points: Floats, near: float) -> NDArray[np.bool_]:
    """Which body-frame points (m, 2), seen from there, are as near to a wall as that [m]."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    on = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x = pose.x + c * points[i, 0] - s * points[i, 1]
        y = pose.y + s * points[i, 0] + c * points[i, 1]
        on[i] = gap_at(known, x, y) < near
    return on


@jit
def expected(
    known: LocalizationMap, x: float, y: float, dx: float, dy: float, reach: float
) -> float:
    """Expected range from a world point in a direction, by ray casting [m].

    inf if beyond `reach`; NaN where unknown cells, or the map's end, come before.
    """
    c, s = math.cos(known.origin.psi), math.sin(known.origin.psi)
    wx, wy = x - known.origin.x, y - known.origin.y
    r = known.resolution
    u, v = (c * wx + s * wy) / r, (-s * wx + c * wy) / r
    ex, ey = (c * dx + s * dy) / r, (-s * dx + c * dy) / r
    rows, columns = known.gap.shape
    t = 0.0
    while t < reach:
        pu, pv = u + t * ex, v + t * ey
        if not (0.0 <= pu < columns and 0.0 <= pv < rows):
            return math.nan
        i, j = int(pv), int(pu)
        free = float(known.gap[i, j])
        if free < 0.5 * r:
            return t
        if known.unknown[i, j]:
            return math.nan
        t += max(free - 0.8 * r, 0.5 * r)
    return math.inf


class Judgement(NamedTuple):
    """How well a whole scan agrees with the map, as shares of the beams in known space.

    agree: ends at a wall. short: blocked by an object, perhaps a person. through: passed a mapped
    wall, or did not return from one. log: log likelihood of the scan, by the number of
    contradicting objects, not of their beams: one wide wall is one error of the map, three are a
    wrong place. beam_count: their number. weighed: log for comparison with other places: in unknown
    space a wall is as likely as none, by the metre. closer: log likelihood of beam ends closer to
    their surfaces than is usual, which separates two places that fit. passed: number of mapped
    walls that beams passed, which no walker explains.
    """

    agree: float
    short: float
    through: float
    log: float
    beam_count: int
    weighed: float
    closer: float
    passed: int = 0


NEAR = 0.15  # a beam's end as near to a wall as this agrees [m]
INDEPENDENT = 15.0  # effective number of independent distances in a scan
USUAL, _MOST = 0.5, 1.5
"""Usual negative log likelihood of a distance at the right place, and its cap."""
RUN = 3  # fewer neighbouring beams are an edge, not an object
_EDGE = -0.2  # log likelihoods: of such an edge,
_SHORT, _WIDE_SHORT = -1.5, -0.02  # an unmapped object, and each of its beams,
_THROUGH, _WIDE_THROUGH = -3.0, -0.05  # a missing wall, and each beam through it
_UNKNOWN = -1.0  # an object in unknown space,
UNDRAWN = -0.7  # and each metre of it: a wall is as likely as none
AGREE, IN_FRONT, BEHIND, SILENT, BEYOND = 0, 1, 2, 3, 4


@jit
def judge(
    known: LocalizationMap, lidar: Lidar, pose: Pose, ranges: Floats, every: int,
    offset: float, spread: float,
) -> Judgement:  # fmt: skip
    """Compare every `every`-th beam of a scan from a body pose with what the map expects.

    offset: of beam ends in front of their surface; spread: their standard deviation from there
    [m].
    """
    x, y, c, s = eye(pose, lidar.mount)
    counts = np.zeros(5, np.int64)
    log, near_log, passed, beyond = 0.0, 0.0, 0, 0.0
    before, run = SILENT, 0
    for i in range(0, len(ranges), every):
        r = ranges[i]
        if not r > 0.0:
            continue
        dx = c * lidar.beams[i, 0] - s * lidar.beams[i, 1]
        dy = s * lidar.beams[i, 0] + c * lidar.beams[i, 1]
        verdict, _, off = read(known, x, y, dx, dy, r, lidar.range_max, NEAR, offset, spread)
        near_log -= off
        counts[verdict] += 1
        beyond += every * lidar.step * r if verdict == BEYOND else 0.0
        if verdict == before:
            run += 1
            continue
        log += _cost(before, run, every)
        passed += before == BEHIND and run * every >= RUN
        before, run = verdict, 1
    log += _cost(before, run, every)
    passed += before == BEHIND and run * every >= RUN
    beam_count = counts[AGREE] + counts[IN_FRONT] + counts[BEHIND]
    if beam_count == 0:
        return Judgement(0.0, 0.0, 0.0, -1e3, 0, -1e3, 0.0, 0)
    better = (near_log + USUAL * counts[AGREE]) / beam_count * INDEPENDENT
    log += min(better, 0.0)
    return Judgement(
        counts[AGREE] / beam_count, counts[IN_FRONT] / beam_count, counts[BEHIND] / beam_count, log,
        beam_count, log + UNDRAWN * beyond, better, passed,
    )  # fmt: skip


@jit
def read(
    known: LocalizationMap, x: float, y: float, dx: float, dy: float, r: float, farthest: float,
    near: float, offset: float, spread: float,
) -> tuple[int, float, float]:  # fmt: skip
    """The kind of a beam, the range of what it shows, and, if it agrees, the negative log
    likelihood of its distance from the surface."""
    gap = gap_at(known, x + r * dx, y + r * dy) if r < math.inf else math.nan
    if gap < near:
        off = _off(known, x + r * dx, y + r * dy, dx, dy, offset)
        off = gap if math.isnan(off) else off
        return AGREE, r, min(0.5 * (off / spread) ** 2, _MOST)
    wall = expected(known, x, y, dx, dy, farthest)
    verdict = _against(wall, r, farthest)
    return verdict, wall if verdict == BEHIND else r, 0.0


@jit
def _off(known: LocalizationMap, x: float, y: float, dx: float, dy: float, offset: float) -> float:
    """Distance of a beam's end from its surface; NaN where there is none [m]."""
    made = known.surfaces
    k = row_at(made, x, y)
    if k >= 0 and made.normals[k, 0] * dx + made.normals[k, 1] * dy > 0.0 and len(made.back):
        k = made.back[k]  # the wall's other side
    if k < 0:
        return math.nan
    ex, ey = x - made.points[k, 0], y - made.points[k, 1]
    return ex * made.normals[k, 0] + ey * made.normals[k, 1] - offset


@jit
def _against(wall: float, r: float, farthest: float) -> int:
    """The kind of a beam that did not end near a wall; wall: its expected range [m]."""
    if math.isnan(wall):
        return SILENT if r == math.inf else BEYOND
    if r == math.inf:
        return BEHIND if wall < 0.9 * farthest else SILENT
    return IN_FRONT if r < wall else BEHIND


@jit
def _cost(verdict: int, run: int, every: int) -> float:
    """The log likelihood of a run of neighbouring beams of one kind."""
    if verdict in (AGREE, SILENT):
        return 0.0
    if run * every < RUN:
        return _EDGE
    if verdict == BEYOND:
        return _UNKNOWN
    if verdict == IN_FRONT:
        return _SHORT + _WIDE_SHORT * run * every
    return _THROUGH + _WIDE_THROUGH * run * every


@jit
def free_at(known: LocalizationMap, x: float, y: float) -> bool:
    """Whether a world point is in free space of the map."""
    row, column = _cell(known, x, y)
    return row >= 0 and known.gap[row, column] > 0.0 and not known.unknown[row, column]
