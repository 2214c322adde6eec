"""Free-space memory: grid cells near the robot that were seen free, and when.

An object that stands where a whole patch was free before has appeared by itself, however slowly,
and may move on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints
from cohelm.perceive.scan.deskew import FREE, DeskewedScan, all_round, beam_at
from cohelm.perceive.space.cell_window import CELL, SIDE, cell, holds, nowhere

NEAR = 2.5
"""Range of the memory from the LiDAR, at least; the window is larger [m]."""

POSSIBLY, CERTAINLY = 1, 2  # whether an object has appeared
_STOOD = 8.0  # sweeps with a return in a cell, after which something stood there


class FreeSpaceMemory(NamedTuple):
    """A window of cells, see `perceive.space.cell_window`.

    free: (n, n), when a cell was last seen free, with free space behind it. hits: (n, n), number of
    sweeps with a return in it since then, and last: the time of the last one. free_though_hit:
    when it was seen free though something had stood in it. possibly_occupied: when a mover out of
    view may have been there last. -inf for never.

    Times are of a clock that runs faster while the robot drives, since odometry drift wears out
    the memory. A wall can be seen past within a hand's breadth on one side, and later on the
    other: something stood in such cells, and was not gone when they were seen free.
    """

    which: Ints
    free: Floats
    hits: Floats
    last: Floats
    free_though_hit: Floats
    possibly_occupied: Floats


def empty_memory(near: float = NEAR) -> FreeSpaceMemory:
    """A memory without any scan. near: its range from the LiDAR [m]."""
    side = max(SIDE, 2 * math.ceil(near / CELL) + 2)
    never = np.full((side, side), -math.inf)
    return FreeSpaceMemory(nowhere(side), never, np.zeros_like(never), never, never, never)


@jit
def _copied(free_space: FreeSpaceMemory) -> FreeSpaceMemory:
    return FreeSpaceMemory(
        free_space.which.copy(), free_space.free.copy(), free_space.hits.copy(),
        free_space.last.copy(),
        free_space.free_though_hit.copy(), free_space.possibly_occupied.copy(),
    )  # fmt: skip


@jit
def with_scan(
    free_space: FreeSpaceMemory, sweep: DeskewedScan, static: Floats, clock: float, near: float
) -> FreeSpaceMemory:
    """The memory after a sweep at `clock`; static: (p, 2), its points in `odom` that have not
    appeared by themselves [m]. near: the range of the memory from the LiDAR [m]."""
    memory = _copied(free_space)
    sensor, ranges, lidar = sweep.sensor, sweep.ranges, sweep.lidar
    for k in range(len(static)):
        x, y = static[k, 0], static[k, 1]
        if abs(x - sensor.x) > near or abs(y - sensor.y) > near:
            continue
        a, b = _entry(memory, cell(x), cell(y))
        if memory.last[a, b] != clock:
            memory.hits[a, b] += 1.0
            memory.last[a, b] = clock
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = cell(sensor.x - near), cell(sensor.y - near)
    count = math.ceil(2.0 * near / CELL)
    n = len(ranges)
    around = all_round(lidar)
    for i in range(low_x, low_x + count):
        wx = (i + 0.5) * CELL - sensor.x
        for j in range(low_y, low_y + count):
            wy = (j + 0.5) * CELL - sensor.y
            square = wx * wx + wy * wy
            if square > near * near:
                continue
            beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
            least = math.sqrt(square) + FREE
            is_free = True
            for k in range(beam - 1, beam + 2):
                other = k % n if around else k
                if not (0 <= other < n and ranges[other] > least):
                    is_free = False
                    break
            if is_free:
                a, b = _entry(memory, i, j)
                if memory.hits[a, b] >= _STOOD:
                    memory.free_though_hit[a, b] = clock
                memory.free[a, b], memory.hits[a, b] = clock, 0.0
    return memory


@jit
def with_possibly_occupied(
    free_space: FreeSpaceMemory, places: Floats, clock: float
) -> FreeSpaceMemory:
    """The memory with places (p, 2) [m] that a mover out of view may occupy at `clock`: a return
    there may be a mover, unless something stood there when it was last in view."""
    memory = _copied(free_space)
    for k in range(len(places)):
        a, b = _entry(memory, cell(places[k, 0]), cell(places[k, 1]))
        if memory.hits[a, b] == 0.0:
            memory.possibly_occupied[a, b] = clock
    return memory


@jit_inline
def _entry(free_space: FreeSpaceMemory, i: int, j: int) -> tuple[int, int]:
    """Indices of a cell's entry, which is cleared if it was of another cell."""
    a, b = i % len(free_space.which), j % len(free_space.which)
    if not holds(free_space.which, i, j):
        free_space.which[a, b, 0], free_space.which[a, b, 1] = i, j
        free_space.free[a, b] = free_space.last[a, b] = free_space.free_though_hit[a, b] = -math.inf
        free_space.possibly_occupied[a, b] = -math.inf
        free_space.hits[a, b] = 0.0
    return a, b


@jit
def appeared(free_space: FreeSpaceMemory, x: float, y: float, since: float) -> int:
    """Whether a return at an `odom` point has appeared since then [s]: CERTAINLY, if the patch of
    cells around it was seen free, and nothing stood there before; POSSIBLY, if some of them are
    only known to be possibly occupied; else 0."""
    row, column, found = cell(x), cell(y), CERTAINLY
    for i in range(row - 1, row + 2):
        for j in range(column - 1, column + 2):
            a, b = i % len(free_space.which), j % len(free_space.which)
            if not (holds(free_space.which, i, j) and since > free_space.free_though_hit[a, b]):
                return 0
            if free_space.free[a, b] >= since:
                continue
            if not free_space.possibly_occupied[a, b] >= since:
                return 0
            found = POSSIBLY
    return found
