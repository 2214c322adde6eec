"""Elastic band (Quinlan 1993): contracts and smooths a path, and pushes it off obstacles."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.types import Floats, Pose
from cohelm.plan.distance_field import DistanceField, clearance

_REFRESHES = 4  # number of times that the points are spaced evenly again
_AHEAD = math.radians(60.0)  # a path within this angle of the heading begins along the heading


def tangents(line: Floats) -> Floats:
    """Poses along a polyline (m, 2), m >= 2, heading from each point's predecessor to its
    successor, (m, 3) [m, rad]."""
    ahead = np.empty(line.shape)  # np.gradient takes five times as long
    ahead[0], ahead[-1] = line[1] - line[0], line[-1] - line[-2]
    ahead[1:-1] = line[2:] - line[:-2]
    return np.column_stack((line, np.arctan2(ahead[:, 1], ahead[:, 0])))


def distances(line: Floats) -> Floats:
    """Distance along a polyline (m, 2), m >= 1, of each of its points, (m,) [m]."""
    steps = np.diff(line, axis=0)
    return np.concatenate((np.zeros(1), np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))))


@jit
def spread(line: Floats, spacing: float) -> Floats:
    """A polyline (m, 2), m >= 1, as points evenly along it, at most `spacing` apart [m]."""
    m = len(line)
    along = np.zeros(m)
    for i in range(1, m):
        step = math.hypot(line[i, 0] - line[i - 1, 0], line[i, 1] - line[i - 1, 1])
        along[i] = along[i - 1] + step
    n = max(math.ceil(along[m - 1] / spacing), 1)
    points = np.empty((n + 1, 2))
    j = 0
    for i in range(n + 1):
        at = along[m - 1] if i == n else i * (along[m - 1] / n)
        while j < m - 2 and along[j + 1] <= at:
            j += 1
        for c in range(2):
            if at >= along[m - 1]:
                points[i, c] = line[m - 1, c]
            else:
                slope = (line[j + 1, c] - line[j, c]) / (along[j + 1] - along[j])
                points[i, c] = slope * (at - along[j]) + line[j, c]
    return points


def band(
    field: DistanceField, path: Floats, start: Pose, wanted: float, spacing: float, rounds: int
) -> Floats:
    """A path as smooth waypoints, (m, 2) [m], pushed off obstacles nearer than `wanted`.

    Begins at the robot, and along its heading if the path does so within 60 degrees.
    """
    points = path.copy()
    points[0] = start.x, start.y
    for _ in range(_REFRESHES):
        points = spread(points, spacing)
        fixed = 1
        if len(points) > 3:
            ahead = points[2] - points[0]
            off = math.remainder(math.atan2(ahead[1], ahead[0]) - start.psi, 2.0 * math.pi)
            if abs(off) < _AHEAD:
                heading = np.array([math.cos(start.psi), math.sin(start.psi)])
                points[1] = points[0] + spacing * heading
                fixed = 2
        pull(field, points, fixed, wanted, rounds // _REFRESHES)
    return points


@jit_no_refcount
def pull(field: DistanceField, points: Floats, fixed: int, wanted: float, rounds: int) -> None:
    """Move the points of a band in place; the first `fixed` and the last stay."""
    h = field.resolution
    for _ in range(rounds):
        for i in range(fixed, len(points) - 1):
            x, y = points[i, 0], points[i, 1]
            dx = 0.5 * (points[i - 1, 0] + points[i + 1, 0]) - x
            dy = 0.5 * (points[i - 1, 1] + points[i + 1, 1]) - y
            c = clearance(field, x, y)
            if c < wanted:
                # not normalised: between two walls it vanishes, and so must the push
                push = 0.15 * (wanted - c) / (2.0 * h)
                dx += push * (clearance(field, x + h, y) - clearance(field, x - h, y))
                dy += push * (clearance(field, x, y + h) - clearance(field, x, y - h))
            points[i, 0], points[i, 1] = x + 0.7 * dx, y + 0.7 * dy
