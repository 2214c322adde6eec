"""The paper's relaxed time-varying control barrier function (19)-(33)."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.facing import facing
from cohelm.core.jit import jit_inline
from cohelm.core.scalars import is_finite
from cohelm.core.types import SAFE, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.gains import Gains
from cohelm.law.verdict import INVALID, POWERLESS, SHAPED, UNTOUCHED

HEADING = -1
"""`limiting` where the cos^2 psi of (22), not an obstacle, has the largest part in I (E6)."""

_H_MIN = 1e-9  # |h| is kept above this [m^2], so that 1/h^2 stays finite on the boundary
_POWERLESS_BELOW = 1e-12  # of ||L_gB||^2


class Avoidance(NamedTuple):
    """The collision-avoidance input u of (33) and how it came about."""

    input: Twist
    """u [m/s, rad/s], to be added to the nominal command (49)."""
    I: float
    """Growth of B under the nominal command (31)."""
    J: float
    """Tolerated growth, K B + C (32)."""
    h: float
    """Smallest h_i, the denominator of the barrier [m^2]; infinite without obstacles."""
    verdict: int
    """UNTOUCHED: I <= J. SHAPED: the input is added. POWERLESS: I > J but ||L_gB|| vanishes, no
    input can change B along its gradient (E5); only the steering term acts. INVALID: an argument
    is not finite, nor is the input; the command is a stop."""
    limiting: int
    """Row of the obstacle with the largest part in I, or HEADING; -1 while untouched."""


@jit_inline
def _h(dx: float, dy: float, safe: float) -> float:
    """h_i = ||p - o_i||^2 - r_i^2 [m^2], kept off zero."""
    h = dx * dx + dy * dy - safe * safe
    return _H_MIN if abs(h) < _H_MIN else h


@jit_inline
def barrier(pose: Pose, nominal: Twist, discs: Floats, gains: Gains) -> Avoidance:
    """The least input along L_gB that keeps B from growing faster than K B + C.

    (22) B = sum 1/h_i + cos^2 psi
    (26) L_gB = [sum -2 ((x - x_i) cos psi + (y - y_i) sin psi) / h_i^2, -sin 2 psi]
    (27) sum (dB/do_i) do_i/dt = +2 sum ((x - x_i) x'_i + (y - y_i) y'_i) / h_i^2   (E2: the
         paper prints -2, which takes an approaching obstacle for a receding one)
    (31) I = L_gB tau + (27),  (32) J = K B + C
    (33) u = 0 if I <= J, else -(I - J) / ||L_gB||^2 L_gB^T - [0, k_cbf tanh(1/h)]

    pose: world frame; nominal: body frame. discs: (n, 6), any n, read at columns X ... SAFE.
    The input is not bounded (E5) and h counts from the robot's centre (E7).
    """
    at = facing(pose.psi)
    sign = 1.0 if gains.true_sign else -1.0
    B, along, motion, smallest = at.cos * at.cos, 0.0, 0.0, math.inf
    for i in range(discs.shape[0]):
        dx, dy = pose.x - discs[i, X], pose.y - discs[i, Y]
        h = _h(dx, dy, discs[i, SAFE])
        inverse = 1.0 / h
        slope = 2.0 * inverse * inverse
        B += inverse
        along -= slope * (dx * at.cos + dy * at.sin)
        motion += slope * (dx * discs[i, VX] + dy * discs[i, VY])
        smallest = min(smallest, h)
    across = -2.0 * at.sin * at.cos
    I = along * nominal.v + across * nominal.omega + sign * motion
    J = gains.K * B + gains.C
    if not (is_finite(I) and is_finite(J) and smallest > -math.inf):
        return Avoidance(Twist(math.nan, math.nan), I, J, smallest, INVALID, -1)
    if I <= J:
        return Avoidance(Twist(0.0, 0.0), I, J, smallest, UNTOUCHED, -1)
    limiting = HEADING
    most = across * nominal.omega
    for i in range(discs.shape[0]):
        dx, dy = pose.x - discs[i, X], pose.y - discs[i, Y]
        h = _h(dx, dy, discs[i, SAFE])
        moved = sign * (dx * discs[i, VX] + dy * discs[i, VY])
        part = 2.0 / (h * h) * (moved - (dx * at.cos + dy * at.sin) * nominal.v)
        if part > most:
            most, limiting = part, i
    steer = gains.k_cbf * math.tanh(1.0 / smallest)
    square = along * along + across * across
    if square < _POWERLESS_BELOW:
        return Avoidance(Twist(0.0, -steer), I, J, smallest, POWERLESS, limiting)
    gain = (I - J) / square
    return Avoidance(Twist(-gain * along, -gain * across - steer), I, J, smallest, SHAPED, limiting)
