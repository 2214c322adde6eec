"""Clearance between the robot's real outline and the world (E7).

An outline is a convex polygon in the body frame, (k, 2) corners counter-clockwise [m].
Clearance is the gap [m]; it is 0 in touch and negative in overlap (minus the penetration
depth for a disc whose centre is inside, minus the overlap otherwise).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.facing import facing
from cohelm.core.jit import jit_inline
from cohelm.core.types import Floats, Pose

_LARGEST = 50.0  # a corner farther away than this is given in another unit [m]
_STRAIGHT = 1e-9  # sine of a turn that is none


def convex_outline(corners: ArrayLike) -> Floats:
    """Corners as all that is compiled needs them: (k, 2), convex, counter-clockwise [m].

    Clockwise corners are turned round; repeated ones, and those in the middle of an edge, are left
    out: it is the same outline. A dent is refused: its convex hull would be safe for the filter,
    but what the LiDAR sees inside the hull would be taken for the robot itself.

    Raises CohelmError for what is no outline, with the cure.
    """
    try:
        given = np.array(corners, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CohelmError(_NOT_CORNERS) from error
    if given.ndim != 2 or given.shape[1] != 2:
        raise CohelmError(f"{_NOT_CORNERS}, got an array of shape {given.shape}")
    if not np.isfinite(given).all():
        raise CohelmError("an outline's corners must be finite numbers: look for NaN or inf in it")
    if given.size and np.abs(given).max() > _LARGEST:
        raise CohelmError(
            f"an outline's corners are in metres, got one {np.abs(given).max():g} m away: "
            "divide millimetres by 1000"
        )
    kept = given[(given != np.roll(given, 1, axis=0)).any(axis=1)]
    if len(kept) < 3:
        raise CohelmError(
            f"an outline needs at least 3 different corners, got {len(kept)}: give all corners "
            "of the robot's footprint, going round once"
        )
    if _area(kept) < 0.0:
        kept = kept[::-1]
    while len(kept) >= 3 and (straight := _straight(kept)).any():
        kept = np.delete(kept, int(straight.argmax()), axis=0)
    if len(kept) < 3:
        raise CohelmError("the corners lie on a line: an outline must have a width")
    turns, along = _turns(kept)
    once = np.arctan2(turns, along).sum() < 3.0 * math.pi  # a star goes round twice
    if (turns > 0.0).all() and once:
        return np.ascontiguousarray(kept)
    if once and (turns < 0.0).sum() < 0.5 * len(kept):
        x, y = kept[int(turns.argmin())]
        raise CohelmError(
            f"the outline must be convex, but has a dent at [{x:g}, {y:g}]: leave that corner out, "
            "and the robot is taken to be as large as its convex hull"
        )
    raise CohelmError(
        "the outline must be convex, but crosses itself: give its corners in their order, going "
        "round once"
    )


def hull(points: Floats) -> Floats:
    """The smallest convex outline around points (p, 2), counter-clockwise [m]; they must not all
    lie on a line."""
    given = np.unique(points, axis=0)  # by x, then y
    sides: list[list[Floats]] = []
    for row in (given, given[::-1]):
        side: list[Floats] = []
        for point in row:
            while len(side) > 1 and _left(side[-2], side[-1], point) <= 0.0:
                side.pop()
            side.append(point)
        sides.append(side[:-1])
    return convex_outline(np.array(sides[0] + sides[1]))


def _left(a: Floats, b: Floats, c: Floats) -> float:
    """Above 0 where c is to the left of the line from a to b."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


_NOT_CORNERS = "an outline is a list of corners [[x, y], ...] in metres, x forward and y left"


def _turns(corners: Floats) -> tuple[Floats, Floats]:
    """At each corner: the cross and the dot product of the edges before and after it [m^2]."""
    into = corners - np.roll(corners, 1, axis=0)
    out = np.roll(into, -1, axis=0)
    return into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], (into * out).sum(axis=1)


def _straight(corners: Floats) -> NDArray[np.bool_]:
    """Corners in the middle of an edge, or dented by less than rounding; never one that is out."""
    turns, along = _turns(corners)
    return (turns <= 0.0) & (turns >= -_STRAIGHT * along)


def _area(corners: Floats) -> float:
    """Twice the enclosed area, negative where the corners are clockwise [m^2]."""
    x, y = corners.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


@jit_inline
def point_gap(outline: Floats, px: float, py: float) -> float:
    """Signed distance from a body-frame point to the outline, negative inside [m].

    Straight out from an edge, nothing is nearer; else it is the nearest corner of an edge that the
    point is beyond.
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
