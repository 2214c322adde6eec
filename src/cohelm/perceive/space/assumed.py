"""Ground assumed free where a robot is switched on: what it needs to turn and look, and no more.

Nobody has seen it: a person who switches the robot on sees that it can turn. What stands there may
be in view in part. A surface that the edge of the view cuts is taken to go on behind it, straight:
a convex thing reaches no nearer than that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.space.cell_window import CELL
from cohelm.robot.clearance import disc_clearance
from cohelm.robot.sensors import Lidar

ASSUMED_FREE = 0.2
"""Ground is assumed free so far beside what passes over it as the robot turns [m]."""

_STEP = 0.02  # along the outline, between points at which its surroundings are looked at [m]
_SPAN = 0.3  # returns this near to the last one give the direction of its surface [m]
_LEAST_SPAN = 0.1  # nearer together they give none, and it faces the sensor [m]
_INCIDENCE = math.radians(10.0)  # beams meet a surface at no smaller angle (Borges, Aldon 2004)

SX, SY, NX, NY = range(4)
"""Columns of surfaces that go on out of view: where the view of each ends [m], and its unit normal,
away from the sensor."""


def turning_ground(outline: Floats, lidars: Sequence[Lidar]) -> float:
    """Radius of the ground that a robot needs to turn on the spot and look [m].

    Ground comes near a part of the outline on a circle about the origin. Where the surroundings of
    that part are in view, it is seen before; only what passes over ground out of view counts.

    outline: (k, 2) [m].
    """
    after = np.roll(outline, -1, axis=0)
    edges = [
        a + (b - a) * np.linspace(0.0, 1.0, math.ceil(math.dist(a, b) / _STEP) + 1)[:, None]
        for a, b in zip(outline, after, strict=True)
    ]
    angles = np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False)
    around = ASSUMED_FREE * np.column_stack((np.cos(angles), np.sin(angles)))
    points = (np.concatenate(edges)[:, None] + np.vstack(([[0.0, 0.0]], around))).reshape(-1, 2)
    hidden = np.ones(len(points), np.bool_)
    for lidar in lidars:
        away = points - lidar.mount[:2]
        begin = lidar.mount.psi + lidar.first - 0.5 * lidar.step
        angle = (np.arctan2(away[:, 1], away[:, 0]) - begin) % (2.0 * math.pi)
        edge = np.arcsin(CELL / np.maximum(np.hypot(*away.T), CELL))
        hidden &= np.minimum(angle, lidar.step * len(lidar.beams) - angle) < edge
    away = np.hypot(*points[hidden].T)
    here, farthest_first = Pose(0.0, 0.0, 0.0), np.argsort(-away)
    for (x, y), far in zip(points[hidden][farthest_first], away[farthest_first], strict=True):
        if disc_clearance(here, outline, x, y, 0.0) >= 0.0:
            return float(far)
    return 0.0


@jit
def cut_surfaces(lidar: Lidar, ranges: Floats, sensor: Pose) -> Floats:
    """The surfaces at the first and the last beam of a sweep, (k, 4), k <= 2, columns from `SX`
    on, in the frame of the sensor's pose.

    ranges: (n,) as in `DeskewedScan` [m].
    """
    found, k, n = np.empty((2, 4)), 0, len(ranges)
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    for first, inward in ((0, 1), (n - 1, -1)):
        i = first
        while 0 <= i < n and math.isnan(ranges[i]):
            i += inward
        if not (0 <= i < n and 0.0 <= ranges[i] < math.inf):
            continue
        x, y = ranges[i] * lidar.beams[i, 0], ranges[i] * lidar.beams[i, 1]
        nx, ny = lidar.beams[i, 0], lidar.beams[i, 1]
        m, sx, sy, sxx, sxy, syy, span = 1, x, y, x * x, x * y, y * y, 0.0
        px, py, last = x, y, i
        j = i + inward
        while 0 <= j < n:
            if not math.isnan(ranges[j]):
                apart = abs(j - last) * lidar.step
                if not ranges[j] < math.inf or ranges[j] < 0.0 or apart >= _INCIDENCE:
                    break
                qx, qy = ranges[j] * lidar.beams[j, 0], ranges[j] * lidar.beams[j, 1]
                gap = ranges[last] * math.sin(apart) / math.sin(_INCIDENCE - apart)
                far = math.hypot(qx - x, qy - y)
                if math.hypot(qx - px, qy - py) > gap + 3.0 * lidar.noise or far > _SPAN:
                    break
                m, sx, sy = m + 1, sx + qx, sy + qy
                sxx, sxy, syy = sxx + qx * qx, sxy + qx * qy, syy + qy * qy
                px, py, last, span = qx, qy, j, far
            j += inward
        if m > 2 and span >= _LEAST_SPAN:  # the line of least squares, by its normal
            mx, my = sx / m, sy / m
            angle = 0.5 * math.atan2(
                2.0 * (sxy / m - mx * my), sxx / m - mx * mx - (syy / m - my * my)
            )  # fmt: skip
            nx, ny = -math.sin(angle), math.cos(angle)
            away = nx * mx + ny * my
            if away < 0.0:
                nx, ny, away = -nx, -ny, -away
            off = nx * x + ny * y - away
            x, y = x - off * nx, y - off * ny
        found[k, SX], found[k, SY] = sensor.x + c * x - s * y, sensor.y + s * x + c * y
        found[k, NX], found[k, NY] = c * nx - s * ny, s * nx + c * ny
        k += 1
    return found[:k]
