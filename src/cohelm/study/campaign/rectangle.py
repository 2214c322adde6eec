"""A rectangular room: its walls, a straight reference in it, whether a way leads through."""

from __future__ import annotations

import numpy as np
import scipy

from cohelm.core.types import Floats
from cohelm.law.reference import Reference, through

_CELL = 0.05  # of the grid on which a way is looked for [m]


def walls(length: float, width: float) -> Floats:
    """(4, 4), from (0, 0) on, counter-clockwise [m]."""
    return np.array(
        [[0, 0, length, 0], [length, 0, length, width], [length, width, 0, width], [0, width, 0, 0]]
    )


def straight(start: Floats, goal: Floats, speed: float) -> Reference:
    """From start to goal, (2,) [m], at a speed [m/s]."""
    n = max(round(float(np.hypot(*(goal - start)))), 2)
    return through(start + np.linspace(0.0, 1.0, n + 1)[:, None] * (goal - start), speed)


def places(length: float, width: float) -> tuple[Floats, Floats, Floats]:
    """x and y of the places where a way may lead, and how far each is from the walls, as grids
    [m]."""
    x, y = np.meshgrid(np.arange(0.0, length, _CELL), np.arange(0.0, width, _CELL))
    return x, y, np.minimum(np.minimum(x, length - x), np.minimum(y, width - y))


def leads(clear: Floats, start: Floats, goal: Floats, radius: float) -> bool:
    """Whether a circle can be rolled from start to goal. clear: how far from everything each of
    `places` is [m]."""
    pieces, _ = scipy.ndimage.label(clear > radius)
    at = [pieces[round(p[1] / _CELL), round(p[0] / _CELL)] for p in (start, goal)]
    return bool(at[0] != 0 and at[0] == at[1])
