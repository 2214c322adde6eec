"""The motion that turns one sight into the other, by what both show: point to line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints
from cohelm.robot.plausibility.sight import BeamFrame, Sight, beam_frame, foretold, normals, seen_by
from cohelm.robot.sensors import Lidar

_WIDTHS = (0.5, 0.3, 0.15, 0.1, 0.08)
"""Residuals beyond this count no more, round after round [m]."""
_PIECE, _FEW = 0.5, 4  # a piece of surface is so long [m], and has so many points
_WHOLE = 2.0 / 3.0  # of its points lie on a line: people abreast are no wall
_LEAST = 30  # points that look square at a direction, before anything is said of it
_PRIOR = np.diag([0.5, 0.5, 0.2])
"""What is not seen stays as odometry has it: as if half a point said so."""


class Match(NamedTuple):
    """How far odometry is from what the sights show."""

    off: Floats
    """(3,), the correction of odometry's motion, in the body frame of the later sight [m, m, rad]:
    where earlier points really are, minus where odometry foretells them."""
    known: Floats
    """(3, 3), so many points' worth of each direction was seen: sum of weights J'J."""
    against: float
    """How much surface speaks for the correction, and against odometry [m]."""
    for_it: float
    """How much speaks for odometry, and against the correction [m]."""

    def told(self, x: float, y: float) -> float:
        """How many points' worth was seen of the way along a unit vector of the later body frame,
        whatever the way across it and the turn may be: one wall that stands oblique tells neither
        the way ahead nor the way aside, only one by the other."""
        along = np.array([x, y, 0.0])
        return 1.0 / float(along @ _solved(self.known + _PRIOR, along))

    def way(self, least: float) -> float:
        """Length of the correction, of its parts along which `told` is `least` at least [m]: what
        a few points say of a way that they hardly see is no correction of it."""
        unsure = np.linalg.inv(self.known + _PRIOR)[:2, :2]  # whatever the turn may be
        variances, axes = np.linalg.eigh(unsure)
        parts: Floats = axes.T @ self.off[:2]
        return float(np.hypot(*np.where(variances * least <= 1.0, parts, 0.0)))


def match(before: Sight, now: Sight, lidar: Lidar, least: float = 0.0) -> Match | None:
    """None where too little of both is alike, or flat, to say; or where less surface than `least`
    [m] is anywhere else than odometry foretells it, so that no more speaks against it."""
    sigma = max(lidar.noise, 0.005)
    lines, where = normals(now, lidar, sigma)
    if len(where) < _LEAST or len(before.points) < _LEAST:
        return None
    view = Lines(beam_frame(lidar), now.ranges, now.points[where], lines)
    given, piece = foretold(before, now), _pieces(before.arc)
    table = _lines_by_beam(view, now.every)
    if least > 0.0 and _elsewhere(view, table, given, before.arc, piece, sigma) < least:
        return None
    enough, off, known = _fitted(view, table, given)
    if not enough:
        return None
    against, for_it = _votes(view, table, given, off, before.arc, piece, sigma)
    return Match(off, known, against, for_it)


class Lines(NamedTuple):
    """What the later sight shows, as numbers."""

    frame: BeamFrame
    ranges: Floats
    """By beams, as of a `Sight`."""
    points: Floats
    """Those that have a normal, (k, 2)."""
    lines: Floats
    """Their normals, (k, 2)."""


@jit
def _lines_by_beam(view: Lines, every: int) -> Ints:
    """Which line each beam falls on, -1: none. A point that was kept stands for its neighbours,
    too, that were not; the nearest is written last."""
    n, k = len(view.ranges), len(view.points)
    table, beams = np.full(n, -1), np.empty(k, dtype=np.int64)
    for i in range(k):
        beams[i] = round(seen_by(view.frame, view.points[i, 0], view.points[i, 1])[0])
    for far in range(every // 2, -1, -1):
        for side in (far, -far):
            for i in range(k):
                if 0 <= beams[i] + side < n:
                    table[beams[i] + side] = i
    return table


@jit
def _fitted(view: Lines, table: Ints, given: Floats) -> tuple[bool, Floats, Floats]:
    """Whether enough fell on lines, and `off` and `known` of the match. given: points of the
    earlier sight as odometry foretells them."""
    off, known, wanted, row = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.empty(3)
    for width in _WIDTHS:
        known[:], wanted[:], k = 0.0, 0.0, 0
        c, s = math.cos(off[2]), math.sin(off[2])
        for i in range(len(given)):
            x = c * given[i, 0] - s * given[i, 1] + off[0]
            y = s * given[i, 0] + c * given[i, 1] + off[1]
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
                wanted[a] += w * d * row[a]
                for b in range(3):
                    known[a, b] += w * row[a] * row[b]
        if k < _LEAST:
            return False, off, known
        step = _solved(known + _PRIOR, wanted)
        c, s = math.cos(step[2]), math.sin(step[2])
        x, y = off[0], off[1]
        off[0], off[1] = c * x - s * y + step[0], s * x + c * y + step[1]
        off[2] += step[2]
        if np.abs(step).max() < 1e-4 and width < 0.2:
            break
    return True, off, known


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
    """Of a point from the line it falls on; NaN where there is none, or something before."""
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
    """Over a piece of half a metre the noise of its points averages out; far away, where points
    are farther apart, over _FEW of them."""
    piece = np.empty(len(arc), dtype=np.int64)
    so_far = 0.0
    for i in range(len(arc)):
        so_far += min(arc[i], _PIECE / _FEW)
        piece[i] = int(so_far / _PIECE + 1e-9)
    return piece


@jit_inline
def _near(count: int, sigma: float) -> float:
    """The mean residual of a piece with so many points is noise, up to so much [m]."""
    return max(3.0 * math.sqrt(2.0) * sigma / math.sqrt(count), 0.015)


@jit
def _elsewhere(
    view: Lines, table: Ints, given: Floats, arc: Floats, piece: Ints, sigma: float
) -> float:
    """How much surface is not where it is foretold [m]; half as much doubt as `_votes` needs."""
    surface = 0.0
    count, off, length = 0, 0.0, 0.0
    for i in range(len(given)):
        d = _residual(view, table, given[i, 0], given[i, 1])
        if not math.isnan(d):
            count, off, length = count + 1, off + d, length + arc[i]
        if i + 1 == len(given) or piece[i + 1] != piece[i]:
            if count > 0 and abs(off) / count > 0.5 * _near(count, sigma):
                surface += length
            count, off, length = 0, 0.0, 0.0
    return surface


@jit
def _votes(
    view: Lines, table: Ints, given: Floats, off: Floats, arc: Floats, piece: Ints, sigma: float
) -> tuple[float, float]:
    """Surface that tells the two motions apart, and fits only one of them: piece by piece."""
    against = for_it = 0.0
    points, count, first, second, length = 0, 0, 0.0, 0.0, 0.0
    c, s = math.cos(off[2]), math.sin(off[2])
    for i in range(len(given)):
        x, y = given[i]
        d = _residual(view, table, x, y)
        e = _residual(view, table, c * x - s * y + off[0], s * x + c * y + off[1])
        points += 1
        if not (math.isnan(d) or math.isnan(e)):
            count, length = count + 1, length + arc[i]
            first, second = first + d, second + e
        if i + 1 == len(given) or piece[i + 1] != piece[i]:
            if count >= max(_FEW, _WHOLE * points):
                near = _near(count, sigma)
                a, b = abs(first) / count, abs(second) / count
                against += length if b < 2.0 * near and a > b + near else 0.0
                for_it += length if a < 2.0 * near and b > a + near else 0.0
            points, count, first, second, length = 0, 0, 0.0, 0.0, 0.0
    return against, for_it
