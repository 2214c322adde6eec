"""A deskewed scan with its pose by odometry, and the prediction of it from an earlier one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints
from cohelm.robot.plausibility.trail import Trail
from cohelm.robot.sensors import Lidar

_POINTS = 400  # largest number in a sight
_HALF = 0.25  # half of a chord [m]


class Sight(NamedTuple):
    """A scan deskewed to the instant of its last beam, by odometry."""

    stamp: float
    """That instant [s]."""
    pose: Floats
    """(3,), odometry's at that instant, heading not wrapped."""
    twist: Floats
    """(2,), odometry's at that instant."""
    points: Floats
    """(m, 2), the ends of its beams, in the body frame of that instant [m]; in order of beams."""
    ranges: Floats
    """(n,), by beams of the sensor at that instant; infinite where nothing was seen, NaN where no
    beam looked; 0 for too near."""
    arc: Floats
    """(m,), length of surface that each point stands for, seen square on [m]."""
    every: int
    """Number of returns for each point."""


def sighted(lidar: Lidar, ranges: Floats, stamp: float, duration: float, trail: Trail) -> Sight:
    """The sight of a scan. The trail has to reach to its end."""
    pose, twist, points, seen, arc, every = _sighted(
        beam_frame(lidar), lidar.beams, np.array(ranges, dtype=np.float64), float(stamp),
        float(duration), trail.rows,
    )  # fmt: skip
    return Sight(stamp + duration, pose, twist, points, seen, arc, every)


@jit
def _sighted(
    of: BeamFrame, beams: Floats, ranges: Floats, stamp: float, duration: float, rows: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats, int]:  # fmt: skip
    """The numbers of the sight. beams: as of a `Lidar`; rows: of the trail."""
    n = len(ranges)
    sweeps = duration > 0.0 and n > 1
    end = stamp + duration
    j = int(np.searchsorted(rows[:, 0], end, "right"))
    now = np.array([_between(rows, j, column, end) for column in range(1, 6)])
    c, s = math.cos(now[2]), math.sin(now[2])
    body, real = np.empty((n, 2)), np.empty(n)  # of the beams that returned
    seen = np.full(n, math.nan)
    near = np.full(n, math.inf)  # the nearest return that falls on each beam
    j = k = 0
    turn, t = 0.0, end
    for i in range(n):
        r = ranges[i]
        if sweeps:
            t = stamp + duration * i / (n - 1)
            while j < len(rows) and rows[j, 0] <= t:
                j += 1
            turn = _between(rows, j, 3, t) - now[2]
        if not math.isfinite(r):
            at = round(i + turn / of.step)
            if 0 <= at < n:
                seen[at] = 0.0 if r == -math.inf else math.inf
            continue
        along, across = r * beams[i, 0], r * beams[i, 1]
        px, py = of.c * along - of.s * across + of.x, of.s * along + of.c * across + of.y
        if sweeps:
            dx, dy = _between(rows, j, 1, t) - now[0], _between(rows, j, 2, t) - now[1]
            ct, st = math.cos(turn), math.sin(turn)
            px, py = ct * px - st * py + c * dx + s * dy, st * px + ct * py - s * dx + c * dy
            beam, dist = seen_by(of, px, py)
            at = round(beam)
            if 0 <= at < n:
                near[at] = min(near[at], dist)
        else:
            seen[i] = r
        body[k, 0], body[k, 1], real[k] = px, py, r
        k += 1
    if sweeps:
        for i in range(n):
            if near[i] < math.inf:
                seen[i] = near[i]
        _filled(seen)
    every = max(-(-k // _POINTS), 1)
    m = -(-k // every)
    points, arc = np.empty((m, 2)), np.empty(m)
    for j in range(m):
        points[j] = body[j * every]
        arc[j] = every * of.step * real[j * every]
    return now[:3].copy(), now[3:5].copy(), points, seen, arc, every


@jit
def _filled(seen: Floats) -> None:
    """Give a single beam without a return the nearer of its neighbours' ranges."""
    before = seen[0]
    for i in range(1, len(seen) - 1):
        own = seen[i]
        if math.isnan(own):
            after = seen[i + 1]
            seen[i] = before if math.isnan(after) or before < after else after
        before = own


@jit_inline
def _between(rows: Floats, j: int, column: int, time: float) -> float:
    """A column at a time, linear between two rows, held at both ends. rows: time first, in its
    order. j: the first row that is later."""
    if j == 0:
        return rows[0, column]
    if j == len(rows):
        return rows[j - 1, column]
    a, b = rows[j - 1], rows[j]
    return a[column] + (b[column] - a[column]) / (b[0] - a[0]) * (time - a[0])


class BeamFrame(NamedTuple):
    """A LiDAR's mount in the body frame and its beams, for compiled code."""

    x: float
    y: float
    c: float
    """Cosine of its heading..."""
    s: float
    """... and sine."""
    first: float
    """Bearing of its first beam [rad]."""
    step: float
    """From beam to beam [rad]."""


def beam_frame(lidar: Lidar) -> BeamFrame:
    """The beam frame of a LiDAR."""
    x, y, psi = lidar.mount
    return BeamFrame(x, y, math.cos(psi), math.sin(psi), lidar.first, lidar.step)


@jit_inline
def seen_by(of: BeamFrame, px: float, py: float) -> tuple[float, float]:
    """Beam number, fractional, and range [m] of a point of the body frame."""
    dx, dy = px - of.x, py - of.y
    x, y = of.c * dx + of.s * dy, -of.s * dx + of.c * dy
    bearing = math.atan2(y, x) - of.first
    if bearing < -0.5 * of.step:
        bearing += 2.0 * math.pi
    return bearing / of.step, math.hypot(x, y)


def polar(lidar: Lidar, points: Floats) -> tuple[Floats, Floats]:
    """Beam numbers, fractional, and ranges [m] of points of the body frame."""
    return _polar(beam_frame(lidar), points)


@jit
def _polar(of: BeamFrame, points: Floats) -> tuple[Floats, Floats]:
    beams, dist = np.empty(len(points)), np.empty(len(points))
    for i in range(len(points)):
        beams[i], dist[i] = seen_by(of, points[i, 0], points[i, 1])
    return beams, dist


def turned(points: Floats, psi: float) -> Floats:
    """Points rotated by an angle [rad], counter-clockwise."""
    c, s = math.cos(psi), math.sin(psi)
    return np.column_stack(
        (c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1])
    )


def predict(before: Sight, now: Sight) -> Floats:
    """An earlier sight's points in the body frame of a later one, in a static world and by
    odometry, (m, 2) [m]."""
    return _predict(before.points, before.pose, now.pose)


@jit
def _predict(points: Floats, before: Floats, now: Floats) -> Floats:
    dx, dy = now[0] - before[0], now[1] - before[1]
    c, s = math.cos(now[2]), math.sin(now[2])
    away, aside = c * dx + s * dy, -s * dx + c * dy
    c, s = math.cos(before[2] - now[2]), math.sin(before[2] - now[2])
    out = np.empty_like(points)
    for i in range(len(points)):
        x, y = points[i]
        out[i, 0], out[i, 1] = c * x - s * y - away, s * x + c * y - aside
    return out


def motion(before: Sight, now: Sight) -> Floats:
    """Odometry's motion from one to the other, in the body frame of the first, (3,) [m, m, rad]."""
    dx, dy, turn = now.pose - before.pose
    c, s = math.cos(float(before.pose[2])), math.sin(float(before.pose[2]))
    return np.array([c * dx + s * dy, -s * dx + c * dy, turn])


def normals(sight: Sight, sigma: float) -> tuple[Floats, Ints]:
    """Unit normals of the surfaces at a sight's points, and which points have one, as indices.
    sigma: of a range [m].

    A chord of half a metre across each point, so that noise turns it little and no person has one;
    a point that is not on its chord's line is on an edge or a small object, and has none.
    """
    return _normals(sight.points, sight.arc, float(sigma))


@jit
def _normals(p: Floats, arc: Floats, sigma: float) -> tuple[Floats, Ints]:
    m, k = len(p), 0
    found, which = np.empty((m, 2)), np.empty(m, dtype=np.int64)
    near = 0.02 + 3.0 * sigma
    for i in range(m if m >= 9 else 0):
        spread = min(max(round(_HALF / max(arc[i], 1e-3)), 3), 40)
        a, b = i - spread, i + spread
        if a < 0 or b >= m:
            continue
        dx, dy = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1]
        length = math.hypot(dx, dy)
        nx, ny = -dy / max(length, 1e-9), dx / max(length, 1e-9)
        x, y = 0.5 * (p[a, 0] + p[b, 0]), 0.5 * (p[a, 1] + p[b, 1])
        h = (a + i) // 2
        error = abs((p[i, 0] - x) * nx + (p[i, 1] - y) * ny)
        half = abs((p[h, 0] - x) * nx + (p[h, 1] - y) * ny)
        if error < near and half < near and 0.3 < length < 3.0:
            found[k, 0], found[k, 1], which[k] = nx, ny, i
            k += 1
    return found[:k].copy(), which[:k].copy()
