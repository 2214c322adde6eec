"""Remembers the ground near the robot, cell by cell: what was seen free, so what came there since.

A thing that stands where a whole patch was free before has come by itself, however slowly and
however it is seen now, and may go on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints
from cohelm.perceive.scan.clusters import FREE, Look
from cohelm.perceive.scan.deskew import all_round, beam_at
from cohelm.perceive.space.cell_window import CELL, SIDE, cell, holds, nowhere
from cohelm.robot.sensors import Lidar

NEAR = 2.5
"""Farther from the LiDAR than this, ground is not looked at; a window reaches farther [m]."""

PERHAPS, SURELY = 1, 2  # whether something has come by itself
_STOOD = 8.0  # what was seen in a cell in so many sweeps stood there


class Ground(NamedTuple):
    """A window of cells, see `perceive.space.cell_window`.

    free: (n, n), when a cell was last seen free, with room behind it. hits: (n, n), in how many
    sweeps since then something was seen in it, and last: in which. was: when it was seen free
    though something had stood in it. doubt: when somebody may have been there last whom nobody
    saw. -inf for never.

    All told by a clock that goes faster while the robot drives, since its odometry wears out what
    is remembered. Along a wall one can look past it within a hand's breadth, and past its other
    side later: in such cells something stood, and was not gone when they were seen free.
    """

    which: Ints
    free: Floats
    hits: Floats
    last: Floats
    was: Floats
    doubt: Floats


def unknown() -> Ground:
    """Nothing has been seen yet."""
    never = np.full((SIDE, SIDE), -math.inf)
    return Ground(nowhere(), never, np.zeros_like(never), never, never, never)


@jit
def _copied(ground: Ground) -> Ground:
    return Ground(
        ground.which.copy(), ground.free.copy(), ground.hits.copy(), ground.last.copy(),
        ground.was.copy(), ground.doubt.copy(),
    )  # fmt: skip


@jit
def noted(ground: Ground, lidar: Lidar, look: Look, standing: Floats, worn: float) -> Ground:
    """With what a sweep sees free, at `worn` by the ground's clock; standing: (p, 2), what it sees
    in `odom` that has not come by itself [m]."""
    made = _copied(ground)
    sensor, ranges = look.sensor, look.ranges
    for k in range(len(standing)):
        x, y = standing[k, 0], standing[k, 1]
        if abs(x - sensor.x) > NEAR or abs(y - sensor.y) > NEAR:
            continue
        a, b = _entry(made, cell(x), cell(y))
        if made.last[a, b] != worn:
            made.hits[a, b] += 1.0
            made.last[a, b] = worn
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = cell(sensor.x - NEAR), cell(sensor.y - NEAR)
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
                a, b = _entry(made, i, j)
                if made.hits[a, b] >= _STOOD:
                    made.was[a, b] = worn
                made.free[a, b], made.hits[a, b] = worn, 0.0
    return made


@jit
def doubted(ground: Ground, places: Floats, worn: float) -> Ground:
    """With places (p, 2) [m] where somebody may be at `worn` whom nobody sees: what is seen there
    next has perhaps come by itself, unless something stood there when it was last seen."""
    made = _copied(ground)
    for k in range(len(places)):
        a, b = _entry(made, cell(places[k, 0]), cell(places[k, 1]))
        if made.hits[a, b] == 0.0:
            made.doubt[a, b] = worn
    return made


@jit_inline
def _entry(ground: Ground, i: int, j: int) -> tuple[int, int]:
    """Where a cell's entry is; where it was of another cell, as if nothing had been seen yet."""
    a, b = i % SIDE, j % SIDE
    if not holds(ground.which, i, j):
        ground.which[a, b, 0], ground.which[a, b, 1] = i, j
        ground.free[a, b] = ground.last[a, b] = ground.was[a, b] = -math.inf
        ground.doubt[a, b] = -math.inf
        ground.hits[a, b] = 0.0
    return a, b


@jit
def came(ground: Ground, x: float, y: float, since: float) -> int:
    """Whether what is at an `odom` point has come since then [s]: SURELY, where the patch of cells
    around it was seen free, and nothing stood there before; PERHAPS, where of some of them nobody
    knows but that somebody may have been there; else 0."""
    row, column, found = cell(x), cell(y), SURELY
    for i in range(row - 1, row + 2):
        for j in range(column - 1, column + 2):
            a, b = i % SIDE, j % SIDE
            if not (holds(ground.which, i, j) and since > ground.was[a, b]):
                return 0
            if ground.free[a, b] >= since:
                continue
            if not ground.doubt[a, b] >= since:
                return 0
            found = PERHAPS
    return found
