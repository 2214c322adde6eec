"""One track: its state, its Kalman filter, and the proof that it moves.

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
from cohelm.perceive.scan.clusters import AGE, CX, CY, FRESH, OCCLUDED, SIZE
from cohelm.perceive.scan.deskew import DeskewedScan, was_free
from cohelm.perceive.track.params import TrackerParams
from cohelm.perceive.track.rim_fit import Fit, rim_distance, rim_fit

TX, TY, TVX, TVY, TAX, TAY, PP, PV, VV, PA, VA, AA = range(12)
RADIUS, RR, SEEN, MISSED, PROOF, MOVES, ENDS_AGE, SEEN_EMPTY, AT_REST, ENDS_AT = range(12, 22)
N_ENDS = 8
KX, KY, KVX, KVY, KPP, KPV, KVV = range(ENDS_AT + 2 * N_ENDS, ENDS_AT + 2 * N_ENDS + 7)
COLUMNS = KVV + 1
"""Columns of tracks: position, velocity and acceleration, their covariances (the same along both
axes: of position, of it with velocity, of velocity, of position and velocity with acceleration, of
acceleration), radius, its variance, number of scans it was seen in, time since then [s], proof that
it moves, whether it counts as moving, age of the ends [s], number of scans in which its place was
seen empty, time without proof of motion [s]; from ENDS_AT on x and y of eight places in which beams
ended on it a while ago [m]; from KX on position, velocity and their covariances when it was last
seen.
"""

_ACCELERATION_DECAY = 0.8
"""Time constant of accelerations [s]: about a step and a half of a walker."""

_INITIAL_VARIANCE = 1.0
"""Prior variance of a new track's velocity, along an axis [m^2/s^2]."""
_RADIUS_KNOWN = 0.05
"""Standard deviation below which a radius counts as known [m]."""
_REINITIALIZED = 0.3  # position sigma after a manoeuvre beyond max_acceleration [m]
_RADIUS_DRIFT = 0.003  # process noise of the radius [m/sqrt(s)]: an arm, a coat


@jit_inline
def _radius_known(track: Floats) -> bool:
    """Whether its radius is known: its rim has been observed while it moved."""
    return track[RR] < _RADIUS_KNOWN * _RADIUS_KNOWN


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
    decay, half = math.exp(-dt / _ACCELERATION_DECAY), 0.5 * dt * dt
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
def _correct(track: Floats, dx: float, dy: float, variance: float, max_acceleration: float) -> None:
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
    keep_as_seen(track)


@jit
def keep_as_seen(track: Floats) -> None:
    """Keep its motion as that when it was last seen."""
    track[KX : KVY + 1] = track[TX : TVY + 1]
    track[KPP : KVV + 1] = track[PP : VV + 1]


@jit
def _reinitialize(track: Floats) -> None:
    """Reset the motion of a track that is inconsistent with its prediction, as of a new one."""
    track[PP] = max(track[PP], _REINITIALIZED * _REINITIALIZED)
    track[TVX] = track[TVY] = track[TAX] = track[TAY] = 0.0
    track[PV] = track[PA] = track[VA] = 0.0
    track[VV] = _INITIAL_VARIANCE


@jit
def _set_moving(track: Floats, max_acceleration: float) -> None:
    """The track counts as moving: its acceleration is estimated from now on."""
    track[MOVES], track[AT_REST] = 1.0, 0.0
    if track[AA] == 0.0:
        track[AA] = _variance(max_acceleration)


@jit
def _variance(max_acceleration: float) -> float:
    """Variance of an acceleration uniform up to `max_acceleration`, along an axis [m^2/s^4]."""
    return max_acceleration * max_acceleration / 3.0


@jit
def _set_resting(track: Floats) -> None:
    """The track no longer counts as moving."""
    track[MOVES] = 0.0
    track[TAX] = track[TAY] = track[PA] = track[VA] = track[AA] = 0.0


@jit
def _set_ends(track: Floats, points: Floats) -> None:
    """Store where beams end on it, by the points of its cluster (n, 2)."""
    for i in range(N_ENDS):
        p = (2 * i + 1) * len(points) // (2 * N_ENDS)
        track[ENDS_AT + 2 * i], track[ENDS_AT + 2 * i + 1] = points[p, 0], points[p, 1]
    track[ENDS_AGE] = 0.0


def no_tracks() -> Floats:
    """(0, COLUMNS)."""
    return np.empty((0, COLUMNS))


# Update by the cluster of points associated with it.
#
# The disc of a mover is fitted to the visible rim, position and radius together; the radius is a
# state with a variance of its own. Were it measured anew with every scan, an approaching rim could
# as well be that of a larger disc, and a mover that sets off would be detected late.


_RADIUS_SIGMA = 0.5  # prior standard deviation of a radius: the visible part says little [m]
_LARGEST_RADIUS = 0.7  # larger radii are of no disc, but of a flat side [m]
_GATE = 0.6  # a cluster farther than this from a track is not taken for it [m]
_INCONSISTENT = 13.8  # 99.9 % quantile of chi squared with two degrees of freedom


@jit
def _centre_variance(cluster: Floats, scatter: float) -> float:
    """Variance of a cluster's centre [m^2]. scatter: its standard deviation where all of it is
    visible [m]; it is larger where a part is occluded."""
    sigma = scatter
    if cluster[OCCLUDED] > 0.0:
        sigma += 0.5 * cluster[SIZE] + 0.05
    return sigma * sigma


@jit
def _is_rim(track: Floats, cluster: Floats) -> bool:
    """Whether a cluster may be the rim, or a part of it, of a mover of known radius."""
    known = track[MOVES] > 0.0 and _radius_known(track)
    return known and cluster[SIZE] < track[RADIUS] + _RADIUS_KNOWN


@jit
def _position_at(track: Floats, cluster: Floats) -> tuple[float, float]:
    """Position of the track when the cluster's beams were measured [m]."""
    if track[MOVES] == 0.0:
        return track[TX], track[TY]
    return track[TX] - cluster[AGE] * track[TVX], track[TY] - cluster[AGE] * track[TVY]


@jit
def association_cost(track: Floats, cluster: Floats, points: Floats, scatter: float) -> float:
    """Cost of taking a cluster, of these `points` in `odom`, for a track: of the squared distance
    over its variance; infinite where it is too far. scatter: see `_centre_variance` [m]."""
    x, y = _position_at(track, cluster)
    d = math.hypot(cluster[CX] - x, cluster[CY] - y)
    if d > _GATE:
        return math.inf
    if _is_rim(track, cluster):
        d = rim_distance(points, x, y, track[RADIUS])
        return d * d / (scatter * scatter + track[PP])
    wide = _centre_variance(cluster, scatter) + track[PP]
    return d * d / wide + 4.0 * abs(cluster[SIZE] - track[RADIUS])


@jit
def begin_track(track: Floats, cluster: Floats, points: Floats, scatter: float) -> None:
    """Begin a track, all zeros, with a cluster of these `points` in `odom`."""
    track[TX], track[TY], track[RADIUS] = cluster[CX], cluster[CY], cluster[SIZE]
    track[PP], track[VV] = _centre_variance(cluster, scatter), _INITIAL_VARIANCE
    track[SEEN] = 1.0
    _set_ends(track, points)
    track[RR] = _RADIUS_SIGMA * _RADIUS_SIGMA
    keep_as_seen(track)


@jit
def update_track(
    track: Floats, cluster: Floats, points: Floats, sweep: DeskewedScan, params: TrackerParams
) -> None:
    """Kalman update of a track by its cluster of points in `odom`, `points`."""
    max_acceleration = params.max_acceleration
    track[SEEN] += 1.0
    track[MISSED] = 0.0
    track[SEEN_EMPTY] = 0.0
    if track[MOVES] > 0.0 and _update_by_rim(track, cluster, points, sweep, max_acceleration):
        return
    x, y = _position_at(track, cluster)
    noise = _centre_variance(cluster, params.scatter)
    gain = track[PP] / (track[PP] + noise)
    dx, dy = gain * (cluster[CX] - x), gain * (cluster[CY] - y)
    _correct(track, dx, dy, (1.0 - gain) * track[PP], max_acceleration)
    occluded = cluster[OCCLUDED] > 0.0
    if track[PROOF] > 0.0 and track[MOVES] == 0.0 and not occluded:
        # Learnt before it counts as a mover: one that is hidden by then is still known by its rim.
        fit = _fitted_disc(track, points, x, y, sweep.lidar.noise * sweep.lidar.noise)
        if _is_round(fit, points, sweep):
            track[RADIUS], track[RR] = fit.radius, fit.radius_variance
            return
    _update_radius(track, cluster[SIZE], occluded)


@jit
def _update_radius(track: Floats, size: float, occluded: bool) -> None:
    """Update its radius by a measured one; if occluded, only to a larger one [m]."""
    if occluded:
        size = max(size, track[RADIUS])
    change = (0.3 if size > track[RADIUS] else 0.1) * (size - track[RADIUS])
    track[RADIUS] += change
    track[RR] = min(track[RR] + change * change, _RADIUS_SIGMA * _RADIUS_SIGMA)


@jit
def _fitted_disc(track: Floats, points: Floats, x: float, y: float, noise: float) -> Fit:
    """The disc fitted to a mover's points, with prior at (x, y) [m]."""
    fit = rim_fit(points, x, y, track[RADIUS], track[PP], track[RR], noise)
    rms = rim_distance(points, fit.x, fit.y, fit.radius)
    if rms * rms > noise:  # less round than the noise explains
        fit = rim_fit(points, x, y, track[RADIUS], track[PP], track[RR], rms * rms)
    return fit


@jit
def _is_round(fit: Fit, points: Floats, sweep: DeskewedScan) -> bool:
    """Whether the points are the near rim of the disc fitted to them."""
    ux, uy = fit.x - sweep.sensor.x, fit.y - sweep.sensor.y
    mx, my = points[:, 0].mean() - sweep.sensor.x, points[:, 1].mean() - sweep.sensor.y
    return fit.good and fit.radius < _LARGEST_RADIUS and mx * mx + my * my < ux * ux + uy * uy


@jit
def _inconsistent(track: Floats, dx: float, dy: float, variance: float) -> bool:
    """Whether the correction (dx, dy) [m], to this variance, of a mover of known radius exceeds its
    max_acceleration, as of one that runs into an obstacle: normalized innovation squared
    (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
    5.4)."""
    gain = 1.0 - variance / track[PP]
    return _radius_known(track) and dx * dx + dy * dy > _INCONSISTENT * gain * track[PP]


@jit
def _update_by_rim(
    track: Floats, cluster: Floats, points: Floats, sweep: DeskewedScan, max_acceleration: float
) -> bool:
    """Update a mover by a rim fit; returns whether the fit is good."""
    x, y = _position_at(track, cluster)
    occluded, known = cluster[OCCLUDED] > 0.0, _radius_known(track)
    if occluded and known and not _is_rim(track, cluster):
        return False
    noise = sweep.lidar.noise * sweep.lidar.noise
    fit = _fitted_disc(track, points, x, y, noise)
    if _inconsistent(track, fit.x - x, fit.y - y, fit.variance):
        _reinitialize(track)
        x, y = _position_at(track, cluster)
        fit = _fitted_disc(track, points, x, y, noise)
    if not _is_round(fit, points, sweep):
        return False
    _correct(track, fit.x - x, fit.y - y, fit.variance, max_acceleration)
    track[RADIUS], track[RR] = fit.radius, fit.radius_variance
    return True


# Motion test by free-space violation (Petrovskaya and Thrun 2009).


_SIGMAS = 3.0  # of the range, tolerance of a beam's end seen from elsewhere
_ENDS_KEPT = 1.2  # how long the reference ends are kept [s]


@jit
def update_proof(
    track: Floats, cluster: Floats, points: Floats, sweep: DeskewedScan, params: TrackerParams
) -> None:
    """Update the proof that a track moves: it is where space was free, or where it was is free.

    points: of its cluster, in `odom`.
    """
    proof = params.proof
    calm = params.dynamic.keep if _radius_known(track) else params.calm
    moves = math.hypot(track[TVX], track[TVY]) > params.slowest
    fresh = cluster[FRESH] >= 0.5
    if moves and track[SEEN] >= 3.0 and (fresh or _seen_through(track, sweep)):
        track[PROOF] = min(track[PROOF] + 1.0, 2.0 * proof)
    else:
        track[PROOF] = max(track[PROOF] - 1.0, 0.0)
    if track[PROOF] >= proof:
        _set_moving(track, params.max_acceleration)
    elif track[PROOF] == 0.0 and track[AT_REST] > calm and track[MOVES] > 0.0:
        _set_resting(track)
    if track[ENDS_AGE] > _ENDS_KEPT:
        _set_ends(track, points)


@jit
def _seen_through(track: Floats, sweep: DeskewedScan) -> bool:
    """Whether beams now pass half of the places in which beams ended on it a while ago. The fitted
    disc is not used: of a partly visible object its place may have been free all the time."""
    free = 0
    for i in range(N_ENDS):
        x, y = track[ENDS_AT + 2 * i], track[ENDS_AT + 2 * i + 1]
        if was_free(sweep, x, y, _SIGMAS * sweep.lidar.noise):
            free += 1
    return 2 * free >= N_ENDS
