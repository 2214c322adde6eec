"""One scan where it was measured, and what another one foretells of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints
from cohelm.robot.plausibility.trail import Trail
from cohelm.robot.sensors import Lidar

_POINTS = 400  # of a sight, at most
_HALF = 0.25  # a chord's half [m]


class Sight(NamedTuple):
    """A scan at the instant of its last beam, by odometry."""

    stamp: float
    """That instant [s]."""
    pose: Floats
    """(3,), odometry's then, heading not wrapped."""
    twist: Floats
    """(2,), odometry's then."""
    points: Floats
    """(m, 2), where its beams ended, in the body frame of that instant [m]; in order of beams."""
    ranges: Floats
    """(n,), by beams of the sensor as it stood then; infinite where nothing was seen, NaN where no
    beam looked; 0 for too near."""
    arc: Floats
    """(m,), how much of a surface each point stands for, seen square on [m]."""
    every: int
    """So many returns there are for each point."""


def sighted(
    lidar: Lidar, ranges: Floats, stamp: float, duration: float, trail: Trail
) -> Sight:  # fmt: skip
    """A scan's sight. The trail has to reach to its end."""
    n = len(ranges)
    end = stamp + duration
    now = trail.at(np.array([end]))[0]
    finite = np.isfinite(ranges)
    r = ranges[finite]
    local = r[:, None] * lidar.beams[finite]
    mount = lidar.mount
    body = turned(local, mount.psi) + np.array([mount.x, mount.y])
    seen = np.where(np.isnan(ranges), math.inf, ranges)
    seen[ranges == -math.inf] = 0.0
    if duration > 0.0 and n > 1:
        times = stamp + duration * np.arange(n) / (n - 1)
        poses = trail.at(times)[:, :3]
        at = poses[finite]
        dx, dy = at[:, 0] - now[0], at[:, 1] - now[1]
        c, s = math.cos(now[2]), math.sin(now[2])
        turn = at[:, 2] - now[2]
        ct, st = np.cos(turn), np.sin(turn)
        body = np.column_stack((
            ct * body[:, 0] - st * body[:, 1] + c * dx + s * dy,
            st * body[:, 0] + ct * body[:, 1] - s * dx + c * dy,
        ))  # fmt: skip
        seen = _binned(lidar, seen, poses[:, 2] - now[2], finite, body)
    every = -(-len(r) // _POINTS) or 1
    arc = every * lidar.step * r[::every]
    return Sight(end, now[:3], now[3:5], body[::every], seen, arc, every)


def _binned(
    lidar: Lidar, seen: Floats, turn: Floats, finite: NDArray[np.bool_], body: Floats
) -> Floats:
    """Ranges by the beams at the end of the sweep, the nearest of those that fall on one."""
    n = len(seen)
    out = np.full(n, math.nan)
    far = np.flatnonzero(~finite)
    beam = np.rint(far + turn[far] / lidar.step).astype(np.int64)
    there = (beam >= 0) & (beam < n)
    out[beam[there]] = seen[far[there]]
    beam, r = polar(lidar, body)
    index = np.rint(beam).astype(np.int64)
    there = (index >= 0) & (index < n)
    order = np.argsort(-r[there])  # the nearest is written last
    out[index[there][order]] = r[there][order]
    gap = np.isnan(out)
    gap[[0, -1]] = False
    inside = np.flatnonzero(gap)
    out[inside] = np.fmin(out[inside - 1], out[inside + 1])
    return out


def polar(lidar: Lidar, points: Floats) -> tuple[Floats, Floats]:
    """Body-frame points as the sensor sees them: number of the beam, not whole, and range."""
    mount = lidar.mount
    c, s = math.cos(mount.psi), math.sin(mount.psi)
    dx, dy = points[:, 0] - mount.x, points[:, 1] - mount.y
    x, y = c * dx + s * dy, -s * dx + c * dy
    bearing = np.arctan2(y, x) - lidar.first
    bearing = np.where(bearing < -0.5 * lidar.step, bearing + 2.0 * math.pi, bearing)
    return bearing / lidar.step, np.hypot(x, y)


def turned(points: Floats, psi: float) -> Floats:
    """Counter-clockwise."""
    c, s = math.cos(psi), math.sin(psi)
    return np.column_stack(
        (c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1])
    )


def foretold(before: Sight, now: Sight) -> Floats:
    """An earlier sight's points in the body frame of a later one, if all stood still and odometry
    is right, (m, 2)."""
    dx, dy = now.pose[:2] - before.pose[:2]
    c, s = math.cos(float(now.pose[2])), math.sin(float(now.pose[2]))
    moved = turned(before.points, float(before.pose[2] - now.pose[2]))
    return moved - (c * dx + s * dy, -s * dx + c * dy)


def motion(before: Sight, now: Sight) -> Floats:
    """Odometry's, from one to the other, in the body frame of the first, (3,)."""
    dx, dy, turn = now.pose - before.pose
    c, s = math.cos(float(before.pose[2])), math.sin(float(before.pose[2]))
    return np.array([c * dx + s * dy, -s * dx + c * dy, turn])


def normals(sight: Sight, lidar: Lidar, sigma: float) -> tuple[Floats, Ints]:
    """Unit normals of the surfaces at a sight's points, and which points have one, as indices.

    A chord of half a metre across each point, so that noise turns it little and no person has one;
    a point that is off its chord's line is on an edge or a small thing, and has none.
    """
    p, m = sight.points, len(sight.points)
    if m < 9:
        return np.empty((0, 2)), np.empty(0, dtype=np.int64)
    spread = np.clip(np.rint(_HALF / np.maximum(sight.arc, 1e-3)), 3, 40).astype(np.int64)
    index = np.arange(m)
    a, b = index - spread, index + spread
    inside = (a >= 0) & (b < m)
    index, a, b = index[inside], a[inside], b[inside]
    chord = p[b] - p[a]
    length = np.hypot(chord[:, 0], chord[:, 1])
    unit = chord / np.maximum(length, 1e-9)[:, None]
    normal = np.column_stack((-unit[:, 1], unit[:, 0]))
    middle = 0.5 * (p[a] + p[b])
    off = np.abs(((p[index] - middle) * normal).sum(axis=1))
    half = np.abs(((p[(a + index) // 2] - middle) * normal).sum(axis=1))
    near = 0.02 + 3.0 * sigma
    flat = (off < near) & (half < near) & (length < 3.0) & (length > 0.3)
    return normal[flat], index[flat]
