"""The robot's outline: a convex polygon in the body frame, (k, 2) corners counter-clockwise [m]."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cohelm.core.arrays import floats
from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats

_LARGEST = 20.0  # a corner beyond this is given in another unit [m]
_STRAIGHT = 1e-9  # largest sine of a turn that counts as straight


def convex_outline(corners: ArrayLike) -> Floats:
    """Corners in the form that compiled code needs: (k, 2), convex, counter-clockwise [m].

    Clockwise corners are reversed; repeated ones, and those in the middle of an edge, are dropped:
    it is the same outline. A dent is refused: its convex hull would be safe for the filter, but
    returns inside the hull would be taken for the robot itself.

    Raises CohelmError for an invalid outline, with the cure.
    """
    try:
        given = floats("corners", corners)
    except CohelmError as error:
        raise CohelmError(_NOT_CORNERS) from error
    if given.ndim != 2 or given.shape[1] != 2:
        raise CohelmError(f"{_NOT_CORNERS}, got an array of shape {given.shape}")
    if not np.isfinite(given).all():
        raise CohelmError("an outline's corners must be finite numbers: look for NaN or inf in it")
    if given.size and np.abs(given).max() > _LARGEST:
        raise CohelmError(
            f"an outline's corners are in metres, got one {np.abs(given).max():g} m away: "
            "divide millimetres by 1000, and centimetres by 100"
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


def farthest_corner(outline: Floats) -> float:
    """Distance from the body origin to the outline's farthest corner [m]; compiled code has
    `clearance.circumscribed_radius`."""
    return float(np.hypot(outline[:, 0], outline[:, 1]).max())


def outside(points: Floats, outline: Floats) -> NDArray[np.bool_]:
    """Which points (p, 2) are outside of an outline, by more than a micrometre [m]."""
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.hypot(*edges.T)
    x, y = (points[:, None, i] - outline[None, :, i] for i in (0, 1))
    beyond = (edges[:, 1] * x - edges[:, 0] * y) / lengths
    return np.asarray(beyond.max(axis=1) > 1e-6)


def chord(outline: Floats, x: float, y: float, yaw: float) -> tuple[float, float]:
    """From where to where, along a direction [rad] from a point, a line lies within an outline [m];
    the second less than the first: nowhere."""
    edges = np.roll(outline, -1, axis=0) - outline
    out = np.column_stack((edges[:, 1], -edges[:, 0]))
    way = out @ np.array([math.cos(yaw), math.sin(yaw)])
    left = (out * (outline - np.array([x, y]))).sum(axis=1)
    enter, leave = -math.inf, math.inf
    for rate, room in zip(way.tolist(), left.tolist(), strict=True):
        if abs(rate) < 1e-12:
            leave = leave if room >= 0.0 else -math.inf
        elif rate > 0.0:
            leave = min(leave, room / rate)
        else:
            enter = max(enter, room / rate)
    return enter, leave


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
    """Positive where c is to the left of the line from a to b."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


_NOT_CORNERS = "an outline is a list of corners [[x, y], ...] in metres, x forward and y left"


def _turns(corners: Floats) -> tuple[Floats, Floats]:
    """At each corner: the cross and the dot product of the edges before and after it [m^2]."""
    into = corners - np.roll(corners, 1, axis=0)
    out = np.roll(into, -1, axis=0)
    return into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], (into * out).sum(axis=1)


def _straight(corners: Floats) -> NDArray[np.bool_]:
    """Corners in the middle of an edge, or dented by less than rounding; never a convex one."""
    turns, along = _turns(corners)
    return (turns <= 0.0) & (turns >= -_STRAIGHT * along)


def _area(corners: Floats) -> float:
    """Twice the enclosed area, negative where the corners are clockwise [m^2]."""
    x, y = corners.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
