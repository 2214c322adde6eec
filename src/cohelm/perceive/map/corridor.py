"""Where along a corridor two submaps fit on each other.

There, matching holds only to what stands out of the walls: it finds the nearest, within its reach,
and nothing where the two drives went opposite ways, since each saw the other faces of the door
frames. Where walls begin, end and step back both have seen, so the likelihood of all points of a
submap is compared between places along the corridor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.match.surfaces import FlatPoints, Surfaces, row_at

_STEP = 0.05  # between two places [m]
_SIGMA = 0.05  # of a point from its surface, of two submaps [m]
_OUTLIER = 2.3  # most that a point counts: one in ten has no surface [nats]
_APART = 0.2  # places nearer to each other are the same [m]


class Shift(NamedTuple):
    """along: from the first guess [m]. lead: over all places elsewhere [nats]. information: of the
    shift [1/m^2]."""

    along: float
    lead: float
    information: float


@jit
def shifted(
    known: Surfaces, flat: FlatPoints, pose: Pose, axis: Floats, reach: float, weight: float
) -> Shift:
    """The likeliest shift, within `reach` [m], of points with normals in the frame of a pose.

    known, flat: with normals towards the visible side. axis: (2,), of unit length. weight: of a
    point, the share of its error that is its own. The lead is 0 where the likeliest is the
    farthest.
    """
    half = math.ceil(reach / _STEP)
    count = 2 * half + 1
    likelihood = np.zeros(count)
    points, normals = flat.points, flat.normals
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for k in range(len(points)):
        qx = pose.x + c * points[k, 0] - s * points[k, 1]
        qy = pose.y + s * points[k, 0] + c * points[k, 1]
        ax = c * normals[k, 0] - s * normals[k, 1]
        ay = s * normals[k, 0] + c * normals[k, 1]
        for n in range(count):
            px, py = qx + (n - half) * _STEP * axis[0], qy + (n - half) * _STEP * axis[1]
            i = row_at(known, px, py)
            if i < 0:
                continue
            if ax * known.normals[i, 0] + ay * known.normals[i, 1] < -0.85:
                i = known.back[i]  # the other side of the wall
            if i < 0 or ax * known.normals[i, 0] + ay * known.normals[i, 1] < 0.85:
                continue
            dx, dy = px - known.points[i, 0], py - known.points[i, 1]
            cost = 0.5 * (dx * dx + dy * dy) / (_SIGMA * _SIGMA)
            likelihood[n] += weight * max(_OUTLIER - cost, 0.0)
    best = int(likelihood.argmax())
    wide = round(2.0 * _SIGMA / _STEP)
    along = (best - half) * _STEP
    if not wide <= best < count - wide:
        return Shift(along, 0.0, 0.0)
    other = 0.0
    for n in range(count):
        if abs(n - best) * _STEP > _APART:
            other = max(other, likelihood[n])
    # of the parabola through the best and those two sigma of a point away
    low, high, span = likelihood[best - wide], likelihood[best + wide], wide * _STEP
    curve = 2.0 * likelihood[best] - low - high
    if curve <= 0.0:
        return Shift(along, 0.0, 0.0)
    along += 0.5 * span * (high - low) / curve
    return Shift(along, likelihood[best] - other, curve / (span * span))
