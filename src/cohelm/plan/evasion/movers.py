"""Estimates the accelerations of movers, and selects those that matter within the horizon."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.bounds import brake_steps
from cohelm.law.guard.surroundings import Surroundings, is_static
from cohelm.plan.evasion.params import STEP, EvasionParams
from cohelm.robot.limits import Limits

_MAX_MOVERS = 64
_SLOW = 0.05  # slower movers cause no evasion; as in `plan.prediction` [m/s]
_GATE = 0.5  # association gate: distance from the predicted position [m]
_GAIN = 0.5  # of the exponential filter of accelerations
_WALKING_SPEED = 0.3  # a mover that was faster than this within
_RECENT = 1.0  # this time may set off again at any moment [m/s, s]
_MIN_WALKING_TIME = 0.5  # one that has walked for less may be noise [s]
_STRONG = 0.5  # share of max_acceleration above which a braking mover is predicted to stop
_AGREE = 0.8  # agreement of two successive accelerations, as a share of the larger one
_TOP_SPEED_FACTOR = 2.0  # of the largest observed speed: speed that a mover may reach
_DETECTION_TIME = 0.3  # until a mover that sets off is detected: three scans [s]


def empty_mover_history() -> Floats:
    """History of movers, for `evade`: (64, 12), a row for each mover at the last evaluation, then
    NaN: x, y, vx, vy, mean ax, ay, mean square acceleration (-1: unknown), largest speed so far,
    time since it was last faster than `_WALKING_SPEED`, for how long it has been in all, and the
    newest ax, ay."""
    return np.full((_MAX_MOVERS, 12), math.nan)


@jit
def updated_history(history: Floats, obstacles: Surroundings, period: float) -> Floats:
    """The moving discs with their accelerations, columns as in `empty_mover_history`."""
    out = np.empty((min(len(obstacles.discs), _MAX_MOVERS), 12))
    n = 0
    for i in range(len(obstacles.discs)):
        d = obstacles.discs[i]
        if n == len(out) or not math.hypot(d[VX], d[VY]) > 0.0:  # nor for NaN
            continue
        row = out[n]
        row[0], row[1], row[2], row[3] = d[X], d[Y], d[VX], d[VY]
        row[4], row[5], row[6], row[7] = 0.0, 0.0, -1.0, math.hypot(d[VX], d[VY])
        walks = row[7] > _WALKING_SPEED
        row[8], row[9] = (0.0, period) if walks else (math.inf, 0.0)
        row[10], row[11] = 0.0, 0.0
        best, match = _GATE, -1
        for j in range(len(history)):
            far = math.hypot(
                history[j, 0] + period * history[j, 2] - d[X],
                history[j, 1] + period * history[j, 3] - d[Y],
            )
            if far < best:
                best, match = far, j
        if match >= 0:
            most = max(obstacles.max_acceleration[i], 0.0)
            ax, ay = (
                (d[VX] - history[match, 2]) / period,
                (d[VY] - history[match, 3]) / period,
            )
            magnitude = math.hypot(ax, ay)
            share = min(1.0, most / magnitude) if magnitude > 0.0 else 1.0
            ax, ay = ax * share, ay * share
            gain = (
                1.0
                if history[match, 6] < 0.0 or _new_manoeuvre(history[match], ax, ay, most)
                else _GAIN
            )
            row[10], row[11] = ax, ay
            row[4] = history[match, 4] + gain * (ax - history[match, 4])
            row[5] = history[match, 5] + gain * (ay - history[match, 5])
            row[6] = max(history[match, 6], 0.0)
            row[6] += gain * (ax * ax + ay * ay - row[6])
            row[7] = max(row[7], history[match, 7])
            row[8] = min(row[8], history[match, 8] + period)
            row[9] += history[match, 9]
        n += 1
    return out[:n]


@jit_inline
def _new_manoeuvre(previous: Floats, ax: float, ay: float, most: float) -> bool:
    """Whether a known walker accelerates strongly and as at the evaluation before, which makes
    older accelerations obsolete. most: its max_acceleration [m/s^2]."""
    larger = max(ax * ax + ay * ay, previous[10] * previous[10] + previous[11] * previous[11])
    strong = larger > _STRONG * _STRONG * most * most
    agree = ax * previous[10] + ay * previous[11] > _AGREE * larger
    return previous[9] > _MIN_WALKING_TIME and previous[8] < _RECENT and strong and agree


@jit
def relevant_movers(
    obstacles: Surroundings, history: Floats, pose: Pose, reach: float, limits: Limits,
    e: EvasionParams,
) -> tuple[Floats, int]:  # fmt: skip
    """(m, 13), columns as in `EvasionContext.movers`: discs that matter within the horizon; and how
    many of them, the first ones, move or did recently. The others may set off."""
    out = np.empty((2 * len(obstacles.discs), 13))
    n = _write(out, 0, True, obstacles, history, pose, reach, limits, e)
    return out[: _write(out, n, False, obstacles, history, pose, reach, limits, e)], n


@jit
def _write(
    out: Floats, n: int, moving: bool, obstacles: Surroundings, history: Floats, pose: Pose,
    reach: float, limits: Limits, e: EvasionParams,
) -> int:  # fmt: skip
    """Write the moving discs, or the others, from row n on; returns one past the last row."""
    k = 0
    robot_speed = min(e.speed, limits.speed)
    stopping_time = brake_steps(Twist(robot_speed, 0.0), limits, STEP) * STEP
    for i in range(len(obstacles.discs)):
        d = obstacles.discs[i]
        vx, vy = d[VX], d[VY]
        most = obstacles.max_acceleration[i]
        speed, ax, ay = math.hypot(vx, vy), 0.0, 0.0
        top_speed, recently, turning = 0.0, speed > _SLOW, e.turning
        if speed > 0.0:
            if k < len(history):
                lasting = 0.0
                if history[k, 6] > 0.0:  # close to 1 for a steady acceleration, small for noise
                    lasting = min((history[k, 4] ** 2 + history[k, 5] ** 2) / history[k, 6], 1.0)
                walker = history[k, 9] > _MIN_WALKING_TIME
                top_speed = history[k, 7] if walker else 0.0
                recently = recently or (walker and history[k, 8] < _RECENT)
                ax, ay = lasting * history[k, 4], lasting * history[k, 5]
            k += 1
        if is_static(obstacles, i):
            continue
        if recently != moving:
            continue
        far = math.hypot(d[X] - pose.x, d[Y] - pose.y) - d[RADIUS] - reach
        if not far < (speed + e.speed) * e.horizon + e.social_clearance:
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
                back = min(speed / e.turning - braking, 0.0) / speed
                ax, ay = ax - back * vx, ay - back * vy
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = d[X], d[Y], vx, vy
        out[n, 4], out[n, 5], out[n, 12] = (
            d[RADIUS], most, obstacles.velocity_error[i],
        )  # fmt: skip
        out[n, 6] = e.standing_growth
        if moving:
            out[n, 6] = min(e.moving_growth + e.growth_per_speed * speed, e.most_growth)
        out[n, 7], out[n, 8], out[n, 9], out[n, 10] = ax, ay, turning, _TOP_SPEED_FACTOR * top_speed
        set_off_acceleration = min(most, e.sets_off_acceleration)
        distance = reach + d[RADIUS] + 0.5 * set_off_acceleration * stopping_time * stopping_time
        out[n, 11] = min(
            _DETECTION_TIME + distance / max(robot_speed, 1e-3) + 0.5 * stopping_time, e.horizon
        )
        n += 1
        if e.pass_right > 0.0 and far < math.inf:
            out[n] = out[n - 1]
            away = math.hypot(d[X] - pose.x, d[Y] - pose.y)
            share = e.pass_right / max(away, 1e-9)
            out[n, 0] -= share * (d[Y] - pose.y)
            out[n, 1] += share * (d[X] - pose.x)
            n += 1
    return n
