"""The tracking law (14)-(17)."""

from __future__ import annotations

import math

from cohelm.core.facing import facing
from cohelm.core.jit import jit_inline
from cohelm.core.scalars import wrap
from cohelm.core.types import Desired, Pose, Twist
from cohelm.law.gains import Gains


@jit_inline
def track(pose: Pose, desired: Desired, gains: Gains) -> Twist:
    """Speed and yaw rate that drive the pose error to zero.

    (14) x_b =  x~ cos psi + y~ sin psi,  y_b = -x~ sin psi + y~ cos psi
    (16) v     = u_d cos(psi~) + k_x x_b
    (17) omega = r_d + k_psi sin(psi~) + y_b u_d

    Errors are in the body frame [m, rad]; gains k_x, k_psi [1/s] > 0.
    """
    at, to = facing(pose.psi), facing(desired.psi)
    c, s = at.cos, at.sin
    dx, dy = desired.x - pose.x, desired.y - pose.y
    x_b = dx * c + dy * s
    y_b = -dx * s + dy * c
    # cosine and sine of psi~ = psi_d - psi, which needs no wrapping
    cos_e, sin_e = to.cos * c + to.sin * s, to.sin * c - to.cos * s
    v = desired.u * cos_e + gains.k_x * x_b
    omega = desired.r + gains.k_psi * sin_e + y_b * desired.u
    return Twist(v, omega)


@jit_inline
def pose_error(pose: Pose, desired: Desired) -> float:
    """E_P, the norm of the pose error (51), heading difference wrapped (E9) [m and rad]."""
    dx, dy = desired.x - pose.x, desired.y - pose.y
    e_psi = wrap(desired.psi - pose.psi)
    return math.sqrt(dx * dx + dy * dy + e_psi * e_psi)
