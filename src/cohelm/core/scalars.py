"""Angle wrapping and the test for finite numbers, compiled."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit_inline


@jit_inline
def wrap(angle: float) -> float:
    """The same angle in (-pi, pi] [rad]."""
    if -math.pi < angle <= math.pi:
        return angle  # most of the time, and spares the division
    turns = float(np.ceil((angle - math.pi) / (2.0 * math.pi)))  # math.ceil makes an integer
    inside = angle - 2.0 * math.pi * turns
    if inside <= -math.pi or inside > math.pi:  # by the last digit
        return math.pi
    return inside


@jit_inline
def is_finite(x: float) -> bool:
    """Whether x is finite."""
    return -math.inf < x < math.inf
