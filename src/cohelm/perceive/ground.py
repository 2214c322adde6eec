"""The ground near the robot, cell by cell: what has been seen free, and so what came there since.

A thing that stands where a whole patch was free before has come by itself, however slowly and
however it is seen now, and may go on. And ground that was never in view may hold anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.perceive.clusters import FREE, Look
from cohelm.robot.sensors import Lidar

CELL = 0.05
"""Side of a cell [m]."""
NEAR = 2.5
"""Farther from the LiDAR than this, ground is not looked at [m]."""

_SIDE = 128  # cells along one side of the window; wider than NEAR both ways


class Ground(NamedTuple):
    """A window of cells that goes with the robot, in `odom`; rows and columns are taken modulo
    its side.

    which: (n, n, 2), the cell that an entry is of. free: (n, n), when it was last seen free, with
    room behind it [s]; -inf for never.
    """

    which: Ints
    free: Floats


def unknown() -> Ground:
    """Nothing has been seen yet."""
    far = np.full((_SIDE, _SIDE, 2), np.iinfo(np.int64).min, np.int64)
    return Ground(far, np.full((_SIDE, _SIDE), -math.inf))


@jit
def noted(ground: Ground, lidar: Lidar, look: Look) -> Ground:
    """With what a sweep sees free."""
    which, free = ground.which.copy(), ground.free.copy()
    sensor, ranges = look.sensor, look.ranges
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = math.floor((sensor.x - NEAR) / CELL), math.floor((sensor.y - NEAR) / CELL)
    wide = math.ceil(2.0 * NEAR / CELL)
    whole = 2.0 * math.pi
    around = lidar.step * len(ranges) > whole - 1.5 * lidar.step
    n = len(ranges)
    for i in range(low_x, low_x + wide):
        wx = (i + 0.5) * CELL - sensor.x
        for j in range(low_y, low_y + wide):
            wy = (j + 0.5) * CELL - sensor.y
            square = wx * wx + wy * wy
            if square > NEAR * NEAR:
                continue
            bearing = math.atan2(-s * wx + c * wy, c * wx + s * wy) - lidar.first
            if bearing < -0.5 * lidar.step:
                bearing += whole
            beam = math.floor(bearing / lidar.step + 0.5)
            least = math.sqrt(square) + FREE
            open_ = True
            for k in range(beam - 1, beam + 2):
                other = k % n if around else k
                if not (0 <= other < n and ranges[other] > least):
                    open_ = False
                    break
            if open_:
                a, b = i % _SIDE, j % _SIDE
                which[a, b, 0], which[a, b, 1] = i, j
                free[a, b] = look.stamp
    return Ground(which, free)


@jit
def came(ground: Ground, x: float, y: float, since: float) -> bool:
    """Whether the patch of cells around an `odom` point was seen free since then [s]."""
    i, j = math.floor(x / CELL), math.floor(y / CELL)
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            at, on = a % _SIDE, b % _SIDE
            known = ground.which[at, on, 0] == a and ground.which[at, on, 1] == b
            if not (known and ground.free[at, on] >= since):
                return False
    return True
