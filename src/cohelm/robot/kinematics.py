"""Motion of a differential drive under a held command, exactly."""

from __future__ import annotations

import math

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
        sinc = math.sin(a) / a
        cos_a = math.cos(a)
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    chord = twist.v * dt * sinc
    sin_a = a * sinc
    return Pose(
        pose.x + chord * (c * cos_a - s * sin_a),
        pose.y + chord * (s * cos_a + c * sin_a),
        pose.psi + twist.omega * dt,
    )
