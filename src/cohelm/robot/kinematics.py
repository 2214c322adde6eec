"""Motion of a differential drive under a held command, exactly."""

from __future__ import annotations

import math

from cohelm.core.jit import jit_inline
from cohelm.core.types import Pose, Twist


@jit_inline
def arc(pose: Pose, twist: Twist, dt: float) -> Pose:
    """The pose after holding `twist` for `dt`: the exact solution of (6), a circular arc.

    With a = omega dt / 2 the chord is v dt sin(a)/a long and points along psi + a; sin(a)/a is
    a series below 1e-4, so there is no division by a vanishing yaw rate. The heading is not
    wrapped.
    """
    a = 0.5 * twist.omega * dt
    chord = twist.v * dt * (math.sin(a) / a if abs(a) > 1e-4 else 1.0 - a * a / 6.0)
    return Pose(
        pose.x + chord * math.cos(pose.psi + a),
        pose.y + chord * math.sin(pose.psi + a),
        pose.psi + twist.omega * dt,
    )
