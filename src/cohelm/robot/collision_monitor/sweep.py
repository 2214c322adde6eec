"""Time to contact of a convex outline on an arc with points: exactly, without steps in time.

Seen from the body a resting point runs backwards round the centre of the turn. It enters the
outline where that circle first crosses an edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Twist

STRAIGHT = 1000.0
"""A turn of a larger radius counts as straight [m]: half a millimetre aside in a metre."""
STRIDE = 0.05
"""Way within which it shows whether a motion takes a point out of the outline [m]: more than the
error of a return in the outline."""


class Outline(NamedTuple):
    """A convex outline, counter-clockwise, in the body frame. Edge i begins at corner i."""

    corners: Floats
    """(k, 2) [m]"""
    normals: Floats
    """Outward unit normals of the edges, (k, 2)."""
    offsets: Floats
    """Distance of each edge from the origin along its normal, (k,) [m]."""
    first: Floats
    """Beginning of each edge, along it, from the origin's foot on it, (k,) [m]."""
    last: Floats
    """End of each edge, likewise, (k,) [m]."""
    first_grows: Floats
    """Motion of its beginning along it when all edges move outwards by 1 m, (k,)."""
    last_grows: Floats
    """Motion of its end, likewise, (k,)."""
    spread: float
    """Largest motion of a corner when all edges move outwards by 1 m."""
    reach: float
    """Distance from the origin to the farthest corner [m]."""


def outline(corners: Floats) -> Outline:
    """The outline with these corners: (k, 2), convex, counter-clockwise [m]."""
    corners = np.require(corners, np.float64, ("C", "W"))  # compiled code is made for one kind
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
    """Upper bound of the speed of the outline's points [m/s]."""
    return abs(twist.v) + abs(twist.omega) * shape.reach


@jit
def edge_distances(points: Floats, shape: Outline) -> Floats:
    """Distances of body-frame points from the line of each edge, positive outside, (n, k) [m]."""
    out = np.empty((len(points), len(shape.offsets)))
    for i in range(len(points)):
        for edge in range(len(shape.offsets)):
            out[i, edge] = _distance(points[i, 0], points[i, 1], edge, shape)
    return out


@jit_inline
def contact_time(
    x: float, y: float, margin: float, twist: Twist, shape: Outline, ring: Ring
) -> float:
    """Time to contact at a constant twist of the outline, grown by a margin [m], with a point of
    the body frame [s]: infinite where it never meets, 0 for a point inside. ring: by `ring_of`."""
    if outside(x, y, shape) <= margin:
        return 0.0
    if math.isnan(ring.centre):
        return _straight(x, y, margin, twist, shape)
    return _turning(x, y, margin, twist, shape, ring)


@jit_inline
def outside(x: float, y: float, shape: Outline) -> float:
    """Lower bound of a point's distance from the outline, below 0 within it [m]."""
    most = -math.inf
    for edge in range(len(shape.offsets)):
        most = max(most, _distance(x, y, edge, shape))
    return most


@jit_inline
def outwards(x: float, y: float, twist: Twist, shape: Outline) -> float:
    """Increase of a point's distance from the outline, negative inside, within `STRIDE` of the
    motion [m]; below 0 for one that the motion takes in."""
    stride = STRIDE / (abs(twist.v) + abs(twist.omega) * shape.reach)
    speed_x, speed_y = twist.omega * y - twist.v, -twist.omega * x
    after = -math.inf
    for edge in range(len(shape.offsets)):
        speed = speed_x * shape.normals[edge, 0] + speed_y * shape.normals[edge, 1]
        after = max(after, _distance(x, y, edge, shape) + stride * speed)
    return after - outside(x, y, shape)


@jit_inline
def _distance(x: float, y: float, edge: int, shape: Outline) -> float:
    return x * shape.normals[edge, 0] + y * shape.normals[edge, 1] - shape.offsets[edge]


@jit_inline
def _straight(x: float, y: float, margin: float, twist: Twist, shape: Outline) -> float:
    """The point runs along x, with -v: it enters at the last edge and leaves at the first."""
    enter, leave = 0.0, math.inf
    for edge in range(len(shape.offsets)):
        distance = _distance(x, y, edge, shape) - margin
        speed = -twist.v * shape.normals[edge, 0]
        if speed < 0.0:
            enter = max(enter, distance / -speed)
        elif speed > 0.0:
            leave = min(leave, distance / -speed)
        elif distance > 0.0:
            leave = -math.inf
    return enter if enter <= leave else math.inf


class Ring(NamedTuple):
    """The ring around the centre of a turn that the outline sweeps, without margins."""

    centre: float
    """Distance to the left [m]."""
    nearest: float
    farthest: float


@jit_inline
def ring_of(twist: Twist, shape: Outline) -> Ring:
    """The ring of a turn; NaN for a straight motion, and for none."""
    if twist.omega == 0.0 or abs(twist.v) > STRAIGHT * abs(twist.omega):
        return Ring(math.nan, math.nan, math.nan)
    centre = twist.v / twist.omega
    nearest = farthest = -math.inf
    for i in range(len(shape.offsets)):
        x, y = shape.corners[i, 0], shape.corners[i, 1] - centre
        farthest = max(farthest, math.sqrt(x * x + y * y))
        nearest = max(nearest, centre * shape.normals[i, 1] - shape.offsets[i])  # at least
    return Ring(centre, nearest, farthest)


@jit_inline
def _turning(x: float, y: float, margin: float, twist: Twist, shape: Outline, ring: Ring) -> float:
    """The point runs round the centre of the turn, with -omega: the first crossing of that circle
    with the line of an edge that is on the edge."""
    centre = ring.centre
    radius = math.sqrt(x * x + (y - centre) ** 2)
    if radius > ring.farthest + shape.spread * margin or radius < ring.nearest - margin:
        return math.inf
    begins = math.atan2(y - centre, x)
    least = math.inf
    for edge in range(len(shape.offsets)):
        nx, ny = shape.normals[edge, 0], shape.normals[edge, 1]
        away = shape.offsets[edge] - centre * ny + margin  # of the edge's line from the centre
        if radius < abs(away):
            continue
        half = math.sqrt(max((radius - away) * (radius + away), 0.0))
        middle = centre * nx  # of the chord, along the edge
        first = shape.first[edge] + margin * shape.first_grows[edge] - middle
        last = shape.last[edge] + margin * shape.last_grows[edge] - middle
        for along in (-half, half):
            if first <= along <= last:
                ends = math.atan2(away * ny + along * nx, away * nx - along * ny)
                angle = math.copysign(1.0, twist.omega) * (begins - ends)
                least = min(least, angle % (2.0 * math.pi))
    return least / abs(twist.omega)
