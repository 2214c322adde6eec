"""State of one track, and its Kalman filter.

A track that is not known to move has a constant-velocity model. Of a mover the acceleration is
estimated too, which decays with a time constant (Singer, Estimating optimal tracking filter
performance for manned maneuvering targets, 1970): without it, the filter lags a walker that stops
or sets off by some 0.4 s.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats

TX, TY, TVX, TVY, TAX, TAY, PP, PV, VV, PA, VA, AA = range(12)
RADIUS, RR, SEEN, MISSED, PROOF, MOVES, ENDS_AGE, SEEN_EMPTY, AT_REST, ENDS_AT = range(12, 22)
N_ENDS = 8
COLUMNS = ENDS_AT + 2 * N_ENDS
"""Columns of tracks: position, velocity and acceleration, their covariances (the same along both
axes: of position, of it with velocity, of velocity, of position and velocity with acceleration, of
acceleration), radius, its variance, number of scans it was seen in, time since then [s], proof that
it moves, whether it counts as moving, age of the ends [s], number of scans in which its place was
seen empty, time without proof of motion [s]; from ENDS_AT on x and y of eight places in which beams
ended on it a while ago [m].
"""

ACCELERATION_DECAY = 0.8
"""Time constant of accelerations [s]: about a step and a half of a walker."""

INITIAL_VARIANCE = 1.0
"""Prior variance of a new track's velocity, along an axis [m^2/s^2]."""
RADIUS_KNOWN = 0.05
"""Standard deviation below which a radius counts as known [m]."""
_REINITIALIZED = 0.3  # position sigma after a manoeuvre beyond max_acceleration [m]
_RADIUS_DRIFT = 0.003  # process noise of the radius [m/sqrt(s)]: an arm, a coat


@jit_inline
def radius_known(track: Floats) -> bool:
    """Whether its radius is known: its rim has been observed while it moved."""
    return track[RR] < RADIUS_KNOWN * RADIUS_KNOWN


@jit
def predict(track: Floats, dt: float, max_acceleration: float) -> None:
    """Predict a track by dt [s], in place."""
    for axis in range(2):
        track[TX + axis] += dt * track[TVX + axis] + 0.5 * dt * dt * track[TAX + axis]
        track[TVX + axis] += dt * track[TAX + axis]
    track[RR] += _RADIUS_DRIFT * _RADIUS_DRIFT * dt
    q = max_acceleration * max_acceleration
    if track[MOVES] == 0.0:
        track[PP] += 2.0 * dt * track[PV] + dt * dt * track[VV] + 0.25 * q * dt**4 + 1e-5
        track[PV] += dt * track[VV] + 0.5 * q * dt**3
        track[VV] += q * dt * dt
        return
    decay, half = math.exp(-dt / ACCELERATION_DECAY), 0.5 * dt * dt
    q = _variance(max_acceleration) * (1.0 - decay * decay) / max(dt, 1e-6)
    pp, pv, vv, pa, va, aa = track[PP], track[PV], track[VV], track[PA], track[VA], track[AA]
    track[PP] = pp + 2.0 * dt * pv + dt * dt * vv + 2.0 * half * (pa + dt * va) + half * half * aa
    track[PV] = pv + dt * (vv + pa) + half * va + dt * dt * va + half * dt * aa
    track[VV] = vv + 2.0 * dt * va + dt * dt * aa
    track[PA] = decay * (pa + dt * va + half * aa)
    track[VA] = decay * (va + dt * aa)
    track[AA] = decay * decay * aa
    track[PP] += q * dt**5 / 20.0 + 1e-5
    track[PV] += q * dt**4 / 8.0
    track[VV] += q * dt**3 / 3.0
    track[PA] += q * dt**3 / 6.0
    track[VA] += q * dt * dt / 2.0
    track[AA] += q * dt
    track[TAX] *= decay
    track[TAY] *= decay


@jit
def correct(track: Floats, dx: float, dy: float, variance: float, max_acceleration: float) -> None:
    """Correct the position of a track by (dx, dy) [m], and its other states accordingly, in place.

    variance: of its position afterwards [m^2], at most what it was. max_acceleration: the estimate
    is clipped to it [m/s^2].
    """
    share = min(max(1.0 - variance / track[PP], 0.0), 1.0)
    with_v, with_a = track[PV] / track[PP], track[PA] / track[PP]
    track[TX] += dx
    track[TY] += dy
    track[TVX] += with_v * dx
    track[TVY] += with_v * dy
    track[TAX] += with_a * dx
    track[TAY] += with_a * dy
    magnitude = math.hypot(track[TAX], track[TAY])
    if magnitude > max_acceleration:
        track[TAX] *= max_acceleration / magnitude
        track[TAY] *= max_acceleration / magnitude
    track[VV] -= share * with_v * track[PV]
    track[VA] -= share * with_v * track[PA]
    track[AA] -= share * with_a * track[PA]
    track[PP] *= 1.0 - share
    track[PV] *= 1.0 - share
    track[PA] *= 1.0 - share


@jit
def reinitialize(track: Floats) -> None:
    """Reset the motion of a track that is inconsistent with its prediction, as of a new one."""
    track[PP] = max(track[PP], _REINITIALIZED * _REINITIALIZED)
    track[TVX] = track[TVY] = track[TAX] = track[TAY] = 0.0
    track[PV] = track[PA] = track[VA] = 0.0
    track[VV] = INITIAL_VARIANCE


@jit
def set_moving(track: Floats, max_acceleration: float) -> None:
    """The track counts as moving: its acceleration is estimated from now on."""
    track[MOVES], track[AT_REST] = 1.0, 0.0
    if track[AA] == 0.0:
        track[AA] = _variance(max_acceleration)


@jit
def _variance(max_acceleration: float) -> float:
    """Variance of an acceleration uniform up to `max_acceleration`, along an axis [m^2/s^4]."""
    return max_acceleration * max_acceleration / 3.0


@jit
def set_resting(track: Floats) -> None:
    """The track no longer counts as moving."""
    track[MOVES] = 0.0
    track[TAX] = track[TAY] = track[PA] = track[VA] = track[AA] = 0.0


@jit
def set_ends(track: Floats, points: Floats) -> None:
    """Store where beams end on it, by the points of its cluster (n, 2)."""
    for i in range(N_ENDS):
        p = (2 * i + 1) * len(points) // (2 * N_ENDS)
        track[ENDS_AT + 2 * i], track[ENDS_AT + 2 * i + 1] = points[p, 0], points[p, 1]
    track[ENDS_AGE] = 0.0


def no_tracks() -> Floats:
    """(0, COLUMNS)."""
    return np.empty((0, COLUMNS))
