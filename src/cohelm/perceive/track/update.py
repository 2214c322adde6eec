"""Updates a track by the cluster of points that it is seen as.

Of a mover the disc is fitted whose rim they are on, place and radius together; the radius is
learnt, with a variance of its own. Were every scan to measure it anew, the near part of a rim that
comes nearer could as well be that of a larger disc, and who sets off would be told late.
"""

from __future__ import annotations

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats
from cohelm.perceive.scan.clusters import AGE, CX, CY, HIDDEN, SIZE, Look
from cohelm.perceive.track.rim_fit import Fit, rim_distance, rim_fit
from cohelm.perceive.track.track import (
    GONE,
    MISSED,
    MOVES,
    PP,
    RADIUS,
    RR,
    SEEN,
    TVX,
    TVY,
    TX,
    TY,
    corrected,
    reinitialized,
)
from cohelm.robot.sensors import Lidar

UNSURE = 0.15
"""A radius of which nothing is known yet may be off by this, one standard deviation [m]."""
_INCONSISTENT = 13.8  # chi squared of two that one of a thousand exceeds
_KNOWN = 0.05  # known to this, a radius says more than the part of a rim that is in view [m]


@jit_inline
def known(one: Floats) -> bool:
    """Whether its radius is known: its rim has been seen to move."""
    return one[RR] < _KNOWN * _KNOWN


@jit
def centre_variance(cluster: Floats, scatter: float) -> float:
    """Variance of a cluster's centre, of which `scatter` is the standard deviation where it is in
    view whole [m]: less sure where only a part is [m^2]."""
    own = scatter
    if cluster[HIDDEN] > 0.0:
        own += 0.5 * cluster[SIZE] + 0.05
    return own * own


@jit
def is_rim(one: Floats, cluster: Floats) -> bool:
    """Whether a cluster may be the rim, or a part of it, of a mover of known radius."""
    return one[MOVES] > 0.0 and known(one) and cluster[SIZE] < one[RADIUS] + _KNOWN


@jit
def then(one: Floats, cluster: Floats) -> tuple[float, float]:
    """Where the track was when the cluster's beams were measured [m]."""
    if one[MOVES] == 0.0:
        return one[TX], one[TY]
    return one[TX] - cluster[AGE] * one[TVX], one[TY] - cluster[AGE] * one[TVY]


@jit
def updated(
    one: Floats, cluster: Floats, seen: Floats, lidar: Lidar, now: Look, scatter: float, most: float
) -> None:  # fmt: skip
    """Kalman update of a track by its cluster of points in `odom`, `seen`.

    scatter: as for `centre_variance` [m]. most: largest acceleration [m/s^2].
    """
    one[SEEN] += 1.0
    one[MISSED] = 0.0
    one[GONE] = 0.0
    if one[MOVES] > 0.0 and _fitted(one, cluster, seen, lidar, now, most):
        return
    x, y = then(one, cluster)
    noise = centre_variance(cluster, scatter)
    gain = one[PP] / (one[PP] + noise)
    dx, dy = gain * (cluster[CX] - x), gain * (cluster[CY] - y)
    corrected(one, dx, dy, (1.0 - gain) * one[PP], most)
    _sized(one, cluster[SIZE], cluster[HIDDEN] > 0.0)


@jit
def _sized(one: Floats, size: float, hidden: bool) -> None:
    """Update its radius by a measured one; of a hidden one, by no smaller one [m]."""
    if hidden:
        size = max(size, one[RADIUS])
    more = (0.3 if size > one[RADIUS] else 0.1) * (size - one[RADIUS])
    one[RADIUS] += more
    one[RR] = min(one[RR] + more * more, UNSURE * UNSURE)


@jit
def _fit(one: Floats, seen: Floats, x: float, y: float, noise: float) -> Fit:
    """The disc that a mover's points are the rim of, expected at (x, y) [m]."""
    fit = rim_fit(seen, x, y, one[RADIUS], one[PP], one[RR], noise)
    off = rim_distance(seen, fit.x, fit.y, fit.radius)
    if off * off > noise:  # it is less round than a disc is
        fit = rim_fit(seen, x, y, one[RADIUS], one[PP], one[RR], off * off)
    return fit


@jit
def _inconsistent(one: Floats, dx: float, dy: float, variance: float) -> bool:
    """Whether a mover of known radius is where he can not be with the acceleration that he is taken
    to be capable of: who runs into something stops dead. By how far his place would be put right,
    (dx, dy) [m], to this variance: the normalized innovation squared (Bar-Shalom, Li and
    Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.4)."""
    gain = 1.0 - variance / one[PP]
    return known(one) and dx * dx + dy * dy > _INCONSISTENT * gain * one[PP]


@jit
def _fitted(
    one: Floats, cluster: Floats, seen: Floats, lidar: Lidar, now: Look, most: float
) -> bool:
    """Update a mover by the disc whose rim is seen; whether there is such a disc."""
    x, y = then(one, cluster)
    hidden = cluster[HIDDEN] > 0.0
    if hidden and not is_rim(one, cluster):
        return False
    noise = lidar.noise * lidar.noise
    fit = _fit(one, seen, x, y, noise)
    if _inconsistent(one, fit.x - x, fit.y - y, fit.variance):
        reinitialized(one)
        x, y = then(one, cluster)
        fit = _fit(one, seen, x, y, noise)
    ux, uy = fit.x - now.sensor.x, fit.y - now.sensor.y
    mx, my = seen[:, 0].mean() - now.sensor.x, seen[:, 1].mean() - now.sensor.y
    before = mx * mx + my * my < ux * ux + uy * uy
    if not (fit.good and before):
        return False
    corrected(one, fit.x - x, fit.y - y, fit.variance, most)
    if not hidden:
        one[RADIUS], one[RR] = fit.radius, fit.radius_variance
    return True
