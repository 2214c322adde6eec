"""A binary heap of numbers with keys, in two arrays, for searches."""

from __future__ import annotations

from cohelm.core.jit import jit_no_refcount
from cohelm.core.types import Floats, Ints


@jit_no_refcount
def push(keys: Floats, cells: Ints, size: int, key: float, cell: int) -> int:
    """Add an element to a binary heap of `size`; its new size."""
    at = size
    while at > 0:
        above = (at - 1) // 2
        if keys[above] <= key:
            break
        keys[at], cells[at] = keys[above], cells[above]
        at = above
    keys[at], cells[at] = key, cell
    return size + 1


@jit_no_refcount
def pop(keys: Floats, cells: Ints, size: int) -> int:
    """Remove the first element of a binary heap, that with the smallest key; its new size."""
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
