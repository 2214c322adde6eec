"""Clearance between the robot's real outline and the world (E7), compiled.

An outline is one of `robot.footprint`. Clearance is the gap [m]; it is 0 in contact and negative
in overlap: minus the penetration depth for a disc with its centre inside, else minus the overlap.
"""

from __future__ import annotations

import math

from cohelm.core.facing import facing
from cohelm.core.jit import jit_inline, jit_no_refcount
from cohelm.core.types import Floats, Pose


@jit_no_refcount
def circumscribed_radius(outline: Floats) -> float:
    """Distance from the body origin to the outline's farthest corner [m], as
    `footprint.farthest_corner`."""
    square = 0.0
    for i in range(outline.shape[0]):
        square = max(square, outline[i, 0] * outline[i, 0] + outline[i, 1] * outline[i, 1])
    return math.sqrt(square)


@jit_inline
def point_gap(outline: Floats, px: float, py: float) -> float:
    """Signed distance from a body-frame point to the outline, negative inside [m].

    The distance to an edge that the point is straight out from; else that to the nearest corner of
    the edges that the point is beyond.
    """
    k = outline.shape[0]
    corner = math.inf
    for i in range(k):
        j = i + 1 if i + 1 < k else 0
        ex, ey = outline[j, 0] - outline[i, 0], outline[j, 1] - outline[i, 1]
        wx, wy = px - outline[i, 0], py - outline[i, 1]
        beyond = wx * ey - wy * ex
        if not beyond > 0.0:
            continue  # only such an edge can be the nearest
        along, square = wx * ex + wy * ey, ex * ex + ey * ey
        if 0.0 <= along <= square:
            return beyond / math.sqrt(square)
        vx, vy = px - outline[j, 0], py - outline[j, 1]
        corner = min(corner, vx * vx + vy * vy if along > 0.0 else wx * wx + wy * wy)
    if corner < math.inf:
        return math.sqrt(corner)
    depth = math.inf
    for i in range(k):
        j = i + 1 if i + 1 < k else 0
        ex, ey = outline[j, 0] - outline[i, 0], outline[j, 1] - outline[i, 1]
        wx, wy = px - outline[i, 0], py - outline[i, 1]
        depth = min(depth, (wy * ex - wx * ey) / math.sqrt(ex * ex + ey * ey))
    return -depth


@jit_inline
def disc_clearance(pose: Pose, outline: Floats, x: float, y: float, radius: float) -> float:
    """Gap between the outline at `pose` and a disc in the world frame [m]."""
    c, s = facing(pose.psi)
    dx, dy = x - pose.x, y - pose.y
    return point_gap(outline, c * dx + s * dy, -s * dx + c * dy) - radius


@jit_inline
def segment_clearance(
    pose: Pose, outline: Floats, x1: float, y1: float, x2: float, y2: float
) -> float:
    """Gap between the outline at `pose` and a wall segment in the world frame [m].

    Two convex shapes that do not cross are nearest at a corner of one of them; crossing is
    found by clipping the segment with the outline, and then the clearance is minus the depth
    of the deepest of the clipped part's ends and middle.
    """
    c, s = facing(pose.psi)
    ax = c * (x1 - pose.x) + s * (y1 - pose.y)
    ay = -s * (x1 - pose.x) + c * (y1 - pose.y)
    bx = c * (x2 - pose.x) + s * (y2 - pose.y)
    by = -s * (x2 - pose.x) + c * (y2 - pose.y)
    ex, ey = bx - ax, by - ay
    enter, leave = 0.0, 1.0
    k = outline.shape[0]
    for i in range(k):
        j = i + 1 if i + 1 < k else 0
        nx, ny = outline[j, 1] - outline[i, 1], outline[i, 0] - outline[j, 0]
        start = (ax - outline[i, 0]) * nx + (ay - outline[i, 1]) * ny
        slope = ex * nx + ey * ny
        if slope < 0.0:
            enter = max(enter, -start / slope)
        elif slope > 0.0:
            leave = min(leave, -start / slope)
        elif start > 0.0:
            leave = -1.0
    if enter <= leave:
        middle = 0.5 * (enter + leave)
        deepest = min(0.0, point_gap(outline, ax + enter * ex, ay + enter * ey))
        deepest = min(deepest, point_gap(outline, ax + leave * ex, ay + leave * ey))
        return min(deepest, point_gap(outline, ax + middle * ex, ay + middle * ey))
    gap = min(point_gap(outline, ax, ay), point_gap(outline, bx, by))
    length = ex * ex + ey * ey
    for i in range(k):
        wx, wy = outline[i, 0] - ax, outline[i, 1] - ay
        t = min(max((wx * ex + wy * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
        gx, gy = wx - t * ex, wy - t * ey
        gap = min(gap, math.sqrt(gx * gx + gy * gy))
    return gap
