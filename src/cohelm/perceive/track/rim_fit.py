"""Fits a disc to the visible part of its rim.

The mean of that part stays at the edge of the view while the disc moves on; the fitted disc moves
with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import Floats

_ITERATIONS = 6  # of Gauss-Newton, at most
_CONVERGED = 1e-4  # [m]
_CORRELATED = 8.0  # beams with correlated errors: more carry no more information
_MAX_RMS = 0.08  # of the points from the rim; beyond this it is not a disc [m]


class Fit(NamedTuple):
    """A disc."""

    x: float
    y: float
    radius: float
    variance: float
    """Of its position, in the least certain direction [m^2]."""
    radius_variance: float
    """[m^2]"""
    good: bool
    """Whether the points fit its rim."""


@jit
def rim_distance(points: Floats, x: float, y: float, radius: float) -> float:
    """Rms distance of points from the rim of a disc [m]."""
    total = 0.0
    for i in range(len(points)):
        residual = math.hypot(points[i, 0] - x, points[i, 1] - y) - radius
        total += residual * residual
    return math.sqrt(total / max(len(points), 1))


@jit
def rim_fit(
    points: Floats, x: float, y: float, radius: float, position_variance: float,
    prior_radius_variance: float, noise: float,
) -> Fit:  # fmt: skip
    """Maximum a posteriori disc whose rim the points (n, 2) are on, by least squares.

    x, y, radius: of the prior [m]; position_variance: of its position, along either axis [m^2].
    noise: variance of the points' distance from the rim [m^2].
    """
    n = len(points)
    weight = 1.0 / (noise * max(1.0, n / _CORRELATED))
    fx, fy, fr = x, y, radius
    a = b = c = d = e = f = radius_information = 0.0
    for _ in range(_ITERATIONS):
        # normal equations (a b d; b c e; d e f) and their right-hand side
        a = c = 1.0 / position_variance
        f = 1.0 / prior_radius_variance
        b = d = e = 0.0
        gx, gy = (x - fx) / position_variance, (y - fy) / position_variance
        gr = (radius - fr) / prior_radius_variance
        for i in range(n):
            dx, dy = points[i, 0] - fx, points[i, 1] - fy
            far = max(math.hypot(dx, dy), 1e-6)
            ux, uy, residual = dx / far, dy / far, far - fr
            a += weight * ux * ux
            b += weight * ux * uy
            c += weight * uy * uy
            d += weight * ux
            e += weight * uy
            f += weight
            gx += weight * ux * residual
            gy += weight * uy * residual
            gr += weight * residual
        det = a * c - b * b
        # position eliminated
        radius_information = f - (c * d * d - 2.0 * b * d * e + a * e * e) / det
        a, b, c = a - d * d / f, b - d * e / f, c - e * e / f  # radius eliminated
        gx, gy = gx - d * gr / f, gy - e * gr / f
        det = a * c - b * b
        mx, my = (c * gx - b * gy) / det, (a * gy - b * gx) / det
        mr = (gr - d * mx - e * my) / f
        fx, fy, fr = fx + mx, fy + my, fr + mr
        if abs(mx) + abs(my) + abs(mr) < _CONVERGED:
            break
    smallest = 0.5 * (a + c) - math.sqrt(0.25 * (a - c) * (a - c) + b * b)  # eigenvalue
    good = fr > 0.0 and rim_distance(points, fx, fy, fr) < _MAX_RMS
    return Fit(fx, fy, fr, 1.0 / max(smallest, 1e-9), 1.0 / max(radius_information, 1e-9), good)
