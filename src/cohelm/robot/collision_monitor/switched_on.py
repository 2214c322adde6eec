"""The ground about a robot where it is switched on: how much of it is vouched for.

A person has looked that the robot can turn there. More than it needs for that is not taken for
free, nor what lies beyond a surface of which a part is in view.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.collision_monitor.sweep import Outline, edge_distances

VOUCHED = 0.2
"""Margin around what passes over ground out of view as the robot turns, within which that counts as
free where the robot is switched on: the operator has looked; and from there it can turn and look
for itself [m]."""

_GRAIN = 0.01  # between points of an edge of which it is looked whether they are in view [m]
_EDGE = 0.12  # nearer to the edge of the view it is not sure to know ground [m]
_PIECE = 0.3, 0.1  # the largest and the least length of a surface that gives its direction [m]
_FLAT = math.radians(10.0)  # beams do not see a surface at a smaller angle (Borges, Aldon 2004)


class CutSurface(NamedTuple):
    """A straight surface that goes on out of view, in the sensor's frame."""

    at: Floats
    """Where the view ends on it, (2,) [m]."""
    normal: Floats
    """Its unit normal, away from the sensor, (2,)."""
    offset: float
    """Its distance from the sensor along that [m]."""


def turning_radius(sensor: Sensor, shape: Outline) -> float:
    """How far from the body's origin, by which the robot turns, ground out of view comes within
    VOUCHED of the outline on its circle before it comes into view [m]."""
    farthest = 0.0
    for a, b in zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True):
        along = np.linspace(0.0, 1.0, math.ceil(math.dist(a, b) / _GRAIN) + 1)[:, None]
        edge = a + along * (b - a)
        outward = math.atan2(*(b - a)[::-1]) - 0.5 * math.pi
        turn = np.append(np.linspace(-math.pi, math.pi, 721) + outward, math.atan2(*a[::-1]))
        grown = VOUCHED * np.column_stack((np.cos(turn), np.sin(turn)))
        points = np.vstack((edge, edge + grown[360], a + grown))
        x, y = points[edge_distances(points, shape).max(axis=1) >= -1e-9].T
        mount, first, last = sensor.mount, sensor.bearings[0], sensor.bearings[-1]
        angle = (np.arctan2(y - mount.y, x - mount.x) - mount.psi - first) % (2.0 * math.pi)
        far = np.maximum(np.hypot(x - mount.x, y - mount.y), _EDGE)
        hidden = np.minimum(angle, last - first - angle) < np.arcsin(_EDGE / far)
        farthest = float(np.hypot(x, y)[hidden].max(initial=farthest))
    return farthest


def surface(ranges: Floats, bearings: Floats, noise: float) -> CutSurface | None:
    """The surface at the first of these beams, which is at the edge of the view; or None.

    Its direction is that of the returns next to it that belong to it, by least squares. Where they
    are too few it faces the sensor.
    """
    known = np.flatnonzero(~np.isnan(ranges))
    if not len(known) or not 0.0 <= ranges[known[0]] < math.inf:
        return None
    ends = np.isinf(ranges[known])  # at the first beam without a return, whatever comes after it
    known = known[: ends.argmax() if ends.any() else None]
    r, at = ranges[known], bearings[known]
    x, y = r * np.cos(at), r * np.sin(at)
    apart = np.abs(np.diff(at))
    gap = r[:-1] * np.sin(apart) / np.sin(np.maximum(_FLAT - apart, 1e-9)) + 3.0 * noise
    goes_on = (apart < _FLAT) & (np.hypot(np.diff(x), np.diff(y)) <= gap)
    goes_on &= np.hypot(x[1:] - x[0], y[1:] - y[0]) <= _PIECE[0]
    n = 1 + (len(goes_on) if goes_on.all() else int(goes_on.argmin()))
    points = np.column_stack((x[:n], y[:n]))
    if n < 3 or math.dist(points[0], points[-1]) < _PIECE[1]:
        return CutSurface(points[0], points[0] / max(float(r[0]), 1e-9), float(r[0]))
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle)[2][1]
    offset = float(normal @ middle)
    if offset < 0.0:
        normal, offset = -normal, -offset
    return CutSurface(points[0], normal, offset)
