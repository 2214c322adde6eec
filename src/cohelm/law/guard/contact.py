"""Nearest point of the outline to an obstacle, and the direction that increases the clearance.

All in the body frame. An outline is convex, (k >= 1, 2) corners counter-clockwise; a corner may be
repeated and the whole may be a line or a point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_no_refcount
from cohelm.core.types import Floats


class NearestPoint(NamedTuple):
    """The nearest point of the outline to an obstacle.

    clearance [m], negative inside. (qx, qy): the outline's point [m]. (nx, ny): unit vector from
    the obstacle to the robot, in which the clearance grows.
    """

    clearance: float
    qx: float
    qy: float
    nx: float
    ny: float


@jit_no_refcount
def contact(outline: Floats, px: float, py: float) -> NearestPoint:
    """The contact with a point; inside the outline, through the nearest edge."""
    k = outline.shape[0]
    best, qx, qy = math.inf, 0.0, 0.0
    dot = True
    for i in range(k):
        j = i + 1 if i + 1 < k else 0
        ax, ay = outline[i, 0], outline[i, 1]
        ex, ey = outline[j, 0] - ax, outline[j, 1] - ay
        wx, wy = px - ax, py - ay
        edge = ex * ex + ey * ey
        dot = dot and edge == 0.0
        if edge > 0.0 and wx * ey - wy * ex >= 0.0:  # on or beyond this edge
            s = min(max((wx * ex + wy * ey) / edge, 0.0), 1.0)
            gx, gy = wx - s * ex, wy - s * ey
            square = gx * gx + gy * gy
            if square < best:
                best, qx, qy = square, ax + s * ex, ay + s * ey
    if dot:  # a robot of no size
        qx, qy = outline[0, 0], outline[0, 1]
        best = (qx - px) * (qx - px) + (qy - py) * (qy - py)
    far = math.sqrt(best)
    if 1e-12 < far < math.inf:
        return NearestPoint(far, qx, qy, (qx - px) / far, (qy - py) / far)
    inside = overlap(outline, px, py, px, py)
    return NearestPoint(min(inside.clearance, 0.0), px, py, inside.nx, inside.ny)


@jit_no_refcount
def point_clearance(outline: Floats, px: float, py: float) -> float:
    """The clearance of `contact` alone [m]."""
    k = outline.shape[0]
    best = math.inf
    for i in range(k):
        j = i + 1 if i + 1 < k else 0
        ax, ay = outline[i, 0], outline[i, 1]
        ex, ey = outline[j, 0] - ax, outline[j, 1] - ay
        wx, wy = px - ax, py - ay
        if wx * ey - wy * ex > 0.0:
            s = min(max((wx * ex + wy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
            gx, gy = wx - s * ex, wy - s * ey
            best = min(best, gx * gx + gy * gy)
    if best < math.inf:
        return math.sqrt(best)
    return contact(outline, px, py).clearance


@jit_no_refcount
def wall_clearance(outline: Floats, ax: float, ay: float, bx: float, by: float) -> float:
    """The clearance to a segment [m]; where they cross, minus the shortest way out of it."""
    depth = overlap(outline, ax, ay, bx, by).clearance
    if depth < 0.0:
        return depth
    # Two convex shapes apart are nearest at a corner of one of them.
    best = min(point_clearance(outline, ax, ay), point_clearance(outline, bx, by))
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    for i in range(outline.shape[0]):
        wx, wy = outline[i, 0] - ax, outline[i, 1] - ay
        if 0.0 < wx * ex + wy * ey < square:
            best = min(best, abs(wx * ey - wy * ex) / math.sqrt(square))
    return best


@jit_no_refcount
def overlap(outline: Floats, ax: float, ay: float, bx: float, by: float) -> NearestPoint:
    """The shortest way out of a segment, which may be a point; clearance < 0 only if there is one.

    The largest separation along the normals of the outline's edges and of the segment; two
    convex shapes apart have one >= 0 among them.
    """
    best = NearestPoint(-math.inf, ax, ay, -1.0, 0.0)
    ex, ey = bx - ax, by - ay
    length = math.sqrt(ex * ex + ey * ey)
    right, left = (
        NearestPoint(math.inf, ax, ay, -1.0, 0.0),
        NearestPoint(math.inf, ax, ay, -1.0, 0.0),
    )
    k = outline.shape[0]
    for i in range(k):
        j = i + 1 if i + 1 < k else 0
        cx, cy = outline[i, 0], outline[i, 1]
        fx, fy = outline[j, 0] - cx, outline[j, 1] - cy
        size = math.sqrt(fx * fx + fy * fy)
        if size > 0.0:
            a = ((ax - cx) * fy - (ay - cy) * fx) / size
            b = ((bx - cx) * fy - (by - cy) * fx) / size
            if min(a, b) > best.clearance:
                x, y = (ax, ay) if a <= b else (bx, by)
                best = NearestPoint(min(a, b), x, y, -fy / size, fx / size)
        if length > 0.0:
            across = ((cx - ax) * ey - (cy - ay) * ex) / length  # > 0 to the segment's right
            if across < right.clearance:
                right = NearestPoint(across, cx, cy, ey / length, -ex / length)
            if -across < left.clearance:
                left = NearestPoint(-across, cx, cy, -ey / length, ex / length)
    if math.inf > right.clearance > best.clearance:
        best = right
    if math.inf > left.clearance > best.clearance:
        best = left
    # A point robot has no edges: at a point it is only ever in touch.
    return best if best.clearance > -math.inf else NearestPoint(0.0, ax, ay, -1.0, 0.0)
