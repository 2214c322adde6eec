"""Kalman update of a track by the cluster of points associated with it.

The disc of a mover is fitted to the visible rim, position and radius together; the radius is a
state with a variance of its own. Were it measured anew with every scan, an approaching rim could
as well be that of a larger disc, and a mover that sets off would be detected late.
"""

from __future__ import annotations

import math

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.perceive.scan.clusters import AGE, CX, CY, OCCLUDED, SIZE
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.perceive.track.params import TrackerParams
from cohelm.perceive.track.rim_fit import Fit, rim_distance, rim_fit
from cohelm.perceive.track.track import (
    INITIAL_VARIANCE,
    MISSED,
    MOVES,
    PP,
    PROOF,
    RADIUS,
    RADIUS_KNOWN,
    RR,
    SEEN,
    SEEN_EMPTY,
    TVX,
    TVY,
    TX,
    TY,
    VV,
    correct,
    radius_known,
    reinitialize,
    set_ends,
)
from cohelm.robot.sensors import Lidar

_RADIUS_SIGMA = 0.15  # prior standard deviation of a radius [m]
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
    return (
        track[MOVES] > 0.0 and radius_known(track) and cluster[SIZE] < track[RADIUS] + RADIUS_KNOWN
    )


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
    track[PP], track[VV] = _centre_variance(cluster, scatter), INITIAL_VARIANCE
    track[SEEN] = 1.0
    set_ends(track, points)
    track[RR] = _RADIUS_SIGMA * _RADIUS_SIGMA


@jit
def update_track(
    track: Floats, cluster: Floats, points: Floats, lidar: Lidar, sweep: DeskewedScan,
    params: TrackerParams,
) -> None:  # fmt: skip
    """Kalman update of a track by its cluster of points in `odom`, `points`."""
    max_acceleration = params.max_acceleration
    track[SEEN] += 1.0
    track[MISSED] = 0.0
    track[SEEN_EMPTY] = 0.0
    if track[MOVES] > 0.0 and _update_by_rim(
        track, cluster, points, lidar, sweep, max_acceleration
    ):
        return
    x, y = _position_at(track, cluster)
    noise = _centre_variance(cluster, params.scatter)
    gain = track[PP] / (track[PP] + noise)
    dx, dy = gain * (cluster[CX] - x), gain * (cluster[CY] - y)
    correct(track, dx, dy, (1.0 - gain) * track[PP], max_acceleration)
    occluded = cluster[OCCLUDED] > 0.0
    if track[PROOF] > 0.0 and track[MOVES] == 0.0 and not occluded:
        # Learnt before it counts as a mover: one that is hidden by then is still known by its rim.
        fit = _fitted_disc(track, points, x, y, lidar.noise * lidar.noise)
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
    return fit.good and mx * mx + my * my < ux * ux + uy * uy


@jit
def _inconsistent(track: Floats, dx: float, dy: float, variance: float) -> bool:
    """Whether the correction (dx, dy) [m], to this variance, of a mover of known radius exceeds its
    max_acceleration, as of one that runs into an obstacle: normalized innovation squared
    (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
    5.4)."""
    gain = 1.0 - variance / track[PP]
    return radius_known(track) and dx * dx + dy * dy > _INCONSISTENT * gain * track[PP]


@jit
def _update_by_rim(
    track: Floats, cluster: Floats, points: Floats, lidar: Lidar, sweep: DeskewedScan,
    max_acceleration: float,
) -> bool:  # fmt: skip
    """Update a mover by a rim fit; returns whether the fit is good."""
    x, y = _position_at(track, cluster)
    occluded = cluster[OCCLUDED] > 0.0
    if occluded and not _is_rim(track, cluster):
        return False
    noise = lidar.noise * lidar.noise
    fit = _fitted_disc(track, points, x, y, noise)
    if _inconsistent(track, fit.x - x, fit.y - y, fit.variance):
        reinitialize(track)
        x, y = _position_at(track, cluster)
        fit = _fitted_disc(track, points, x, y, noise)
    if not _is_round(fit, points, sweep):
        return False
    correct(track, fit.x - x, fit.y - y, fit.variance, max_acceleration)
    if not occluded:
        track[RADIUS], track[RR] = fit.radius, fit.radius_variance
    return True
