"""Cosine and sine of a heading, vectorizable and identical on every machine.

Those of the C library can not be vectorized, and differ in the last digit between machines. These
are sums and products only, which a compiler vectorizes, and which IEEE arithmetic makes the same
everywhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_inline


class Facing(NamedTuple):
    """Cosine and sine of a heading."""

    cos: float
    sin: float


NEAR = 524288.0
"""Up to this angle [rad], 2^19, `facing_near` is exact to the last digit or the one before."""

_ROUND = 1.5 * 2.0**52  # adding and subtracting it rounds to an integer
_PER_QUARTER = 2.0 / math.pi
# pi/2 in pieces of 33 bits, so that the product with a whole number below 2^19 is exact.
_QUARTER = 1.57079632673412561417
_QUARTER_2 = 6.07710050630396597660e-11
_QUARTER_3 = 2.02226624879595063154e-21
# Coefficients of the sine's and the cosine's polynomials on [-pi/4, pi/4], lowest power first.
_S = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_C = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip


@jit_inline
def facing(psi: float) -> Facing:
    """cos psi and sin psi for any angle [rad]; NaN for one that is not finite."""
    if abs(psi) <= NEAR:
        return facing_near(psi)
    return Facing(math.cos(psi), math.sin(psi))


@jit_inline
def facing_near(psi: float) -> Facing:
    """The same for |psi| <= NEAR, without a branch.

    psi = n pi/2 + (r + tail), |r| <= pi/4, then two polynomials, whose coefficients and
    order are those of Sun's fdlibm (k_sin.c, k_cos.c), and the quadrant n.
    """
    n = (psi * _PER_QUARTER + _ROUND) - _ROUND
    first = psi - n * _QUARTER
    taken = n * _QUARTER_2
    rest = first - taken
    taken = n * _QUARTER_3 - ((first - rest) - taken)
    r = rest - taken
    tail = (rest - r) - taken
    z = r * r
    w, v = z * z, z * r
    low = _S[1] + z * (_S[2] + z * _S[3])
    sine = r - ((z * (0.5 * tail - v * (low + z * w * (_S[4] + z * _S[5]))) - tail) - v * _S[0])
    low = z * (_C[0] + z * (_C[1] + z * _C[2]))
    high = w * w * (_C[3] + z * (_C[4] + z * _C[5]))
    half = 0.5 * z
    one = 1.0 - half
    cosine = one + (((1.0 - one) - half) + (z * (low + high) - r * tail))
    quadrant = n - 4.0 * ((0.25 * n + _ROUND) - _ROUND)  # -2 ... 2
    across = abs(quadrant) == 1.0
    c, s = (sine, cosine) if across else (cosine, sine)
    c = -c if quadrant == 1.0 or abs(quadrant) == 2.0 else c
    s = -s if quadrant == -1.0 or abs(quadrant) == 2.0 else s
    return Facing(c, s)
