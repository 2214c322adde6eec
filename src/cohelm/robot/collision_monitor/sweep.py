"""When a convex outline that moves on an arc meets points: exactly, without steps in time.

Seen from the body a resting point runs backwards round the centre of the turn. It enters the
outline where that circle first crosses an edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Twist

STRAIGHT = 1000.0
"""A turn of a larger radius is taken as straight [m]: half a millimetre aside in a metre."""
STRIDE = 0.05
"""Whether a motion takes a point out of the outline shows within so much way of it [m]: more than
a return in the outline can be wrong."""


class Outline(NamedTuple):
    """A convex outline, counter-clockwise, in the body frame. Edge i goes on from corner i."""

    corners: Floats
    """(k, 2) [m]"""
    normals: Floats
    """Of each edge, outwards, unit vectors, (k, 2)."""
    offsets: Floats
    """Of each edge from the origin along its normal, (k,) [m]."""
    first: Floats
    """Where each edge begins, along it, from the origin's foot on it, (k,) [m]."""
    last: Floats
    """And where it ends, (k,) [m]."""
    first_grows: Floats
    """By how much its beginning moves along it when all edges go out by 1 m, (k,)."""
    last_grows: Floats
    """And its end, (k,)."""
    spread: float
    """By how much a corner moves at most when all edges go out by 1 m."""
    reach: float
    """From the origin to the farthest corner [m]."""


def outline(corners: Floats) -> Outline:
    """With all that the sweep needs. corners: (k, 2), convex, counter-clockwise [m]."""
    after = np.roll(corners, -1, axis=0)
    edges = after - corners
    tangents = edges / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    normals = np.column_stack((tangents[:, 1], -tangents[:, 0]))
    before = np.roll(normals, 1, axis=0)
    grows = (normals + before) / (1.0 + (normals * before).sum(axis=1))[:, None]  # each corner
    return Outline(
        corners, normals, (normals * corners).sum(axis=1),
        (tangents * corners).sum(axis=1), (tangents * after).sum(axis=1),
        (tangents * grows).sum(axis=1), (tangents * np.roll(grows, -1, axis=0)).sum(axis=1),
        float(np.hypot(grows[:, 0], grows[:, 1]).max()),
        float(np.hypot(corners[:, 0], corners[:, 1]).max()),
    )  # fmt: skip


def around(points: Floats) -> Floats:
    """The smallest convex outline around points (p, 2), to a micrometre, counter-clockwise [m].

    Andrew's monotone chain (1979). Raises ValueError where they lie on a line.
    """
    rounded: list[list[float]] = np.round(points, 6).tolist()  # none too near for an edge
    given = sorted({(x, y) for x, y in rounded})
    half: list[list[tuple[float, float]]] = []
    for row in (given, given[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in row:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                    break
                chain.pop()
            chain.append((x, y))
        half.append(chain[:-1])
    if min(map(len, half)) < 1 or sum(map(len, half)) < 3:
        raise ValueError("an outline must have a width")
    return np.array(half[0] + half[1], dtype=np.float64)


def fastest(twist: Twist, shape: Outline) -> float:
    """No point of the outline is faster than this [m/s]."""
    return abs(twist.v) + abs(twist.omega) * shape.reach


def edge_distances(points: Floats, shape: Outline) -> Floats:
    """Of points of the body frame from the line of each edge, positive outside, (n, k) [m]."""
    return points @ shape.normals.T - shape.offsets


def contact_times(points: Floats, margins: Floats, twist: Twist, shape: Outline) -> Floats:
    """How long `twist` has to be held until the outline, grown by a margin, meets each point.

    points: (n, 2) in the body frame [m]; margins: (n,) [m]. Returns (n,) [s], infinite where it
    never does, 0 for a point inside.
    """
    outside = edge_distances(points, shape) - margins[:, None]
    if abs(twist.v) > STRAIGHT * abs(twist.omega):
        times = _straight(outside, twist, shape)
    elif twist.omega != 0.0:
        times = _turning(points, margins, twist, shape)
    else:
        times = np.full(len(points), math.inf)
    return np.where(outside.max(axis=1) <= 0.0, 0.0, times)


def outwards(points: Floats, twist: Twist, shape: Outline) -> Floats:
    """By how much points come farther out of the outline, or less deep in it, within a stride of
    the motion, (n,) [m]; below 0 for those that it takes in."""
    outside = edge_distances(points, shape)
    speeds = np.column_stack((twist.omega * points[:, 1] - twist.v, -twist.omega * points[:, 0]))
    stride = STRIDE / fastest(twist, shape)
    after = outside + stride * (speeds @ shape.normals.T)
    return after.max(axis=1) - outside.max(axis=1)


def _straight(outside: Floats, twist: Twist, shape: Outline) -> Floats:
    """The points run along x, with -v: in where all edges are passed, out where any is."""
    speeds = -twist.v * shape.normals[:, 0]
    enter, leave = np.zeros(len(outside)), np.full(len(outside), math.inf)
    for distance, speed in zip(outside.T, speeds, strict=True):
        if speed < 0.0:
            enter = np.maximum(enter, distance / -speed)
        elif speed > 0.0:
            leave = np.minimum(leave, distance / -speed)
        else:
            leave = np.where(distance > 0.0, -math.inf, leave)
    return np.where(enter <= leave, enter, math.inf)


def _turning(points: Floats, margins: Floats, twist: Twist, shape: Outline) -> Floats:
    """The points run round the centre of the turn, with -omega: where does that circle cross the
    line of an edge, and is that on the edge?"""
    centre = twist.v / twist.omega  # to the left
    radii = np.sqrt(points[:, 0] ** 2 + (points[:, 1] - centre) ** 2)
    times = np.full(len(points), math.inf)
    ring = np.flatnonzero(_in_ring(radii, margins, centre, shape))
    if not len(ring):
        return times
    points, radius, grown = points[ring], radii[ring, None], margins[ring, None]
    normals = shape.normals
    away = shape.offsets - centre * normals[:, 1] + grown  # of the edge's line from the centre
    half = np.sqrt(np.maximum((radius - away) * (radius + away), 0.0))
    crosses = radius >= np.abs(away)
    middle = centre * normals[:, 0]  # of the chord, along the edge
    first = shape.first + grown * shape.first_grows - middle
    last = shape.last + grown * shape.last_grows - middle
    least = np.full(len(ring), math.inf)
    for side in (-1.0, 1.0):
        i, edge = np.nonzero(crosses & (side * half >= first) & (side * half <= last))
        begins = np.arctan2(points[i, 1] - centre, points[i, 0])
        out, along = away[i, edge], side * half[i, edge]
        x = out * normals[edge, 0] - along * normals[edge, 1]
        y = out * normals[edge, 1] + along * normals[edge, 0]
        angle = math.copysign(1.0, twist.omega) * (begins - np.arctan2(y, x))
        np.minimum.at(least, i, np.remainder(angle, 2.0 * math.pi))
    times[ring] = least / abs(twist.omega)
    return times


def _in_ring(radii: Floats, margins: Floats, centre: float, shape: Outline) -> NDArray[np.bool_]:
    """Which circles round the centre of a turn, so far to the left, may meet the outline."""
    away = shape.corners - (0.0, centre)
    farthest = math.sqrt(float((away * away).sum(axis=1).max()))
    nearest = float((centre * shape.normals[:, 1] - shape.offsets).max())  # at least
    return (radii <= farthest + shape.spread * margins) & (radii >= nearest - margins)
