"""Point-to-line scan matching of two sights, against the motion by odometry."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints
from cohelm.robot.plausibility.sight import BeamFrame, Sight, beam_frame, normals, predict, seen_by
from cohelm.robot.sensors import Lidar

_WIDTHS = (0.5, 0.3, 0.15, 0.1, 0.08)
"""Largest residual that counts, in each iteration [m]."""
_PIECE, _PIECE_POINTS = 0.5, 4  # length of a piece of surface [m], and its least number of points
_WHOLE = 2.0 / 3.0  # share of its points that lie on a line: people abreast are no wall
_MIN_POINTS = 30  # points needed for a match
_PRIOR = np.diag([0.5, 0.5, 0.2])
"""Prior information for odometry: directions that are not observed stay as it has them."""


class Match(NamedTuple):
    """The correction of odometry's motion by scan matching."""

    correction: Floats
    """(3,), the correction of odometry's motion, in the body frame of the later sight [m, m, rad]:
    where the earlier points are, minus where odometry predicts them."""
    information: Floats
    """(3, 3), sum of weights J'J: in units of points that observe each direction."""
    against: float
    """Length of surface that fits the correction, and not odometry [m]."""
    for_it: float
    """Length of surface that fits odometry, and not the correction [m]."""

    def seen(self, x: float, y: float) -> float:
        """Information about the way along a unit vector of the later body frame, in points,
        marginal over the way across it and the turn: one oblique wall determines neither the way
        ahead nor the way aside, only one by the other."""
        along = np.array([x, y, 0.0])
        return 1.0 / float(along @ _solved(self.information + _PRIOR, along))

    def way(self, least: float) -> float:
        """Length of the correction along the axes with information of at least `least` points [m];
        along the others it is too uncertain to count."""
        unsure = np.linalg.inv(self.information + _PRIOR)[:2, :2]  # marginal over the turn
        variances, axes = np.linalg.eigh(unsure)
        parts: Floats = axes.T @ self.correction[:2]
        return float(np.hypot(*np.where(variances * least <= 1.0, parts, 0.0)))


def match(before: Sight, now: Sight, lidar: Lidar, least: float = 0.0) -> Match | None:
    """None where too few points correspond, or are on flat surfaces; or where less surface than
    `least` [m] is displaced from where odometry predicts it, so that it can not be contradicted."""
    sigma = max(lidar.noise, 0.005)
    lines, where = normals(now, sigma)
    if len(where) < _MIN_POINTS or len(before.points) < _MIN_POINTS:
        return None
    view = Lines(beam_frame(lidar), now.ranges, now.points[where], lines)
    earlier, piece = predict(before, now), _pieces(before.arc)
    table = _lines_by_beam(view, now.every)
    if least > 0.0 and _displaced(view, table, earlier, before.arc, piece, sigma) < least:
        return None
    enough, delta, info = _fitted(view, table, earlier)
    if not enough:
        return None
    against, for_it = _votes(view, table, earlier, delta, before.arc, piece, sigma)
    return Match(delta, info, against, for_it)


class Lines(NamedTuple):
    """The later sight's surfaces, for compiled code."""

    frame: BeamFrame
    ranges: Floats
    """By beam, as of a `Sight`."""
    points: Floats
    """Points that have a normal, (k, 2)."""
    lines: Floats
    """Their normals, (k, 2)."""


@jit
def _lines_by_beam(view: Lines, every: int) -> Ints:
    """Index of the line that each beam falls on, -1: none. A kept point also stands for its
    neighbours that were not kept; the nearest is written last."""
    n, k = len(view.ranges), len(view.points)
    table, beams = np.full(n, -1), np.empty(k, dtype=np.int64)
    for i in range(k):
        beams[i] = round(seen_by(view.frame, view.points[i, 0], view.points[i, 1])[0])
    for offset in range(every // 2, -1, -1):
        for side in (offset, -offset):
            for i in range(k):
                if 0 <= beams[i] + side < n:
                    table[beams[i] + side] = i
    return table


@jit
def _fitted(view: Lines, table: Ints, earlier: Floats) -> tuple[bool, Floats, Floats]:
    """Whether enough points fell on lines, and `correction` and `information` of the match.
    earlier: points of the earlier sight as odometry predicts them."""
    delta, info, rhs, row = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.empty(3)
    for width in _WIDTHS:
        info[:], rhs[:], k = 0.0, 0.0, 0
        c, s = math.cos(delta[2]), math.sin(delta[2])
        for i in range(len(earlier)):
            x = c * earlier[i, 0] - s * earlier[i, 1] + delta[0]
            y = s * earlier[i, 0] + c * earlier[i, 1] + delta[1]
            at = round(seen_by(view.frame, x, y)[0])
            line = table[at] if 0 <= at < len(table) else -1
            if line < 0:
                continue
            k += 1
            nx, ny = view.lines[line]
            dx, dy = view.points[line, 0] - x, view.points[line, 1] - y
            d = dx * nx + dy * ny
            if abs(d) >= width or math.hypot(dx, dy) > 4.0 * width + 0.2:
                continue
            w = (1.0 - (d / width) ** 2) ** 2
            row[0], row[1], row[2] = nx, ny, x * ny - y * nx
            for a in range(3):
                rhs[a] += w * d * row[a]
                for b in range(3):
                    info[a, b] += w * row[a] * row[b]
        if k < _MIN_POINTS:
            return False, delta, info
        step = _solved(info + _PRIOR, rhs)
        c, s = math.cos(step[2]), math.sin(step[2])
        x, y = delta[0], delta[1]
        delta[0], delta[1] = c * x - s * y + step[0], s * x + c * y + step[1]
        delta[2] += step[2]
        if np.abs(step).max() < 1e-4 and width < 0.2:
            break
    return True, delta, info


@jit
def _solved(a: Floats, b: Floats) -> Floats:
    """x of a x = b, for a symmetric positive (3, 3) matrix: by its Cholesky factor."""
    p = math.sqrt(a[0, 0])
    q, r = a[1, 0] / p, a[2, 0] / p
    s = math.sqrt(a[1, 1] - q * q)
    t = (a[2, 1] - q * r) / s
    u = math.sqrt(a[2, 2] - r * r - t * t)
    x = b[0] / p
    y = (b[1] - q * x) / s
    z = (b[2] - r * x - t * y) / u
    z /= u
    y = (y - t * z) / s
    return np.array([(x - q * y - r * z) / p, y, z])


@jit_inline
def _residual(view: Lines, table: Ints, x: float, y: float) -> float:
    """Distance of a point from the line it falls on [m]; NaN: no line there, or it is occluded."""
    beam, r = seen_by(view.frame, x, y)
    at = round(beam)
    if not 0 <= at < len(table):
        return math.nan
    line = table[at]
    if line < 0 or view.ranges[at] < r - 0.2:
        return math.nan
    dx, dy = view.points[line, 0] - x, view.points[line, 1] - y
    return dx * view.lines[line, 0] + dy * view.lines[line, 1]


@jit
def _pieces(arc: Floats) -> Ints:
    """Index of the piece of surface of each point: of half a metre, over which noise averages out;
    at a distance, where points are farther apart, of `_PIECE_POINTS` points."""
    piece = np.empty(len(arc), dtype=np.int64)
    length = 0.0
    for i in range(len(arc)):
        length += min(arc[i], _PIECE / _PIECE_POINTS)
        piece[i] = int(length / _PIECE + 1e-9)
    return piece


@jit_inline
def _near(count: int, sigma: float) -> float:
    """Largest mean residual of a piece of `count` points that noise explains [m]."""
    return max(3.0 * math.sqrt(2.0) * sigma / math.sqrt(count), 0.015)


@jit
def _displaced(
    view: Lines, table: Ints, earlier: Floats, arc: Floats, piece: Ints, sigma: float
) -> float:
    """Length of surface that is not where predicted [m]; by half the threshold of `_votes`."""
    surface = 0.0
    count, delta, length = 0, 0.0, 0.0
    for i in range(len(earlier)):
        d = _residual(view, table, earlier[i, 0], earlier[i, 1])
        if not math.isnan(d):
            count, delta, length = count + 1, delta + d, length + arc[i]
        if i + 1 == len(earlier) or piece[i + 1] != piece[i]:
            if count > 0 and abs(delta) / count > 0.5 * _near(count, sigma):
                surface += length
            count, delta, length = 0, 0.0, 0.0
    return surface


@jit
def _votes(
    view: Lines, table: Ints, earlier: Floats, delta: Floats, arc: Floats, piece: Ints, sigma: float
) -> tuple[float, float]:
    """Length of surface, piece by piece, that fits only the correction, and only odometry [m]."""
    against = for_it = 0.0
    points, count, first, second, length = 0, 0, 0.0, 0.0, 0.0
    c, s = math.cos(delta[2]), math.sin(delta[2])
    for i in range(len(earlier)):
        x, y = earlier[i]
        d = _residual(view, table, x, y)
        e = _residual(view, table, c * x - s * y + delta[0], s * x + c * y + delta[1])
        points += 1
        if not (math.isnan(d) or math.isnan(e)):
            count, length = count + 1, length + arc[i]
            first, second = first + d, second + e
        if i + 1 == len(earlier) or piece[i + 1] != piece[i]:
            if count >= max(_PIECE_POINTS, _WHOLE * points):
                near = _near(count, sigma)
                a, b = abs(first) / count, abs(second) / count
                against += length if b < 2.0 * near and a > b + near else 0.0
                for_it += length if a < 2.0 * near and b > a + near else 0.0
            points, count, first, second, length = 0, 0, 0.0, 0.0, 0.0
    return against, for_it
