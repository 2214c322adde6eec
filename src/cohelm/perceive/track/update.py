"""Kalman update of a track by the cluster of points associated with it.

The disc of a mover is fitted to the visible rim, position and radius together; the radius is a
state with a variance of its own. Were it measured anew with every scan, an approaching rim could
as well be that of a larger disc, and a mover that sets off would be detected late.
"""

from __future__ import annotations

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats
from cohelm.perceive.scan.clusters import AGE, CX, CY, OCCLUDED, SIZE, PosedScan
from cohelm.perceive.track.rim_fit import Fit, rim_distance, rim_fit
from cohelm.perceive.track.track import (
    MISSED,
    MOVES,
    PP,
    RADIUS,
    RR,
    SEEN,
    SEEN_EMPTY,
    TVX,
    TVY,
    TX,
    TY,
    correct,
    reinitialize,
)
from cohelm.robot.sensors import Lidar

RADIUS_SIGMA = 0.15
"""Prior standard deviation of a radius [m]."""
_INCONSISTENT = 13.8  # 99.9 % quantile of chi squared with two degrees of freedom
_RADIUS_KNOWN = 0.05  # standard deviation below which a radius counts as known [m]


@jit_inline
def radius_known(track: Floats) -> bool:
    """Whether its radius is known: its rim has been observed while it moved."""
    return track[RR] < _RADIUS_KNOWN * _RADIUS_KNOWN


@jit
def centre_variance(cluster: Floats, scatter: float) -> float:
    """Variance of a cluster's centre [m^2]. scatter: its standard deviation where all of it is
    visible [m]; it is larger where a part is occluded."""
    sigma = scatter
    if cluster[OCCLUDED] > 0.0:
        sigma += 0.5 * cluster[SIZE] + 0.05
    return sigma * sigma


@jit
def is_rim(track: Floats, cluster: Floats) -> bool:
    """Whether a cluster may be the rim, or a part of it, of a mover of known radius."""
    return (
        track[MOVES] > 0.0 and radius_known(track) and cluster[SIZE] < track[RADIUS] + _RADIUS_KNOWN
    )


@jit
def position_at(track: Floats, cluster: Floats) -> tuple[float, float]:
    """Position of the track when the cluster's beams were measured [m]."""
    if track[MOVES] == 0.0:
        return track[TX], track[TY]
    return track[TX] - cluster[AGE] * track[TVX], track[TY] - cluster[AGE] * track[TVY]


@jit
def update_track(
    track: Floats, cluster: Floats, seen: Floats, lidar: Lidar, now: PosedScan, scatter: float,
    max_acceleration: float
) -> None:  # fmt: skip
    """Kalman update of a track by its cluster of points in `odom`, `seen`.

    scatter: as for `centre_variance` [m].
    """
    track[SEEN] += 1.0
    track[MISSED] = 0.0
    track[SEEN_EMPTY] = 0.0
    if track[MOVES] > 0.0 and _update_by_rim(track, cluster, seen, lidar, now, max_acceleration):
        return
    x, y = position_at(track, cluster)
    noise = centre_variance(cluster, scatter)
    gain = track[PP] / (track[PP] + noise)
    dx, dy = gain * (cluster[CX] - x), gain * (cluster[CY] - y)
    correct(track, dx, dy, (1.0 - gain) * track[PP], max_acceleration)
    _update_radius(track, cluster[SIZE], cluster[OCCLUDED] > 0.0)


@jit
def _update_radius(track: Floats, size: float, occluded: bool) -> None:
    """Update its radius by a measured one; if occluded, only to a larger one [m]."""
    if occluded:
        size = max(size, track[RADIUS])
    change = (0.3 if size > track[RADIUS] else 0.1) * (size - track[RADIUS])
    track[RADIUS] += change
    track[RR] = min(track[RR] + change * change, RADIUS_SIGMA * RADIUS_SIGMA)


@jit
def _fitted_disc(track: Floats, seen: Floats, x: float, y: float, noise: float) -> Fit:
    """The disc fitted to a mover's points, with prior at (x, y) [m]."""
    fit = rim_fit(seen, x, y, track[RADIUS], track[PP], track[RR], noise)
    rms = rim_distance(seen, fit.x, fit.y, fit.radius)
    if rms * rms > noise:  # less round than the noise explains
        fit = rim_fit(seen, x, y, track[RADIUS], track[PP], track[RR], rms * rms)
    return fit


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
    track: Floats, cluster: Floats, seen: Floats, lidar: Lidar, now: PosedScan,
    max_acceleration: float,
) -> bool:  # fmt: skip
    """Update a mover by a rim fit; returns whether the fit is good."""
    x, y = position_at(track, cluster)
    occluded = cluster[OCCLUDED] > 0.0
    if occluded and not is_rim(track, cluster):
        return False
    noise = lidar.noise * lidar.noise
    fit = _fitted_disc(track, seen, x, y, noise)
    if _inconsistent(track, fit.x - x, fit.y - y, fit.variance):
        reinitialize(track)
        x, y = position_at(track, cluster)
        fit = _fitted_disc(track, seen, x, y, noise)
    ux, uy = fit.x - now.sensor.x, fit.y - now.sensor.y
    mx, my = seen[:, 0].mean() - now.sensor.x, seen[:, 1].mean() - now.sensor.y
    in_front = mx * mx + my * my < ux * ux + uy * uy
    if not (fit.good and in_front):
        return False
    correct(track, fit.x - x, fit.y - y, fit.variance, max_acceleration)
    if not occluded:
        track[RADIUS], track[RR] = fit.radius, fit.radius_variance
    return True
