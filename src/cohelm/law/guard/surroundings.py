"""What the guard must not touch, in one tuple of arrays, all in one frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit_inline
from cohelm.core.types import VX, VY, Floats


class Surroundings(NamedTuple):
    """Everything the robot could hit, in the frame that its pose is given in.

    discs: (n, 6), columns as in `core.types`; a disc moves on with its velocity. max_acceleration:
    (n,), the largest acceleration each disc is assumed to be capable of [m/s^2]; 0 for one that
    surely keeps its velocity, a standing one with 0 will never move. velocity_error: (n,), by how
    much its velocity may be another one already [m/s]: t later it is within velocity_error t +
    max_acceleration t^2 / 2 of where that brings it. segments: (m, 4), walls x1, y1, x2, y2 [m].
    points: (p, 2), such as LiDAR returns [m].

    A point that is not finite is a beam that hit nothing; a disc or wall that is not finite is
    something wrong, and the guard brakes. Things are counted through: discs, segments, points.
    """

    discs: Floats
    max_acceleration: Floats
    velocity_error: Floats
    segments: Floats
    points: Floats


@jit_inline
def rests(around: Surroundings, i: int) -> bool:
    """Whether disc i stands, and surely will."""
    still = around.discs[i, VX] == 0.0 and around.discs[i, VY] == 0.0
    return still and around.max_acceleration[i] == 0.0 and around.velocity_error[i] == 0.0


@jit_inline
def strayed(off: float, most: float, t: float) -> float:
    """How far from its course a disc may be t later, with that velocity_error and max_acceleration
    [m]."""
    return (off + 0.5 * most * t) * t


def surroundings(
    discs: ArrayLike | None = None,
    max_acceleration: ArrayLike | None = None,
    segments: ArrayLike | None = None,
    points: ArrayLike | None = None,
    velocity_error: ArrayLike | None = None,
) -> Surroundings:
    """Surroundings from what there is; discs without a given largest acceleration keep their
    velocity, and without a given error have the stated one.

    Raises CohelmError where the shapes do not fit: compiled code would read past the end.
    """
    d = _rows("discs", discs, 6)
    return Surroundings(
        d, _one_each("max_acceleration", max_acceleration, len(d)),
        _one_each("velocity_error", velocity_error, len(d)),
        _rows("segments", segments, 4), _rows("points", points, 2),
    )  # fmt: skip


def _one_each(name: str, given: ArrayLike | None, n: int) -> Floats:
    made = np.zeros(n) if given is None else _array(given)
    if made.shape != (n,):
        raise CohelmError(f"{name} needs one number per disc, {n}, got shape {made.shape}")
    return made


def _rows(name: str, given: ArrayLike | None, width: int) -> Floats:
    rows = np.empty((0, width)) if given is None else _array(given)
    if rows.size == 0:
        return rows.reshape(0, width)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise CohelmError(f"{name} need {width} columns, got shape {rows.shape}")
    return rows


def _array(given: ArrayLike) -> Floats:
    return np.ascontiguousarray(given, dtype=np.float64)
