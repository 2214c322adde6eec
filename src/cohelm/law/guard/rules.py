"""Parameters of the guard, and a check of them."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.errors import CohelmError


class Rules(NamedTuple):
    """Parameters of the guard."""

    dt: float = 0.02
    """Time between two commands [s]."""
    soft_margin: float = 0.03
    """Clearance that the nominal command is shaped to keep [m]."""
    hard_margin: float = 0.015
    """Clearance that the certificate keeps at its checks, and half of it in between; greater than
    0, at most soft_margin, larger than the sensing error that is not in the obstacles' radii
    [m]."""
    deceleration_fraction: float = 0.7
    """Share of the full deceleration that shaping counts on, in (0, 1]."""
    steer_weight: float = 0.5
    """Weight of steering against speed in the least change [m]: large keeps the operator's
    steering and slows down, small the reverse."""


def checked_rules(rules: Rules) -> Rules:
    """The same rules, as floats. Raises CohelmError for a value out of range."""
    try:
        made = Rules._make(float(value) for value in rules)
    except (TypeError, ValueError, OverflowError) as error:
        raise CohelmError(f"the rules must be {len(Rules._fields)} numbers: {error}") from error
    for name in ("dt", "hard_margin", "steer_weight"):
        value = getattr(made, name)
        if not 0.0 < value < math.inf:  # nor for NaN
            raise CohelmError(f"{name} must be greater than 0 and finite, got {value:g}")
    if not math.isfinite(made.soft_margin):
        raise CohelmError(f"soft_margin must be a length in metres, got {made.soft_margin:g}")
    if not 0.0 < made.deceleration_fraction <= 1.0:
        raise CohelmError(
            "deceleration_fraction must be a share of the deceleration in (0, 1], got "
            f"{made.deceleration_fraction:g}"
        )
    return made
