"""The ground near the robot, cell by cell: what has been seen free, and so what came there since.

A thing that stands where a whole patch was free before has come by itself, however slowly and
however it is seen now, and may go on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.perceive.clusters import FREE, Look
from cohelm.perceive.sweep import all_round, beam_at
from cohelm.robot.sensors import Lidar

CELL = 0.05
"""Side of a cell [m]."""
NEAR = 2.5
"""Farther from the LiDAR than this, ground is not looked at [m]."""
SIDE = 128
"""Cells along one side of a window of them; wider than NEAR both ways."""

_STOOD = 8.0  # what was seen in a cell in so many sweeps stood there


class Ground(NamedTuple):
    """A window of cells that goes with the robot, in `odom`; rows and columns are taken modulo
    its side.

    which: (n, n, 2), the cell that an entry is of. free: (n, n), when it was last seen free, with
    room behind it. hits: (n, n), in how many sweeps since then something was seen in it, and last:
    in which. was: when it was seen free though something had stood in it. -inf for never.

    All told by a clock that goes faster while the robot drives, since its odometry wears out what
    is remembered. Along a wall one can look past it within a hand's breadth, and past its other
    side later: in such cells something stood, and was not gone when they were seen free.
    """

    which: Ints
    free: Floats
    hits: Floats
    last: Floats
    was: Floats


def unknown() -> Ground:
    """Nothing has been seen yet."""
    far = np.full((SIDE, SIDE, 2), np.iinfo(np.int64).min, np.int64)
    never = np.full((SIDE, SIDE), -math.inf)
    return Ground(far, never, np.zeros_like(never), never, never)


@jit
def noted(ground: Ground, lidar: Lidar, look: Look, standing: Floats, worn: float) -> Ground:
    """With what a sweep sees free, at `worn` by the ground's clock; standing: (p, 2), what it sees
    in `odom` that has not come by itself [m]."""
    which, free = ground.which.copy(), ground.free.copy()
    hits, last, was = ground.hits.copy(), ground.last.copy(), ground.was.copy()
    for k in range(len(standing)):
        i, j = math.floor(standing[k, 0] / CELL), math.floor(standing[k, 1] / CELL)
        a, b = i % SIDE, j % SIDE
        if abs(standing[k, 0] - look.sensor.x) > NEAR or abs(standing[k, 1] - look.sensor.y) > NEAR:
            continue
        if which[a, b, 0] != i or which[a, b, 1] != j:
            which[a, b, 0], which[a, b, 1] = i, j
            free[a, b] = last[a, b] = was[a, b] = -math.inf
            hits[a, b] = 0.0
        if last[a, b] != worn:
            hits[a, b] += 1.0
            last[a, b] = worn
    sensor, ranges = look.sensor, look.ranges
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = math.floor((sensor.x - NEAR) / CELL), math.floor((sensor.y - NEAR) / CELL)
    wide = math.ceil(2.0 * NEAR / CELL)
    n = len(ranges)
    around = all_round(lidar)
    for i in range(low_x, low_x + wide):
        wx = (i + 0.5) * CELL - sensor.x
        for j in range(low_y, low_y + wide):
            wy = (j + 0.5) * CELL - sensor.y
            square = wx * wx + wy * wy
            if square > NEAR * NEAR:
                continue
            beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
            least = math.sqrt(square) + FREE
            open_ = True
            for k in range(beam - 1, beam + 2):
                other = k % n if around else k
                if not (0 <= other < n and ranges[other] > least):
                    open_ = False
                    break
            if open_:
                a, b = i % SIDE, j % SIDE
                if which[a, b, 0] != i or which[a, b, 1] != j:
                    which[a, b, 0], which[a, b, 1] = i, j
                    hits[a, b] = 0.0
                    last[a, b] = was[a, b] = -math.inf
                if hits[a, b] >= _STOOD:
                    was[a, b] = worn
                free[a, b], hits[a, b] = worn, 0.0
    return Ground(which, free, hits, last, was)


@jit
def came(ground: Ground, x: float, y: float, since: float) -> bool:
    """Whether the patch of cells around an `odom` point was seen free since then [s], and nothing
    stood there before it was seen free."""
    i, j = math.floor(x / CELL), math.floor(y / CELL)
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            at, on = a % SIDE, b % SIDE
            known = ground.which[at, on, 0] == a and ground.which[at, on, 1] == b
            if not (known and ground.free[at, on] >= since > ground.was[at, on]):
                return False
    return True
