"""What a planar LiDAR sees of discs, walls and an occupancy map, by exact ray casting.

A disc or wall touches only the beams within the angle it fills, so a scan costs about as much
as the returns it has, not beams times obstacles. The cut is conservative by one beam on each
side, and each beam is then tested exactly: no range depends on it.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.frames import eye
from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, Floats, Pose, X, Y
from cohelm.robot.sensors import Lidar
from cohelm.sim.grid import Grid, cast
from cohelm.sim.operator_model import normal

_AGAINST = 1e-9  # nearer to a wall than this [m], the sensor is on it and its side is undefined
_CORNER = 1e-12  # walls overlap by this share of their length, so no beam slips through a corner
_STREAM = 1 << 40  # the operator model of the same seed uses the numbers before


@jit
def scan(
    pose: Pose, lidar: Lidar, discs: Floats, walls: Floats, grid: Grid, seed: int, number: int,
    ranges: Floats,
) -> None:  # fmt: skip
    """One scan from a body pose, all beams at one instant, written into `ranges` (n,) [m].

    discs: (d, 6). walls: (s, 4). A beam is inf without a return within range_max, and -inf where
    the surface is nearer than range_min (REP-117); measured ranges stay within the two, noise
    included. Scan `number` of `seed` is always the same. All beams are NaN where the pose is not
    finite. A wall seen exactly end-on has no width; what is not finite is not seen.
    """
    sight(pose, lidar, discs, walls, grid, ranges)
    measure(lidar, seed, number, ranges)


@jit
def sight(
    pose: Pose, lidar: Lidar, discs: Floats, walls: Floats, grid: Grid, ranges: Floats
) -> None:
    """True distances along the beams, as in `scan`, without the sensor's errors."""
    x, y, c, s = eye(pose, lidar.mount)
    if not math.isfinite(x + y + c + s):
        ranges[:] = math.nan
        return
    ranges[:] = math.inf
    for i in range(discs.shape[0]):
        dx, dy = discs[i, X] - x, discs[i, Y] - y
        _see_disc(lidar, c * dx + s * dy, -s * dx + c * dy, discs[i, RADIUS], ranges)
    for i in range(walls.shape[0]):
        ax, ay, bx, by = walls[i, 0] - x, walls[i, 1] - y, walls[i, 2] - x, walls[i, 3] - y
        _see_wall(
            lidar, c * ax + s * ay, -s * ax + c * ay, c * bx + s * by, -s * bx + c * by, ranges
        )
    if grid.free.size > 0:
        for i in range(len(ranges)):
            dx, dy = lidar.beams[i, 0], lidar.beams[i, 1]
            reach = min(ranges[i], lidar.range_max)
            ranges[i] = min(ranges[i], cast(grid, x, y, c * dx - s * dy, s * dx + c * dy, reach))


def noise_seed(seed: int, number: int) -> int:
    """Of the noise of one of several LiDARs; of the first one, number 0, the seed as it is."""
    return seed if number == 0 else int(np.random.default_rng([seed, number]).integers(2**31))


@jit
def _see_disc(lidar: Lidar, x: float, y: float, radius: float, ranges: Floats) -> None:
    """Shorten the beams that meet a disc; (x, y) in the sensor frame."""
    square = x * x + y * y
    distance = math.sqrt(square)
    if not distance - radius <= lidar.range_max:
        return
    if distance <= radius:
        ranges[:] = 0.0
        return
    half = math.asin(radius / distance)
    middle = math.atan2(y, x)
    for turn in range(-1, 2):
        low, high = _within(lidar, middle - half, middle + half, turn)
        for i in range(low, high):
            dx, dy = lidar.beams[i, 0], lidar.beams[i, 1]
            along, across = x * dx + y * dy, x * dy - y * dx
            deep = radius * radius - across * across
            if deep >= 0.0 and along > 0.0:
                ranges[i] = min(ranges[i], along - math.sqrt(deep))


@jit
def _see_wall(lidar: Lidar, ax: float, ay: float, bx: float, by: float, ranges: Floats) -> None:
    """Shorten the beams that meet a wall from a to b, in the sensor frame."""
    ex, ey = bx - ax, by - ay
    length = ex * ex + ey * ey
    u = min(max(-(ax * ex + ay * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
    nearest = math.hypot(ax + u * ex, ay + u * ey)
    if not nearest <= lidar.range_max:
        return
    if nearest < _AGAINST:
        ranges[:] = 0.0
        return
    cross = ax * by - ay * bx  # = a x e: seen from the sensor, b is to the left of a if positive
    start = math.atan2(ay, ax)
    end = start + math.atan2(cross, ax * bx + ay * by)
    for turn in range(-1, 2):
        low, high = _within(lidar, min(start, end), max(start, end), turn)
        for i in range(low, high):
            dx, dy = lidar.beams[i, 0], lidar.beams[i, 1]
            slope = dx * ey - dy * ex
            if slope == 0.0:
                continue
            t, where = cross / slope, (ax * dy - ay * dx) / slope
            if t >= 0.0 and -_CORNER <= where <= 1.0 + _CORNER:
                ranges[i] = min(ranges[i], t)


@jit
def _within(lidar: Lidar, low: float, high: float, turn: int) -> tuple[int, int]:
    """Beams first:last between two bearings, shifted by whole turns, one more on each side."""
    shift = 2.0 * math.pi * turn - lidar.first
    n = len(lidar.beams)
    first = math.floor((low + shift) / lidar.step) - 1
    last = math.ceil((high + shift) / lidar.step) + 2
    return min(max(first, 0), n), min(max(last, 0), n)


@jit
def measure(lidar: Lidar, seed: int, number: int, ranges: Floats) -> None:
    """Turn true distances into what the sensor reports; NaN stays NaN."""
    for i in range(len(ranges)):
        if ranges[i] != ranges[i]:
            continue
        if ranges[i] > lidar.range_max:
            ranges[i] = math.inf
            continue
        k = _STREAM + 2 * (number * len(ranges) + i)
        if lidar.lost > -math.inf and normal(seed, k) < lidar.lost:
            ranges[i] = math.inf
        elif ranges[i] < lidar.range_min:
            ranges[i] = -math.inf
        elif lidar.noise > 0.0:
            noisy = ranges[i] + lidar.noise * normal(seed, k + 1)
            ranges[i] = min(max(noisy, lidar.range_min), lidar.range_max)
