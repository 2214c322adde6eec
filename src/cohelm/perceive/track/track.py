"""What is known of one tracked thing, and its Kalman filter.

A thing that is not known to move keeps its velocity. Of a mover the acceleration is estimated too,
that fades with a time constant (Singer, Estimating optimal tracking filter performance for manned
maneuvering targets, 1970): a filter without it lags a walker who stops or sets off by some 0.4 s.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats

TX, TY, TVX, TVY, TAX, TAY, PP, PV, VV, PA, VA, AA = range(12)
RADIUS, RR, SEEN, MISSED, PROOF, MOVES, SINCE, GONE, CALM, WHERE = range(12, 22)
ENDS = 8
COLUMNS = WHERE + 2 * ENDS
"""Columns of tracks: position, velocity and acceleration, their covariances (the same along both
axes: of position, of it with velocity, of velocity, of position and velocity with acceleration, of
acceleration), radius, its variance, scans it was seen in, time since [s], proof that it moves,
whether it counts as moving, how long ago WHERE is from [s], scans in which its place was free, how
long nothing proved that it moves [s]; from WHERE on x and y of eight places in which beams ended
on it a while ago [m].
"""

FADES = 0.8
"""A change of velocity fades so fast [s]: about the time of a step and a half of a walker."""

NEW = 1.0
"""Variance of the velocity of somebody of whom nothing else is known, along an axis [m^2/s^2]."""
_ANYWHERE = 0.3  # so far off may be who did what nobody is taken to be capable of [m]
_CHANGES = 0.003  # by which a radius may change in a second, 1 cm in ten: an arm, a coat [m]


@jit
def predicted(one: Floats, dt: float, max_acceleration: float) -> None:
    """Foretell a track by dt [s], in place."""
    for axis in range(2):
        one[TX + axis] += dt * one[TVX + axis] + 0.5 * dt * dt * one[TAX + axis]
        one[TVX + axis] += dt * one[TAX + axis]
    one[RR] += _CHANGES * _CHANGES * dt
    q = max_acceleration * max_acceleration
    if one[MOVES] == 0.0:
        one[PP] += 2.0 * dt * one[PV] + dt * dt * one[VV] + 0.25 * q * dt**4 + 1e-5
        one[PV] += dt * one[VV] + 0.5 * q * dt**3
        one[VV] += q * dt * dt
        return
    fades, half = math.exp(-dt / FADES), 0.5 * dt * dt
    q = _variance(max_acceleration) * (1.0 - fades * fades) / max(dt, 1e-6)
    pp, pv, vv, pa, va, aa = one[PP], one[PV], one[VV], one[PA], one[VA], one[AA]
    one[PP] = pp + 2.0 * dt * pv + dt * dt * vv + 2.0 * half * (pa + dt * va) + half * half * aa
    one[PV] = pv + dt * (vv + pa) + half * va + dt * dt * va + half * dt * aa
    one[VV] = vv + 2.0 * dt * va + dt * dt * aa
    one[PA] = fades * (pa + dt * va + half * aa)
    one[VA] = fades * (va + dt * aa)
    one[AA] = fades * fades * aa
    one[PP] += q * dt**5 / 20.0 + 1e-5
    one[PV] += q * dt**4 / 8.0
    one[VV] += q * dt**3 / 3.0
    one[PA] += q * dt**3 / 6.0
    one[VA] += q * dt * dt / 2.0
    one[AA] += q * dt
    one[TAX] *= fades
    one[TAY] *= fades


@jit
def corrected(one: Floats, dx: float, dy: float, variance: float, most: float) -> None:
    """Move the estimated position of a track by (dx, dy) [m], and all else accordingly, in place.

    variance: of its position afterwards [m^2], at most what it was. most: largest acceleration
    that is believed [m/s^2].
    """
    share = min(max(1.0 - variance / one[PP], 0.0), 1.0)
    with_v, with_a = one[PV] / one[PP], one[PA] / one[PP]
    one[TX] += dx
    one[TY] += dy
    one[TVX] += with_v * dx
    one[TVY] += with_v * dy
    one[TAX] += with_a * dx
    one[TAY] += with_a * dy
    push = math.hypot(one[TAX], one[TAY])
    if push > most:
        one[TAX] *= most / push
        one[TAY] *= most / push
    one[VV] -= share * with_v * one[PV]
    one[VA] -= share * with_v * one[PA]
    one[AA] -= share * with_a * one[PA]
    one[PP] *= 1.0 - share
    one[PV] *= 1.0 - share
    one[PA] *= 1.0 - share


@jit
def reinitialized(one: Floats) -> None:
    """It is not where it was foretold, and how it moves is as little known as of who is new."""
    one[PP] = max(one[PP], _ANYWHERE * _ANYWHERE)
    one[TVX] = one[TVY] = one[TAX] = one[TAY] = 0.0
    one[PV] = one[PA] = one[VA] = 0.0
    one[VV] = NEW


@jit
def set_moving(one: Floats, max_acceleration: float) -> None:
    """It is known to move: from now on it may accelerate."""
    one[MOVES], one[CALM] = 1.0, 0.0
    if one[AA] == 0.0:
        one[AA] = _variance(max_acceleration)


@jit
def _variance(most: float) -> float:
    """Of an acceleration that may be anything up to `most` along an axis [m^2/s^4]."""
    return most * most / 3.0


@jit
def set_resting(one: Floats) -> None:
    """It no longer counts as moving."""
    one[MOVES] = 0.0
    one[TAX] = one[TAY] = one[PA] = one[VA] = one[AA] = 0.0


@jit
def noted_ends(one: Floats, seen: Floats) -> None:
    """Note where it is seen to be, by the points of its cluster (n, 2)."""
    for i in range(ENDS):
        p = (2 * i + 1) * len(seen) // (2 * ENDS)
        one[WHERE + 2 * i], one[WHERE + 2 * i + 1] = seen[p, 0], seen[p, 1]
    one[SINCE] = 0.0


def no_tracks() -> Floats:
    """(0, COLUMNS)."""
    return np.empty((0, COLUMNS))
