"""Obstacles as the guard takes them: checked arrays, which stand, and how far others may get."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit_inline
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import VX, VY, Floats


@jit_inline
def is_static(obstacles: Surroundings, i: int) -> bool:
    """Whether disc i stands, and will not move."""
    speed = abs(obstacles.discs[i, VX]) + abs(obstacles.discs[i, VY])
    return speed + abs(obstacles.max_acceleration[i]) + abs(obstacles.velocity_error[i]) == 0.0


@jit_inline
def position_bound(velocity_error: float, max_acceleration: float, t: float) -> float:
    """How far from its course a disc may be t later [m]."""
    return (velocity_error + 0.5 * max_acceleration * t) * t


def surroundings(
    discs: ArrayLike | None = None, max_acceleration: ArrayLike | None = None,
    segments: ArrayLike | None = None, points: ArrayLike | None = None,
    velocity_error: ArrayLike | None = None,
) -> Surroundings:  # fmt: skip
    """Surroundings from any of these; discs without max_acceleration keep their velocity, and
    without velocity_error have exactly the stated one.

    Raises CohelmError for wrong shapes: compiled code would read past the end.
    """
    d = _rows("discs", discs, 6)
    return Surroundings(
        d, _per_disc("max_acceleration", max_acceleration, len(d)),
        _per_disc("velocity_error", velocity_error, len(d)),
        _rows("segments", segments, 4), _rows("points", points, 2),
    )  # fmt: skip


def _per_disc(name: str, values: ArrayLike | None, n: int) -> Floats:
    made = np.zeros(n) if values is None else _array(values)
    if made.shape != (n,):
        raise CohelmError(f"{name} needs one number per disc, {n}, got shape {made.shape}")
    return made


def _rows(name: str, values: ArrayLike | None, width: int) -> Floats:
    rows = np.empty((0, width)) if values is None else _array(values)
    if rows.size == 0:
        return rows.reshape(0, width)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise CohelmError(f"{name} need {width} columns, got shape {rows.shape}")
    return rows


def _array(values: ArrayLike) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)
