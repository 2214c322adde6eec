"""Motion of a differential drive under a held command, exactly."""

from __future__ import annotations

import math

from cohelm.core.facing import facing
from cohelm.core.jit import jit_inline
from cohelm.core.types import Pose, Twist


@jit_inline
def arc(pose: Pose, twist: Twist, dt: float) -> Pose:
    """The pose after holding `twist` for `dt`: the exact solution of (6), a circular arc.

    With a = omega dt / 2 the chord is v dt sin(a)/a long and points along psi + a. Up to
    |a| = 0.1 both come from series that are exact in double precision: no division by a
    vanishing yaw rate, and no second pair of trigonometric calls in a simulator's inner loop.
    The heading is not wrapped.
    """
    a = 0.5 * twist.omega * dt
    q = a * a
    if q < 0.01:
        sinc = 1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880))))
        cos_a = 1.0 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320))))
    else:
        sinc, cos_a = math.sin(a) / a, math.cos(a)
    chord, sin_a = twist.v * dt * sinc, a * sinc
    at = facing(pose.psi)
    return Pose(
        pose.x + chord * (at.cos * cos_a - at.sin * sin_a),
        pose.y + chord * (at.sin * cos_a + at.cos * sin_a),
        pose.psi + twist.omega * dt,
    )
