"""A window of grid cells that moves with the robot, in `odom`; indices are modulo its side.

`which`, (SIDE, SIDE, 2), has the cell that each entry of the window belongs to.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit_inline
from cohelm.core.types import Ints

CELL = 0.05
"""Side of a cell [m]."""
SIDE = 128
"""Cells along one side of a window."""


def nowhere() -> Ints:
    """The `which` of an empty window."""
    return np.full((SIDE, SIDE, 2), np.iinfo(np.int64).min, np.int64)


@jit_inline
def cell(x: float) -> int:
    """The row or column of a coordinate."""
    return math.floor(x / CELL)


@jit_inline
def holds(which: Ints, i: int, j: int) -> bool:
    """Whether the window has an entry of this cell."""
    a, b = i % SIDE, j % SIDE
    return which[a, b, 0] == i and which[a, b, 1] == j
