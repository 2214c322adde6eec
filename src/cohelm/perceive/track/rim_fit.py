"""Fits a disc to the part of its rim that is in view.

The mean of that part stays at the edge of the view while the disc goes on; the disc that the part
is the rim of goes with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import Floats

_STEPS = 6  # of Gauss and Newton; fewer where nothing changes any more
_LITTLE = 1e-4  # [m]
_ALIKE = 8.0  # beams that err alike: more of them say no more
_OFF = 0.08  # a rim that lies farther off what is seen is none (rms) [m]


class Fit(NamedTuple):
    """A disc."""

    x: float
    y: float
    radius: float
    variance: float
    """Of its place, in the direction in which it is least sure [m^2]."""
    radius_variance: float
    """[m^2]"""
    good: bool
    """Whether what is seen is its rim."""


@jit
def rim_distance(points: Floats, x: float, y: float, radius: float) -> float:
    """How far points are from the rim of a disc, rms [m]."""
    total = 0.0
    for i in range(len(points)):
        off = math.hypot(points[i, 0] - x, points[i, 1] - y) - radius
        total += off * off
    return math.sqrt(total / max(len(points), 1))


@jit
def rim_fit(
    points: Floats, x: float, y: float, radius: float, place: float, size: float, noise: float
) -> Fit:
    """The likeliest disc whose rim the points (n, 2) are on, least squares, expected at (x, y).

    place, size: variances of where it was expected, along either axis, and of its radius [m^2].
    noise: variance of the points' distance from the rim [m^2].
    """
    n = len(points)
    weight = 1.0 / (noise * max(1.0, n / _ALIKE))
    fx, fy, fr = x, y, radius
    a = b = c = d = e = f = left = 0.0
    for _ in range(_STEPS):
        # normal equations of what is asked for, (a b d; b c e; d e f), and their right-hand side
        a, b, c, d, e, f = 1.0 / place, 0.0, 1.0 / place, 0.0, 0.0, 1.0 / size
        gx, gy, gr = (x - fx) / place, (y - fy) / place, (radius - fr) / size
        for i in range(n):
            dx, dy = points[i, 0] - fx, points[i, 1] - fy
            far = max(math.hypot(dx, dy), 1e-6)
            ux, uy, off = dx / far, dy / far, far - fr
            a += weight * ux * ux
            b += weight * ux * uy
            c += weight * uy * uy
            d += weight * ux
            e += weight * uy
            f += weight
            gx += weight * ux * off
            gy += weight * uy * off
            gr += weight * off
        det = a * c - b * b
        left = f - (c * d * d - 2.0 * b * d * e + a * e * e) / det  # the place is done with
        a, b, c = a - d * d / f, b - d * e / f, c - e * e / f  # the radius is done with
        gx, gy = gx - d * gr / f, gy - e * gr / f
        det = a * c - b * b
        mx, my = (c * gx - b * gy) / det, (a * gy - b * gx) / det
        mr = (gr - d * mx - e * my) / f
        fx, fy, fr = fx + mx, fy + my, fr + mr
        if abs(mx) + abs(my) + abs(mr) < _LITTLE:
            break
    least = 0.5 * (a + c) - math.sqrt(0.25 * (a - c) * (a - c) + b * b)  # eigenvalue
    good = fr > 0.0 and rim_distance(points, fx, fy, fr) < _OFF
    return Fit(fx, fy, fr, 1.0 / max(least, 1e-9), 1.0 / max(left, 1e-9), good)
