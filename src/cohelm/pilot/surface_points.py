"""Samples all obstacles near the robot as points on their surfaces, for planners."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import RADIUS, Floats, Pose, X, Y

_ROUND = 24  # points around a disc, at least
_FINE = 0.03  # between points around a disc that is near [m]
_NEAR = 1.5  # the robot's centre to a disc's surface [m]


@jit_inline
def _ring(disc: Floats, pose: Pose) -> int:
    """How many points sample a disc: more for a near one, where chord errors matter."""
    r = disc[RADIUS]
    if math.hypot(disc[X] - pose.x, disc[Y] - pose.y) - r > _NEAR:
        return _ROUND
    return max(_ROUND, min(int(2.0 * math.pi * r / _FINE), 8 * _ROUND))


@jit
def surface_points(obstacles: Surroundings, pose: Pose, far: float, spacing: float) -> Floats:
    """All obstacles within `far` of the robot as points on their surfaces, (p, 2) [m].

    spacing: from one point on a wall to the next [m].
    """
    discs, walls, seen = obstacles.discs, obstacles.segments, obstacles.points
    most = len(seen)
    for i in range(len(discs)):
        most += _ring(discs[i], pose)
    for i in range(len(walls)):
        length = math.hypot(walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1])
        most += int(min(length, 2.0 * far) / spacing) + 2
    points = np.empty((most, 2))
    n = 0
    for i in range(len(discs)):
        dx, dy, r = discs[i, X] - pose.x, discs[i, Y] - pose.y, discs[i, RADIUS]
        if not math.hypot(dx, dy) < far + r:
            continue
        ring = _ring(discs[i], pose)
        for j in range(ring):
            angle = 2.0 * math.pi * j / ring
            points[n, 0] = discs[i, X] + r * math.cos(angle)
            points[n, 1] = discs[i, Y] + r * math.sin(angle)
            n += 1
    for i in range(len(walls)):
        ex, ey = walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1]
        length = math.hypot(ex, ey)
        if not 0.0 < length < math.inf:
            continue
        along = ((pose.x - walls[i, 0]) * ex + (pose.y - walls[i, 1]) * ey) / length
        across = ((pose.x - walls[i, 0]) * ey - (pose.y - walls[i, 1]) * ex) / length
        if not abs(across) < far:
            continue
        half = math.sqrt(far * far - across * across)
        first, last = max(along - half, 0.0), min(along + half, length)
        if first > last:
            continue
        steps = int((last - first) / spacing) + 1
        for j in range(steps + 1):
            share = (first + (last - first) * j / steps) / length
            points[n, 0], points[n, 1] = walls[i, 0] + share * ex, walls[i, 1] + share * ey
            n += 1
    for i in range(len(seen)):
        dx, dy = seen[i, 0] - pose.x, seen[i, 1] - pose.y
        if dx * dx + dy * dy < far * far:
            points[n, 0], points[n, 1] = seen[i, 0], seen[i, 1]
            n += 1
    return points[:n]
