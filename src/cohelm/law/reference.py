"""Waypoints to a trajectory in time: natural cubic splines (7)-(13), evaluated compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.types import Desired, Floats

_INSTANT = 1e-9  # waypoints closer in time than this [s] are a mistake in units
_AT_REST = 1e-9  # below this speed [m/s] the spline has no direction: a cusp, or the end


class Reference(NamedTuple):
    """A piecewise cubic path in time, as plain arrays that compiled code reads.

    knots: (m,) times T_i [s], T_1 = 0. coeffs: (m - 1, 8), cubic coefficients of S_X then S_Y,
    highest power first, in the local time t - T_i. speed: the nominal u_d [m/s].
    """

    knots: Floats
    coeffs: Floats
    speed: float

    @property
    def duration(self) -> float:
        """T_m, the time of the last waypoint [s]."""
        return float(self.knots[-1])


def through(waypoints: Floats | list[list[float]], speed: float) -> Reference:
    """Natural cubic splines through waypoints, at chord length over speed apart in time (13).

    waypoints: (m, 2), m >= 2 [m]. speed: u_d > 0 [m/s].
    Raises CohelmError for fewer than two waypoints, a number that is not finite, two equal
    waypoints in a row, a speed that is not positive, or one that does not fit their distances.
    """
    try:
        points = np.asarray(waypoints, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CohelmError(
            f"waypoints must be pairs of numbers [x, y] in metres ({error})"
        ) from error
    if points.ndim != 2 or points.shape[1] != 2:
        raise CohelmError(f"waypoints must be pairs [x, y] in metres, got shape {points.shape}")
    if len(points) < 2:
        raise CohelmError(f"a reference needs at least 2 waypoints, got {len(points)}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise CohelmError(f"waypoint {bad[0] + 1} is not finite: {points[bad[0]].tolist()}")
    with np.errstate(over="ignore"):
        chords = np.hypot(*np.diff(points, axis=0).T)
    same = np.flatnonzero(chords < 1e-6)
    if same.size:
        raise CohelmError(
            f"waypoints {same[0] + 1} and {same[0] + 2} are the same point "
            f"{points[same[0]].tolist()}; remove one"
        )
    if not (math.isfinite(speed) and speed > 0.0):
        raise CohelmError(f"the reference speed must be a positive number of m/s, got {speed}")
    with np.errstate(over="ignore"):
        knots = np.concatenate(([0.0], np.cumsum(chords / speed)))
    if not (np.isfinite(knots[-1]) and (np.diff(knots) > _INSTANT).all()):
        raise CohelmError(
            f"waypoints are too far or too near for a speed of {speed} m/s; "
            "coordinates are in metres"
        )
    return Reference(knots, _natural(knots, points), float(speed))


def _natural(knots: Floats, points: Floats) -> Floats:
    """Coefficients of the natural cubic splines through points (m, 2), as in `Reference`.

    From the slopes at the knots: continuous curvature between the pieces, none at either end. In
    scipy's order of operations, so equal to its CubicSpline to the last bit; not that itself, since
    scipy.interpolate takes a third of a second to import, and scipy.linalg a sixth.
    """
    dt, right = np.diff(knots), np.empty((len(knots), 2))
    chord = np.diff(points, axis=0) / dt[:, None]
    low, high = np.append(dt[1:], dt[-1]), np.append(dt[0], dt[:-1])
    middle = np.concatenate(([2 * dt[0]], 2 * (dt[:-1] + dt[1:]), [2 * dt[-1]]))
    right[0], right[-1] = 3 * (points[1] - points[0]), 3 * (points[-1] - points[-2])
    right[1:-1] = 3 * (dt[1:, None] * chord[:-1] + dt[:-1, None] * chord[1:])
    _solve(low, middle, high, right)
    slope = right
    bend = (slope[:-1] + slope[1:] - 2 * chord) / dt[:, None]
    parts = bend / dt[:, None], (chord - slope[:-1]) / dt[:, None] - bend, slope[:-1], points[:-1]
    return np.ascontiguousarray(np.stack(parts, axis=2).reshape(len(dt), 8))


@jit_no_refcount
def _solve(low: Floats, middle: Floats, high: Floats, right: Floats) -> None:
    """Solve a tridiagonal system in place: `right`, (m, 2), becomes the solution.

    low: (m - 1,) below the diagonal; high: above it. Gaussian elimination with partial pivoting, as
    LAPACK's dgtsv; where two rows are exchanged, `low` holds what comes two above the diagonal.
    """
    m = len(middle)
    for i in range(m - 1):
        if abs(middle[i]) >= abs(low[i]):
            factor = low[i] / middle[i]
            middle[i + 1] -= factor * high[i]
            for k in range(2):
                right[i + 1, k] -= factor * right[i, k]
            low[i] = 0.0
        else:
            factor = middle[i] / low[i]
            middle[i], other = low[i], middle[i + 1]
            middle[i + 1] = high[i] - factor * other
            high[i], low[i] = other, 0.0
            if i < m - 2:
                low[i] = high[i + 1]
                high[i + 1] = -factor * low[i]
            for k in range(2):
                right[i, k], right[i + 1, k] = (
                    right[i + 1, k],
                    right[i, k] - factor * right[i + 1, k],
                )
    for i in range(m - 1, -1, -1):
        for k in range(2):
            if i < m - 1:
                right[i, k] -= high[i] * right[i + 1, k]
            if i < m - 2:
                right[i, k] -= low[i] * right[i + 2, k]
            right[i, k] /= middle[i]


class PathMotion(NamedTuple):
    """Position, velocity and acceleration on a path [m, m/s, m/s^2], world frame."""

    x: float
    y: float
    vx: float
    vy: float
    ax: float
    ay: float


@jit_no_refcount
def evaluate(knots: Floats, coeffs: Floats, t: float) -> PathMotion:
    """S_X, S_Y and their two derivatives at time t [s]; at rest on the ends outside [T_1, T_m]."""
    last = len(knots) - 1
    inside = min(max(t, knots[0]), knots[last])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= inside:
            low = middle
        else:
            high = middle
    s = inside - knots[low]
    c = coeffs[low]
    x = ((c[0] * s + c[1]) * s + c[2]) * s + c[3]
    y = ((c[4] * s + c[5]) * s + c[6]) * s + c[7]
    vx = (3.0 * c[0] * s + 2.0 * c[1]) * s + c[2]
    vy = (3.0 * c[4] * s + 2.0 * c[5]) * s + c[6]
    return PathMotion(x, y, vx, vy, 6.0 * c[0] * s + 2.0 * c[1], 6.0 * c[4] * s + 2.0 * c[5])


@jit_no_refcount
def desired(reference: Reference, t: float, spline_speed: bool) -> Desired:
    """The desired pose, speed and yaw rate at time t [s] (10)(12)(13).

    psi_d = atan2(S'_Y, S'_X)                                   (12), E9
    r_d   = (S'_X S''_Y - S'_Y S''_X) / (S'_X^2 + S'_Y^2)

    The feed-forward speed is u_d as printed, or with `spline_speed` the spline's own ||S'||
    (E10). Outside [0, T_m) the reference rests: speed and yaw rate are 0.
    """
    m = evaluate(reference.knots, reference.coeffs, t)
    square = m.vx * m.vx + m.vy * m.vy
    psi = math.atan2(m.vy, m.vx)
    if not 0.0 <= t < reference.knots[-1] or square < _AT_REST * _AT_REST:
        return Desired(m.x, m.y, psi, 0.0, 0.0)
    u = math.sqrt(square) if spline_speed else reference.speed
    return Desired(m.x, m.y, psi, u, (m.vx * m.ay - m.vy * m.ax) / square)


@jit
def tabulate(reference: Reference, dt: float, steps: int, spline_speed: bool) -> Floats:
    """`desired` at t = 0, dt, ..., (steps - 1) dt as rows of (x, y, psi, u, r): (steps, 5)."""
    rows = np.empty((steps, 5))
    for k in range(steps):
        d = desired(reference, k * dt, spline_speed)
        rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4] = d.x, d.y, d.psi, d.u, d.r
    return rows
