"""Predicts moving obstacles for planning: where they will be when the robot could be there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, X, Y

_ROUND = 20  # points around a disc
_SAMPLES = 6  # predicted positions of one mover


class PredictionParams(NamedTuple):
    """Parameters of the prediction of movers for planning."""

    horizon: float = 4.0
    """Prediction horizon [s]."""
    early: float = 0.7
    late: float = 1.5
    """Interval of the robot's arrival, as shares of the time at cruising speed, since it may be
    slower, or not go straight."""
    slow: float = 0.05
    """Slower discs are static [m/s]."""
    right: float = 0.0
    """Width added to movers on the robot's left, so that it passes them on the right, as the
    paper's k_CBF does [m]."""


@jit
def meeting(dx: float, dy: float, vx: float, vy: float, speed: float) -> float:
    """Earliest time at which a robot of this speed can meet a mover; inf if never.

    (dx, dy): from the robot to the mover [m]. |d + v t| = speed t.
    """
    a = speed * speed - vx * vx - vy * vy
    b = dx * vx + dy * vy
    c = dx * dx + dy * dy
    if abs(a) < 1e-9:
        return -0.5 * c / b if b < 0.0 else math.inf
    root = b * b + a * c
    if root < 0.0:
        return math.inf
    t = (b + math.sqrt(root)) / a
    if a < 0.0:  # faster than the robot: it has to approach
        return t if b < 0.0 and t > 0.0 else math.inf
    return t


@jit
def predicted_encounters(
    discs: Floats, pose: Pose, speed: float, far: float, f: PredictionParams
) -> Floats:
    """Points on the moving discs where the robot could meet them, (p, 2) [m].

    pose: of the robot. speed: its cruising speed [m/s]. far: encounters farther away are ignored
    [m].
    """
    points = np.empty((len(discs) * _SAMPLES * _ROUND * 2, 2))
    n = 0
    for i in range(len(discs)):
        vx, vy, r = discs[i, VX], discs[i, VY], discs[i, RADIUS]
        if not math.hypot(vx, vy) >= f.slow:
            continue
        dx, dy = discs[i, X] - pose.x, discs[i, Y] - pose.y
        t = meeting(dx, dy, vx, vy, speed)
        if not t < f.horizon or not math.hypot(dx + vx * t, dy + vy * t) < far:
            continue
        first, last = f.early * t, min(f.late * t + 0.3, f.horizon)
        for k in range(_SAMPLES):
            at = first + (last - first) * k / (_SAMPLES - 1)
            x, y = discs[i, X] + vx * at, discs[i, Y] + vy * at
            n = _circle(points, n, x, y, r)
            if f.right > 0.0:
                away = max(math.hypot(x - pose.x, y - pose.y), 1e-9)
                left_x, left_y = -(y - pose.y) / away, (x - pose.x) / away
                n = _circle(points, n, x + f.right * left_x, y + f.right * left_y, r)
    return points[:n]


@jit
def _circle(points: Floats, n: int, x: float, y: float, radius: float) -> int:
    for j in range(_ROUND):
        angle = 2.0 * math.pi * j / _ROUND
        points[n, 0], points[n, 1] = x + radius * math.cos(angle), y + radius * math.sin(angle)
        n += 1
    return n
