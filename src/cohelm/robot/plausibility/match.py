"""The motion that turns one sight into the other, by what both show: point to line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats, Ints
from cohelm.robot.plausibility.sight import Sight, foretold, normals, polar
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
    table = _lines_by_beam(lidar, now, where)
    given = foretold(before, now)
    if least > 0.0:
        away = _residuals(lidar, given, now, lines, where, table)
        if _elsewhere(away, before.arc, sigma) < least:
            return None
    off = np.zeros(3)
    known = np.zeros((3, 3))
    for width in _WIDTHS:
        p = _moved(given, off)
        at, which = _paired(lidar, p, table)
        if len(at) < _LEAST:
            return None
        q, n, p = now.points[where[which]], lines[which], p[at]
        d = ((q - p) * n).sum(axis=1)
        apart = np.hypot(*(q - p).T)
        w = np.clip(1.0 - (d / width) ** 2, 0.0, None) ** 2
        w[apart > 4.0 * width + 0.2] = 0.0
        jacobian = np.column_stack((n, p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]))
        known = (jacobian * w[:, None]).T @ jacobian
        wanted: Floats = jacobian.T @ (w * d)
        step = _solved(known + _PRIOR, wanted)
        off = _added(off, step)
        if np.abs(step).max() < 1e-4 and width < 0.2:
            break
    against, for_it = _votes(lidar, given, off, now, lines, where, table, before.arc, sigma)
    return Match(off, known, against, for_it)


def _lines_by_beam(lidar: Lidar, now: Sight, where: Ints) -> Ints:
    """Which line each beam falls on, -1: none. A point that was kept stands for its neighbours,
    too, that were not; the nearest is written last."""
    beams, _ = polar(lidar, now.points[where])
    index = np.rint(beams).astype(np.int64)
    table = np.full(len(lidar.beams), -1, dtype=np.int64)
    for far in range(now.every // 2, -1, -1):
        for at in (index + far, index - far):
            inside = np.flatnonzero((at >= 0) & (at < len(table)))
            table[at[inside]] = inside
    return table


def _solved(matrix: Floats, wanted: Floats) -> Floats:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64) @ wanted


def _moved(points: Floats, by: Floats) -> Floats:
    c, s = math.cos(float(by[2])), math.sin(float(by[2]))
    return np.column_stack((
        c * points[:, 0] - s * points[:, 1] + by[0], s * points[:, 0] + c * points[:, 1] + by[1],
    ))  # fmt: skip


def _added(a: Floats, b: Floats) -> Floats:
    c, s = math.cos(float(b[2])), math.sin(float(b[2]))
    return np.array([c * a[0] - s * a[1] + b[0], s * a[0] + c * a[1] + b[1], a[2] + b[2]])


def _paired(lidar: Lidar, points: Floats, table: Ints) -> tuple[Ints, Ints]:
    """Which of the points fall on a beam with a line, and on which."""
    beams, _ = polar(lidar, points)
    index = np.rint(beams)
    inside = np.flatnonzero((index >= 0) & (index < len(table)))
    line = table[index[inside].astype(np.int64)]
    return inside[line >= 0], line[line >= 0]


def _residuals(
    lidar: Lidar, points: Floats, now: Sight, lines: Floats, where: Ints, table: Ints
) -> Floats:
    """Of each point from the line it falls on; NaN where there is none, or something before."""
    beams, r = polar(lidar, points)
    index = np.rint(beams)
    inside = (index >= 0) & (index < len(lidar.beams))
    index = np.where(inside, index, 0).astype(np.int64)
    line = np.where(inside, table[index], -1)
    out = np.full(len(points), math.nan)
    at = np.flatnonzero((line >= 0) & ~(now.ranges[index] < r - 0.2))
    line = line[at]
    out[at] = ((now.points[where[line]] - points[at]) * lines[line]).sum(axis=1)
    return out


def _pieces(arc: Floats) -> Ints:
    """Over a piece of half a metre the noise of its points averages out; far away, where points
    are farther apart, over _FEW of them."""
    return (np.cumsum(np.minimum(arc, _PIECE / _FEW)) / _PIECE + 1e-9).astype(np.int64)


def _near(count: Floats | Ints, sigma: float) -> Floats:
    """The mean residual of a piece with so many points is noise, up to so much [m]."""
    return np.maximum(3.0 * math.sqrt(2.0) * sigma / np.sqrt(count), 0.015)


def _elsewhere(residuals: Floats, arc: Floats, sigma: float) -> float:
    """How much surface is not where it is foretold [m]; half as much doubt as `_votes` needs."""
    told = ~np.isnan(residuals)
    piece, arc = _pieces(arc)[told], arc[told]
    if len(piece) == 0:
        return 0.0
    count = np.maximum(np.bincount(piece), 1)
    off = np.abs(np.bincount(piece, residuals[told])) / count
    return float(np.bincount(piece, arc)[off > 0.5 * _near(count, sigma)].sum())


def _votes(
    lidar: Lidar, given: Floats, off: Floats, now: Sight, lines: Floats, where: Ints,
    table: Ints, arc: Floats, sigma: float,
) -> tuple[float, float]:  # fmt: skip
    """Surface that tells the two motions apart, and fits only one of them: piece by piece."""
    piece = _pieces(arc)
    points = np.bincount(piece)
    a = _residuals(lidar, given, now, lines, where, table)
    b = _residuals(lidar, _moved(given, off), now, lines, where, table)
    told = ~np.isnan(a) & ~np.isnan(b)
    piece, a, b, arc = piece[told], a[told], b[told], arc[told]
    if len(a) == 0:
        return 0.0, 0.0
    count = np.maximum(np.bincount(piece), 1)
    a = np.abs(np.bincount(piece, a)) / count
    b = np.abs(np.bincount(piece, b)) / count
    length = np.bincount(piece, arc)
    near = _near(count, sigma)
    enough = count >= np.maximum(_FEW, _WHOLE * points[: len(count)])
    against = float(length[enough & (b < 2.0 * near) & (a > b + near)].sum())
    for_it = float(length[enough & (a < 2.0 * near) & (b > a + near)].sum())
    return against, for_it
