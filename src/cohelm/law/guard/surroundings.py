"""Obstacles as the guard takes them: checked arrays, which stand, and how far others may get."""

from __future__ import annotations

from numpy.typing import ArrayLike

from cohelm.core.jit import jit_inline
from cohelm.core.obstacles import Surroundings, per_disc, rows
from cohelm.core.types import VX, VY


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
    d = rows("discs", discs, 6)
    return Surroundings(
        d, per_disc("max_acceleration", max_acceleration, len(d), 0.0),
        per_disc("velocity_error", velocity_error, len(d), 0.0),
        rows("segments", segments, 4), rows("points", points, 2),
    )  # fmt: skip
