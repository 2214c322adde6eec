"""Distances to static obstacles on a grid around the robot, and points of the outline."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import RADIUS, Floats, Pose, X, Y
from cohelm.law.guard.surroundings import is_static

CELL = 0.06  # of the grid [m]
# Steps of the chamfer distance, at most 5 % too far; in whole units, which add up faster.
_SIDE, _ACROSS = np.int32(1000), np.int32(1414)
_UNIT = 0.95 * CELL / 1000.0  # [m]
_NOWHERE = np.int32(1_000_000_000)
_EDGE = 0.08  # between two points of the outline [m]


class StaticDistances(NamedTuple):
    """Distance to static obstacles on a grid around the robot."""

    distance: NDArray[np.int32]
    """(n, n), row along y, in `_UNIT`s."""
    x: float
    y: float
    """Corner of cell (0, 0) [m]."""


@jit
def distance_field_around(obstacles: Surroundings, pose: Pose, half: float) -> StaticDistances:
    """The distance field, by two sweeps over the grid (Borgefors 1986)."""
    n = int(2.0 * half / CELL) + 1
    x0, y0 = pose.x - half, pose.y - half
    d = np.full((n, n), _NOWHERE)
    for i in range(len(obstacles.points)):
        _mark(d, obstacles.points[i, 0] - x0, obstacles.points[i, 1] - y0)
    for i in range(len(obstacles.segments)):
        ax, ay = obstacles.segments[i, 0], obstacles.segments[i, 1]
        bx, by = obstacles.segments[i, 2], obstacles.segments[i, 3]
        length = math.hypot(bx - ax, by - ay)
        if not length < 1e6:
            continue
        along = ((pose.x - ax) * (bx - ax) + (pose.y - ay) * (by - ay)) / max(length, 1e-9)
        low, high = max(along - 1.5 * half, 0.0), min(along + 1.5 * half, length)
        for j in range(int(max(high - low, 0.0) / (0.7 * CELL)) + 1):
            s = min(low + 0.7 * CELL * j, length) / max(length, 1e-9)
            _mark(d, ax + s * (bx - ax) - x0, ay + s * (by - ay) - y0)
    for i in range(len(obstacles.discs)):
        disc, r = obstacles.discs[i], obstacles.discs[i, RADIUS]
        if (
            is_static(obstacles, i)
            and math.hypot(disc[X] - pose.x, disc[Y] - pose.y) < 1.5 * half + r
        ):
            m = int(2.0 * math.pi * r / (0.7 * CELL)) + 3
            for j in range(m):
                a = 2.0 * math.pi * j / m
                _mark(d, disc[X] + r * math.cos(a) - x0, disc[Y] + r * math.sin(a) - y0)
    _spread(d, 0, n, 1)
    _spread(d, n - 1, -1, -1)
    return StaticDistances(d, x0, y0)


@jit
def _spread(d: NDArray[np.int32], first: int, end: int, step: int) -> None:
    """One sweep, row after row, each from the one before it and from one side to the other.

    Two loops: the cells of the first are independent, so the compiler vectorizes it.
    """
    n = len(d)
    before, mixed = np.full(n + 2, _NOWHERE), np.empty(n, np.int32)
    for i in range(first, end, step):
        row = d[i]
        for j in range(n):
            least = min(before[j + 1] + _SIDE, before[j] + _ACROSS)
            mixed[j] = min(min(row[j], before[j + 2] + _ACROSS), least)
        b = _NOWHERE
        for j in range(first, end, step):
            b = min(np.int32(b + _SIDE), mixed[j])
            row[j] = before[j + 1] = b


@jit_no_refcount
def _mark(d: NDArray[np.int32], x: float, y: float) -> None:
    if x >= 0.0 and y >= 0.0:  # never for NaN
        i, j = int(min(y / CELL, 1e6)), int(min(x / CELL, 1e6))
        if i < len(d) and j < len(d):
            d[i, j] = 0


@jit_inline
def distance_at(f: StaticDistances, x: float, y: float) -> float:
    """Distance of a point to static obstacles, of its cell or the nearest one [m]."""
    n = len(f.distance)
    i, j = int((y - f.y) / CELL), int((x - f.x) / CELL)
    return f.distance[min(max(i, 0), n - 1), min(max(j, 0), n - 1)] * _UNIT


@jit
def outline_points(outline: Floats) -> Floats:
    """(e, 2), points along an outline [m]."""
    k = len(outline)
    n = 0
    for i in range(k):
        j = (i + 1) % k
        n += (
            int(math.hypot(outline[j, 0] - outline[i, 0], outline[j, 1] - outline[i, 1]) / _EDGE)
            + 1
        )
    points = np.empty((n, 2))
    n = 0
    for i in range(k):
        j = (i + 1) % k
        dx, dy = outline[j, 0] - outline[i, 0], outline[j, 1] - outline[i, 1]
        parts = int(math.hypot(dx, dy) / _EDGE) + 1
        for p in range(parts):
            points[n, 0], points[n, 1] = (
                outline[i, 0] + dx * p / parts,
                outline[i, 1] + dy * p / parts,
            )
            n += 1
    return points
