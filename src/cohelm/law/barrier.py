"""The paper's relaxed time-varying control barrier function (19)-(33)."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.facing import Facing, facing
from cohelm.core.jit import jit_inline
from cohelm.core.types import SAFE, VX, VY, Floats, Pose, Twist, X, Y, is_finite
from cohelm.law.gains import Gains
from cohelm.law.verdict import INVALID, POWERLESS, SHAPED, UNTOUCHED

HEADING = -1
"""`culprit` when no obstacle, but the cos^2 psi of (22), asked most of the filter (E6)."""

_H_MIN = 1e-9  # |h| is kept above this [m^2], so that 1/h^2 stays finite on the boundary
_POWERLESS_BELOW = 1e-12  # of ||L_gB||^2


class Avoidance(NamedTuple):
    """The collision-avoidance input u of (33) and how it came about."""

    input: Twist
    """u [m/s, rad/s], to be added to the wish (49)."""
    I: float
    """Growth of B under the wish (31)."""
    J: float
    """Growth that is tolerated, K B + C (32)."""
    h: float
    """Smallest h_i, the denominator of the barrier [m^2]; infinite without obstacles."""
    verdict: int
    """UNTOUCHED: I <= J. SHAPED: the input is added. POWERLESS: I > J but ||L_gB|| vanishes, no
    input can change B along its gradient (E5); only the steering term acts. INVALID: a number
    that is not finite came in, and the input is not one either; the command is a stop."""
    culprit: int
    """Row of the obstacle that asked most of the filter, or HEADING; -1 while untouched."""


@jit_inline
def _h(dx: float, dy: float, safe: float) -> float:
    """h_i = ||p - o_i||^2 - r_i^2 [m^2], kept off zero."""
    h = dx * dx + dy * dy - safe * safe
    return _H_MIN if abs(h) < _H_MIN else h


@jit_inline
def part_of_growth(
    at: Facing, v: float, sign: float, dx: float, dy: float, vx: float, vy: float, safe: float
) -> float:
    """One obstacle's part of I: d(1/h_i)/dt under the wish and the obstacle's motion."""
    h = _h(dx, dy, safe)
    return 2.0 / (h * h) * (sign * (dx * vx + dy * vy) - (dx * at.cos + dy * at.sin) * v)


class Sums(NamedTuple):
    """What the obstacles add up to."""

    B: float
    """(22)."""
    along: float
    """First entry of L_gB (26)."""
    motion: float
    """(27), with the derivative's own sign."""
    smallest: float
    """Smallest h_i [m^2]."""


@jit_inline
def none_yet(at: Facing) -> Sums:
    """No obstacle: only cos^2 psi."""
    return Sums(at.cos * at.cos, 0.0, 0.0, math.inf)


@jit_inline
def with_disc(
    sums: Sums, at: Facing, dx: float, dy: float, vx: float, vy: float, safe: float
) -> Sums:
    """One obstacle more: (dx, dy) from it to the robot [m], its velocity and r_i. No branches."""
    h = _h(dx, dy, safe)
    inverse = 1.0 / h
    slope = 2.0 * inverse * inverse
    return Sums(
        sums.B + inverse,
        sums.along - slope * (dx * at.cos + dy * at.sin),
        sums.motion + slope * (dx * vx + dy * vy),
        min(sums.smallest, h),
    )


@jit_inline
def growth(
    sums: Sums, at: Facing, wish: Twist, sign: float, K: float, C: float
) -> tuple[float, float]:
    """I (31) and J (32); sign: of the moving-obstacle term (E2)."""
    asked = sums.along * wish.v + turning(at) * wish.omega
    return asked + sign * sums.motion, K * sums.B + C


@jit_inline
def passes(I: float, J: float, smallest: float) -> bool:
    """Whether the wish passes untouched: all are numbers, and I <= J."""
    return (I <= J) & _sound(I, J, smallest)


@jit_inline
def shapes(I: float, J: float, smallest: float, square: float) -> bool:
    """Whether the filter can and must act. square: ||L_gB||^2."""
    return (I > J) & _sound(I, J, smallest) & (square >= _POWERLESS_BELOW)


@jit_inline
def _sound(I: float, J: float, smallest: float) -> bool:
    return is_finite(I) & is_finite(J) & (smallest > -math.inf)


@jit_inline
def turning(at: Facing) -> float:
    """Second entry of L_gB (26)."""
    return -2.0 * at.sin * at.cos


@jit_inline
def steering(k_cbf: float, smallest: float) -> float:
    """What (33) adds to the right [rad/s]."""
    return k_cbf * math.tanh(1.0 / smallest)


@jit_inline
def added(I: float, J: float, along: float, across: float, steer: float) -> Twist:
    """u of (33), from L_gB = (along, across) and `steering`."""
    gain = (I - J) / (along * along + across * across)
    return Twist(-gain * along, -gain * across - steer)


@jit_inline
def barrier(pose: Pose, wish: Twist, discs: Floats, gains: Gains) -> Avoidance:
    """The least input along L_gB that keeps B from growing faster than K B + C.

    (22) B = sum 1/h_i + cos^2 psi
    (26) L_gB = [sum -2 ((x - x_i) cos psi + (y - y_i) sin psi) / h_i^2, -sin 2 psi]
    (27) sum (dB/do_i) do_i/dt = +2 sum ((x - x_i) x'_i + (y - y_i) y'_i) / h_i^2   (E2: the
         paper prints -2, which takes an approaching obstacle for a receding one)
    (31) I = L_gB tau + (27),  (32) J = K B + C
    (33) u = 0 if I <= J, else -(I - J) / ||L_gB||^2 L_gB^T - [0, k_cbf tanh(1/h)]

    pose, wish: world frame and body frame. discs: (n, 6), any n, read at columns X ... SAFE.
    The input is not bounded (E5) and h counts from the robot's centre (E7).
    """
    at = facing(pose.psi)
    sign = 1.0 if gains.true_sign else -1.0
    sums = none_yet(at)
    for i in range(discs.shape[0]):
        sums = with_disc(
            sums, at, pose.x - discs[i, X], pose.y - discs[i, Y],
            discs[i, VX], discs[i, VY], discs[i, SAFE],
        )  # fmt: skip
    along, across, smallest = sums.along, turning(at), sums.smallest
    I, J = growth(sums, at, wish, sign, gains.K, gains.C)
    if passes(I, J, smallest):
        return Avoidance(Twist(0.0, 0.0), I, J, smallest, UNTOUCHED, -1)
    if not _sound(I, J, smallest):
        return Avoidance(Twist(math.nan, math.nan), I, J, smallest, INVALID, -1)
    culprit = HEADING
    most = across * wish.omega
    for i in range(discs.shape[0]):
        part = part_of_growth(
            at, wish.v, sign, pose.x - discs[i, X], pose.y - discs[i, Y],
            discs[i, VX], discs[i, VY], discs[i, SAFE],
        )  # fmt: skip
        if part > most:
            most, culprit = part, i
    steer = steering(gains.k_cbf, smallest)
    if not shapes(I, J, smallest, along * along + across * across):
        return Avoidance(Twist(0.0, -steer), I, J, smallest, POWERLESS, culprit)
    return Avoidance(added(I, J, along, across, steer), I, J, smallest, SHAPED, culprit)
