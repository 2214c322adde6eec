"""Scan memory: the points of the last scan, and earlier ones that it could not see."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.frames import eye
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import beam_at
from cohelm.robot.sensors import Lidar

_MOST = 12  # beams on either side that a range is averaged with
_JUMP = 0.06  # neighbouring beams that differ by more than this are on different surfaces [m]

_AROUND = 0.5  # neighbourhood that defines the direction of a surface [m]
_LONG = 0.07  # its minimum extent, one standard deviation, for 25 cm [m]


KEEP = 8.0
"""Farther than this from the LiDAR, points are forgotten, unless the robot needs more [m]."""
_HALF_WIDTH = 0.02
"""How far to either side, on the same surface, ranges are averaged: near surfaces, where beams are
dense, become precise, and far ones are not rounded off [m]."""
_SPACING = 0.01  # points of one scan nearer to each other than this are merged [m]
_BEHIND = 0.10  # a remembered point this far behind a return is occluded, not gone [m]


@jit
def smoothed(ranges: Floats, step: float, half_width: float) -> Floats:
    """Each range averaged with its neighbours on the same surface, as many on either side.

    step: angle from one beam to the next [rad]. half_width: how far to either side [m].
    """
    n = len(ranges)
    out = ranges.copy()
    for i in range(n):
        total, count = ranges[i], 1
        if not -math.inf < total < math.inf:
            continue
        half_window = min(int(half_width / max(total * step, 1e-9)), _MOST)
        for k in range(1, half_window + 1):
            if i - k < 0 or i + k >= n:
                break
            a, b = ranges[i - k], ranges[i + k]
            if not (abs(a - ranges[i]) < _JUMP and abs(b - ranges[i]) < _JUMP):
                break
            total += a + b
            count += 2
        out[i] = total / count
    return out


@jit
def renew(points: Floats, pose: Pose, lidar: Lidar, ranges: Floats, keep: float) -> Floats:
    """The points after a scan from `pose`, world frame, (p, 2) [m].

    Points in view are replaced by the scan; points outside the field of view or occluded are kept.
    A beam without a return (inf) clears its points if its neighbours saw as far: single ones are
    drop-outs; NaN clears nothing. A range below the minimum (-inf) is put at the minimum. Nearer
    than `whole_from` beams may pass above an obstacle: its points are kept, unless beams end there.
    A thin wall that points at the sensor lies between two beams: beams that pass along it do not
    clear it. keep: distance from the LiDAR beyond which points are forgotten [m].
    """
    n = len(ranges)
    x, y, c, s = eye(pose, lidar.mount)
    made = np.empty((n + len(points), 2))
    m = 0
    clean = smoothed(ranges, lidar.step, _HALF_WIDTH)
    lx, ly = math.inf, math.inf
    for i in range(n):
        r = clean[i]
        if not r < keep:
            continue
        r = lidar.range_min if r == -math.inf else r
        b = lidar.first + lidar.step * i
        dx, dy = r * math.cos(b), r * math.sin(b)
        px, py = x + c * dx - s * dy, y + s * dx + c * dy
        if abs(px - lx) + abs(py - ly) < _SPACING:
            continue
        made[m, 0], made[m, 1] = px, py
        lx, ly = px, py
        m += 1
    for i in range(len(points)):
        wx, wy = points[i, 0] - x, points[i, 1] - y
        square = wx * wx + wy * wy
        if not square < keep * keep:
            continue
        beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
        far = math.sqrt(square)
        reach = _reaches(ranges, beam) if 0 <= beam < n else -math.inf
        if 0 <= beam < n and reach == -math.inf and abs(far - lidar.range_min) < _BEHIND:
            continue  # it has been added anew
        stands = reach < far + _BEHIND
        if reach + _BEHIND >= far and (far >= lidar.whole_from or stands):
            thin = far * lidar.step + 0.5 * lidar.noise
            past = reach > far + lidar.noise
            if not (past and _edge_on(points, i, wx / far, wy / far, thin)):
                continue
        made[m, 0], made[m, 1] = points[i, 0], points[i, 1]
        m += 1
    return made[:m].copy()


@jit
def _reaches(ranges: Floats, beam: int) -> float:
    """How far a beam has seen [m]: without a return, no farther than its neighbours."""
    reach = ranges[beam]
    if reach == math.inf:
        for other in range(max(beam - 1, 0), min(beam + 2, len(ranges))):
            reach = min(reach, ranges[other])
    return reach


@jit
def _edge_on(points: Floats, i: int, ux: float, uy: float, thin: float) -> bool:
    """Whether point i is on a surface parallel to the beam (ux, uy), between it and the next.

    This is so if the points around extend far along the beam, and across it by less than `thin`
    [m], one standard deviation: a leg or a body is not as long, or not as thin.
    """
    n, a, aa, b, bb = 0, 0.0, 0.0, 0.0, 0.0
    for j in range(len(points)):
        dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        if abs(dx) + abs(dy) > 1.5 * _AROUND or dx * dx + dy * dy > _AROUND * _AROUND:
            continue
        along, across = ux * dx + uy * dy, ux * dy - uy * dx
        n += 1
        a, aa = a + along, aa + along * along
        b, bb = b + across, bb + across * across
    return aa * n - a * a > (_LONG * n) ** 2 and bb * n - b * b < (thin * n) ** 2
