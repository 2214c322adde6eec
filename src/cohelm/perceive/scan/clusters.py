"""Clusters of a scan: runs of neighbouring beams that end near each other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.perceive.scan.deskew import DeskewedScan, was_free
from cohelm.robot.sensors import Lidar

CX, CY, SIZE, OCCLUDED, FRESH, FIRST, LAST, AGE = range(8)
"""Columns of clusters: centre of the disc it may be [m], its radius [m], whether a part of it is
occluded, share of its points where space was free before, first and last point, age of its middle
beam at the sweep's stamp [s]."""

_JUMP = 0.12  # neighbouring ends farther apart are on different objects [m]
_WIDEST = 1.1  # largest size of a cluster [m]
_FARTHEST = 8.0  # largest range of a cluster, beyond which beams are too few [m]
_FEWEST = 3


@jit
def clusters(sweep: DeskewedScan, fixed: NDArray[np.bool_]) -> Floats:
    """Clusters of a sweep, (k, 8), in `odom`.

    fixed: (m,) points of walls of a map: they belong to no cluster, and separate clusters. The
    centre is behind the visible side of a disc, whose mean is pi/4 of the radius in front of it.
    FRESH is left 0.
    """
    points, beams, pose, lidar = sweep.points, sweep.beams, sweep.pose, sweep.lidar
    m = len(points)
    out = np.zeros((m, 8))
    beam_s = sweep.duration / max(len(lidar.beams) - 1, 1)
    k, a = 0, 0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    while a < m:
        b = a + 1
        if fixed[a]:
            a = b
            continue
        while b < m and not fixed[b] and _joined(lidar, points, beams, b):
            b += 1
        mx, my = lidar.mount.x, lidar.mount.y
        if b - a >= _FEWEST:
            x, y = points[a:b, 0].mean(), points[a:b, 1].mean()
            far = math.hypot(x - mx, y - my)
            dx, dy = (x - mx) / max(far, 1e-9), (y - my) / max(far, 1e-9)
            low, high = math.inf, -math.inf
            for i in range(a, b):
                across = -dy * (points[i, 0] - x) + dx * (points[i, 1] - y)
                low, high = min(low, across), max(high, across)
            length = math.hypot(points[b - 1, 0] - points[a, 0], points[b - 1, 1] - points[a, 1])
            if length < _WIDEST and far < min(_FARTHEST, lidar.range_max):
                size = min(max(0.5 * (high - low + far * lidar.step), 0.05), 0.6)
                bx, by = x + 0.785 * size * dx, y + 0.785 * size * dy
                out[k, CX], out[k, CY] = pose.x + c * bx - s * by, pose.y + s * bx + c * by
                out[k, SIZE] = size
                out[k, OCCLUDED] = 1.0 if _occluded(lidar, points, beams, a, b, far) else 0.0
                out[k, FIRST], out[k, LAST] = a, b
                later = len(lidar.beams) - 1 - 0.5 * (beams[a] + beams[b - 1])
                out[k, AGE] = beam_s * later
                k += 1
        a = b
    return out[:k].copy()


@jit
def _joined(lidar: Lidar, points: Floats, beams: Ints, i: int) -> bool:
    """Whether point i is on the same object as the one before."""
    if beams[i] - beams[i - 1] > 3:
        return False
    dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
    far = math.hypot(points[i, 0] - lidar.mount.x, points[i, 1] - lidar.mount.y)
    jump = max(_JUMP, 2.5 * far * lidar.step)
    return dx * dx + dy * dy < jump * jump


@jit
def _occluded(lidar: Lidar, points: Floats, beams: Ints, a: int, b: int, far: float) -> bool:
    """Whether the view ends beside points a:b, or a nearer object occludes it there."""
    if beams[a] == 0 or beams[b - 1] == len(lidar.beams) - 1:
        return True
    for i in (a - 1, b):
        if 0 <= i < len(points):
            beside = abs(beams[i] - (beams[a] if i < a else beams[b - 1])) <= 3
            near = math.hypot(points[i, 0] - lidar.mount.x, points[i, 1] - lidar.mount.y)
            if beside and near < far:
                return True
    return False


@jit
def update_freshness(found: Floats, places: Floats, earlier: DeskewedScan) -> None:
    """Raise FRESH of each cluster to the share of its points, at `places` in `odom`, where an
    earlier sweep saw free space."""
    for k in range(len(found)):
        a, b = int(found[k, FIRST]), int(found[k, LAST])
        free = 0
        for i in range(a, b):
            if was_free(earlier, places[i, 0], places[i, 1], 0.0):
                free += 1
        found[k, FRESH] = max(found[k, FRESH], free / (b - a))
