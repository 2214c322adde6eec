"""Estimates the accelerations of movers, and selects those that matter within the horizon."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.bounds import brake_steps
from cohelm.law.guard.surroundings import is_static
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.robot.limits import Limits

_MAX_MOVERS = 64
_SLOW = 0.05  # slower movers cause no evasion; as in `plan.prediction` [m/s]
_GATE = 0.5  # association gate: distance from the predicted position [m]
_SAMPLES = 6  # velocities from which an acceleration is estimated
_DEVIATION = 1.0 / 3.0  # standard deviation of a velocity as a share of the bound of its error
_FITS = 2.0  # standard deviations that a velocity may be off a steady change
_WALKING_SPEED = 0.3  # a mover that was faster than this within
_RECENT = 1.0  # this time may set off again at any moment [m/s, s]
_MIN_WALKING_TIME = 0.5  # one that has walked for less may be noise [s]
_RESTS = 0.1  # one that has walked and is slower than this rests, and within
_STOPS = 10.0  # this time after it may rest again [m/s, s]
_STRONG = 0.5  # share of max_acceleration above which a braking mover is predicted to stop
_TOP_SPEED_FACTOR = 2.0  # of the largest observed speed: speed that a mover may reach
_DETECTION_TIME = 0.3  # until one that sets off is detected, of known velocity: three scans [s]
_MASKED = 4.0  # times as long as its velocity is within the bound of its error: longer by so much

HX, HY, TOP, SINCE, WALKED, RESTED, ERROR, COUNT, HVX = range(9)
HVY = HVX + _SAMPLES
HT = HVY + _SAMPLES
"""Columns of the history: position [m], largest speed so far [m/s], time since it was last faster
than `_WALKING_SPEED`, for how long it has been in all, time since it rested after that [s], bound
of its velocity's error [m/s], and how many velocities follow. These are of the last evaluations,
newest first, `_SAMPLES` columns each of vx and vy [m/s], and of their ages [s]."""

MX, MY, MVX, MVY, M_RADIUS, MAX_ACCELERATION, GROWTH = range(7)
AX, AY, TURNING, TOP_SPEED, LEAVING, VELOCITY_ERROR = range(7, 13)
"""Columns of relevant movers: position [m], velocity [m/s], radius [m], max_acceleration [m/s^2],
growth rate of the position uncertainty [m/s], estimated acceleration [m/s^2] and its duration [s],
speed that it may reach [m/s], time that the robot takes to get out of its way [s], and
velocity_error [m/s]."""


def empty_mover_history() -> Floats:
    """History of movers, for `evade`: (64, 27), columns from `HX` on, a row for each mover at the
    last evaluation, then NaN."""
    return np.full((_MAX_MOVERS, HT + _SAMPLES), math.nan)


@jit
def updated_history(
    history: Floats, discs: Floats, velocity_error: Floats, since: float
) -> Floats:  # fmt: skip
    """The moving ones of discs (n, 6) with their past, columns from `HX` on.

    velocity_error: (n,), bounds, as the discs were seen [m/s]. since: time since the last
    evaluation; infinite: there was none [s].
    """
    out = np.empty((min(len(discs), _MAX_MOVERS), history.shape[1]))
    n, first = 0, since if since < math.inf else 0.0
    for i in range(len(discs)):
        d = discs[i]
        speed = math.hypot(d[VX], d[VY])
        if n == len(out) or not speed > 0.0:  # nor for NaN
            continue
        row, walks = out[n], speed > _WALKING_SPEED
        row[HX], row[HY], row[TOP], row[COUNT] = d[X], d[Y], speed, 1.0
        row[RESTED] = math.inf
        row[SINCE], row[WALKED] = (0.0, first) if walks else (math.inf, 0.0)
        row[HVX], row[HVY], row[ERROR], row[HT] = d[VX], d[VY], velocity_error[i], 0.0
        best, match = _GATE, -1
        for j in range(len(history)):
            far = math.hypot(
                history[j, HX] + since * history[j, HVX] - d[X],
                history[j, HY] + since * history[j, HVY] - d[Y],
            )
            if far < best:
                best, match = far, j
        if match >= 0:
            before = history[match]
            kept = min(int(before[COUNT]), _SAMPLES - 1)
            row[HVX + 1 : HVX + 1 + kept] = before[HVX : HVX + kept]
            row[HVY + 1 : HVY + 1 + kept] = before[HVY : HVY + kept]
            row[HT + 1 : HT + 1 + kept] = before[HT : HT + kept] + since
            row[COUNT] = kept + 1.0
            row[TOP] = max(speed, before[TOP])
            row[SINCE] = min(row[SINCE], before[SINCE] + since)
            row[WALKED] += before[WALKED]
            rests = speed < _RESTS and before[WALKED] > _MIN_WALKING_TIME
            row[RESTED] = 0.0 if rests else before[RESTED] + since
        n += 1
    return out[:n]


@jit_no_refcount
def acceleration(past: Floats, most: float) -> tuple[float, float]:
    """The acceleration of a mover, by the longest stretch of its past on which its velocity changed
    linearly to within its error, the last two at least: least squares.

    It is shrunk by what noise alone would give (James and Stein 1961), to zero where it is no
    larger. So a mover known exactly has the acceleration of the last two velocities; of one seen by
    LiDAR noise is averaged over half a second, and a manoeuvre is noticed when it stands out.

    past: a row of the history; the bound of its velocity's error counts as three standard
    deviations. most: its max_acceleration [m/s^2].
    """
    sigma, ax, ay = _DEVIATION * past[ERROR], 0.0, 0.0
    for n in range(2, int(past[COUNT]) + 1):
        mean_x, mean_y, slope_x, slope_y, spread = 0.0, 0.0, 0.0, 0.0, 0.0
        middle = 0.0
        for k in range(n):
            middle += past[HT + k] / n
        for k in range(n):
            vx, vy = past[HVX + k], past[HVY + k]
            t = middle - past[HT + k]  # from the middle of the stretch
            mean_x, mean_y, spread = mean_x + vx / n, mean_y + vy / n, spread + t * t
            slope_x, slope_y = slope_x + t * vx, slope_y + t * vy
        slope_x, slope_y = slope_x / spread, slope_y / spread
        for k in range(n):
            t = middle - past[HT + k]
            off_x = past[HVX + k] - mean_x - t * slope_x
            off_y = past[HVY + k] - mean_y - t * slope_y
            if n > 2 and math.hypot(off_x, off_y) > _FITS * sigma:
                return _at_most(ax, ay, most)
        noise = 2.0 * sigma * sigma / spread  # mean square of the slope of noise
        square = slope_x * slope_x + slope_y * slope_y
        share = 1.0 - noise / square if square > noise else 0.0
        ax, ay = share * slope_x, share * slope_y
    return _at_most(ax, ay, most)


@jit_inline
def _at_most(ax: float, ay: float, most: float) -> tuple[float, float]:
    """An acceleration, no larger than a mover's max_acceleration."""
    size = math.hypot(ax, ay)
    share = min(1.0, max(most, 0.0) / size) if size > 0.0 else 1.0
    return share * ax, share * ay


@jit
def relevant_movers(
    obstacles: Surroundings, history: Floats, pose: Pose, reach: float, limits: Limits,
    params: EvasionParams, wary: float,
) -> tuple[Floats, int]:  # fmt: skip
    """(m, 13), columns from `MX` on: discs that matter within the horizon; and how many of them,
    the first ones, move or did recently. The others may set off.

    wary: share of the time for which noise masks that one sets off which counts, in [0, 1].
    """
    out = np.empty((2 * len(obstacles.discs), VELOCITY_ERROR + 1))
    n = _write(out, 0, True, obstacles, history, pose, reach, limits, params, wary)
    return out[: _write(out, n, False, obstacles, history, pose, reach, limits, params, wary)], n


@jit
def _write(
    out: Floats, n: int, moving: bool, obstacles: Surroundings, history: Floats, pose: Pose,
    reach: float, limits: Limits, params: EvasionParams, wary: float,
) -> int:  # fmt: skip
    """Write the moving discs, or the others, from row n on; returns one past the last row."""
    k = 0
    robot_speed = min(params.speed, limits.speed)
    stopping_time = brake_steps(Twist(robot_speed, 0.0), limits, STEP) * STEP
    for i in range(len(obstacles.discs)):
        d = obstacles.discs[i]
        vx, vy = d[VX], d[VY]
        most = obstacles.max_acceleration[i]
        speed, ax, ay = math.hypot(vx, vy), 0.0, 0.0
        top_speed, recently, turning, stops = 0.0, speed > _SLOW, params.turning, False
        if speed > 0.0:
            if k < len(history):
                walker = history[k, WALKED] > _MIN_WALKING_TIME
                stops = history[k, RESTED] < _STOPS
                top_speed = history[k, TOP] if walker else 0.0
                recently = recently or (walker and history[k, SINCE] < _RECENT)
                ax, ay = acceleration(history[k], most)
            k += 1
        if is_static(obstacles, i):
            continue
        if recently != moving:
            continue
        far = math.hypot(d[X] - pose.x, d[Y] - pose.y) - d[RADIUS] - reach
        if not far < (speed + params.speed) * params.horizon + params.social_clearance:
            continue
        if speed > 0.0:  # a braking mover stops; it does not reverse
            braking = -(ax * vx + ay * vy) / speed
            threshold = max(_STRONG * most, 0.9 * math.hypot(ax, ay))
            if braking > threshold:
                turning = speed / braking
                ax, ay = -braking * vx / speed, -braking * vy / speed
            elif -braking > threshold:  # an accelerating one continues up to its top speed
                turning = max((_TOP_SPEED_FACTOR * top_speed - speed) / -braking, turning)
            else:
                back = min(speed / params.turning - braking, 0.0) / speed
                ax, ay = ax - back * vx, ay - back * vy
        out[n, MX], out[n, MY], out[n, MVX], out[n, MVY] = d[X], d[Y], vx, vy
        out[n, M_RADIUS], out[n, MAX_ACCELERATION] = d[RADIUS], most
        out[n, VELOCITY_ERROR] = obstacles.velocity_error[i]
        out[n, GROWTH] = params.standing_growth
        if moving:
            out[n, GROWTH] = min(
                params.moving_growth + params.growth_per_speed * speed, params.most_growth
            )
        out[n, AX], out[n, AY], out[n, TURNING] = ax, ay, turning
        out[n, TOP_SPEED] = _TOP_SPEED_FACTOR * top_speed
        set_off_acceleration = min(most, params.sets_off_acceleration)
        distance = reach + d[RADIUS] + 0.5 * set_off_acceleration * stopping_time * stopping_time
        masked = obstacles.velocity_error[i] / max(set_off_acceleration, 1e-3)
        detected = _DETECTION_TIME + (wary * _MASKED * masked if stops else 0.0)
        leaving = distance / max(robot_speed, 1e-3) + 0.5 * stopping_time
        out[n, LEAVING] = min(detected + leaving, params.horizon)
        n += 1
        if params.pass_right > 0.0 and far < math.inf:
            out[n] = out[n - 1]
            away = math.hypot(d[X] - pose.x, d[Y] - pose.y)
            share = params.pass_right / max(away, 1e-9)
            out[n, MX] -= share * (d[Y] - pose.y)
            out[n, MY] += share * (d[X] - pose.x)
            n += 1
    return n
