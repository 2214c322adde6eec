"""Cheapest paths over a grid: A* (Hart, Nilsson & Raphael 1968) on a binary heap, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints

NOT_REACHED = -1


@jit
def tree(free: NDArray[np.bool_], cost: Floats, root: int, target: int) -> Ints:
    """The cheapest 8-connected paths from a free cell, until the target's is known.

    free, cost: (rows, columns); a step costs its length in cells times the mean cost of its two
    ends, and cost >= 1. root, target: flat indices. Returns for each cell the flat index of the
    one before it, the root for itself, NOT_REACHED where no path leads; (rows * columns,). Cells
    that cost more than the target are undefined; without a path to it, all are defined.
    """
    rows, columns = free.shape
    n = rows * columns
    before = np.full(n, NOT_REACHED)
    if not free.flat[root]:
        return before
    spent = np.full(n, math.inf)
    settled = np.zeros(n, dtype=np.bool_)
    keys, cells = np.empty(8 * n + 8), np.empty(8 * n + 8, dtype=np.int64)
    to_i, to_j = target // columns, target % columns
    spent[root], before[root] = 0.0, root
    size = _push(keys, cells, 0, _at_least(root // columns, root % columns, to_i, to_j), root)
    while size > 0:
        cell = cells[0]
        size = _pop(keys, cells, size)
        if settled[cell]:
            continue
        settled[cell] = True
        if cell == target:
            break
        i, j = cell // columns, cell % columns
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if (di == 0 and dj == 0) or not (0 <= a < rows and 0 <= b < columns):
                    continue
                if not free[a, b]:
                    continue
                other = a * columns + b
                length = 1.4142135623730951 if di != 0 and dj != 0 else 1.0
                mean = 0.5 * (cost[i, j] + cost[a, b])
                there = float(spent[cell] + length * mean)
                if there < spent[other]:
                    spent[other], before[other] = there, cell
                    guess = there + _at_least(a, b, to_i, to_j)
                    size = _push(keys, cells, size, guess, other)
    return before


@jit
def _at_least(i: int, j: int, to_i: int, to_j: int) -> float:
    """The distance to the target where all is free and costs 1 [cells]."""
    di, dj = abs(i - to_i), abs(j - to_j)
    return max(di, dj) + 0.41421356237309503 * min(di, dj)


@jit
def _push(keys: Floats, cells: Ints, size: int, key: float, cell: int) -> int:
    at = size
    while at > 0:
        above = (at - 1) // 2
        if keys[above] <= key:
            break
        keys[at], cells[at] = keys[above], cells[above]
        at = above
    keys[at], cells[at] = key, cell
    return size + 1


@jit
def _pop(keys: Floats, cells: Ints, size: int) -> int:
    """Remove the first element of the heap."""
    size -= 1
    key, cell = keys[size], cells[size]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= size:
            break
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[at], cells[at] = keys[below], cells[below]
        at = below
    keys[at], cells[at] = key, cell
    return size
