"""A window of grid cells that moves with the robot, in `odom`; indices are modulo its side.

`which`, (n, n, 2), has the cell that each entry of the window belongs to.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit_inline
from cohelm.core.types import Ints

CELL = 0.05
"""Side of a cell [m]."""
SIDE = 128
"""Cells along one side of a window, at least."""
NEVER = np.iinfo(np.int64).min
"""Marks an entry of no cell."""


def nowhere(side: int = SIDE) -> Ints:
    """The `which` of an empty window."""
    return np.full((side, side, 2), NEVER, np.int64)


@jit_inline
def cell(x: float) -> int:
    """The row or column of a coordinate."""
    return math.floor(x / CELL)


@jit_inline
def holds(which: Ints, i: int, j: int) -> bool:
    """Whether the window has an entry of this cell."""
    a, b = i % len(which), j % len(which)
    return which[a, b, 0] == i and which[a, b, 1] == j
