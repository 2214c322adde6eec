"""Who has left the view of a LiDAR that does not look all round.

He is remembered as a track that nobody sees: where he is going, and how sure that is, are foretold
as for any other. He is forgotten when somebody comes out of where nothing looks, near enough to be
him, or after a while.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.clusters import Look
from cohelm.perceive.scan.deskew import all_round, beam_at
from cohelm.perceive.track.potentially_dynamic import LX, LY, STOOD, Wary
from cohelm.perceive.track.track import (
    COLUMNS,
    MISSED,
    MOVES,
    PP,
    RADIUS,
    SEEN,
    TVX,
    TVY,
    TX,
    TY,
    VV,
    predicted,
)
from cohelm.robot.sensors import Lidar

KEPT = 10.0
"""Who left the view is remembered for so long [s]."""

HX, HY, HVX, HVY, REACH, UNSEEN = range(6)
"""Columns of those who may be out of view: place [m] and velocity [m/s] that are foretold, how far
from that place he may be, with his own radius, whatever he has done since of what he is capable of
[m], time since he was in view [s]."""

BX, BY, B_HALF, B_EDGE, B_STOOD = range(5)
"""Columns of bodies of loose points: middle and half the extent [m], how far its nearest point is
from the edge of the view [m], whether all of it has stood (1) or not (0)."""

_DEVIATIONS = 2.0  # a foretold place may be off by so many standard deviations
_EDGE = 0.15  # who is as near to where nothing looks may be there at the next scan [m]
_SAME = 0.3  # what is loose is the same as a scan before if it is as near to it [m]


def departed(
    before: Floats, lost: Floats, came: Floats, loose: Floats, lidar: Lidar,
    looks: tuple[Look, ...], dt: float, max_acceleration: float, wary: Wary,
) -> Floats:  # fmt: skip
    """Those out of view after a sweep, tracks as in `track` that nobody sees (g, COLUMNS).

    before: those at the sweep before, dt [s] ago. lost, came: tracks that were dropped at this
    sweep, and those that were found to move at it. loose: as in `potentially_dynamic`. looks: the
    newest sweeps, oldest first.
    """
    if not (len(before) or len(lost) or len(loose)):
        return before
    stamps = np.array([look.stamp for look in looks])
    sensors = np.array([look.sensor for look in looks])
    return _departed(before, lost, came, loose, lidar, stamps, sensors, dt, max_acceleration, wary)


@jit
def _departed(
    before: Floats, lost: Floats, came: Floats, loose: Floats, lidar: Lidar, stamps: Floats,
    sensors: Floats, dt: float, max_acceleration: float, wary: Wary,
) -> Floats:  # fmt: skip
    sensor = Pose(sensors[-1, 0], sensors[-1, 1], sensors[-1, 2])
    bodies = _bodies(loose, lidar, sensor)
    out = np.zeros((len(before) + len(lost) + len(bodies), COLUMNS))
    n = 0
    for i in range(len(before)):
        if before[i, MISSED] + dt < KEPT and not _again(before[i], bodies):
            out[n] = before[i]
            predicted(out[n], dt, max_acceleration)
            out[n, MISSED] += dt
            n += 1
    for i in range(len(lost)):
        if within_view(lidar, sensor, lost[i, TX], lost[i, TY]) < lost[i, RADIUS] + _EDGE:
            out[n] = lost[i]
            out[n, MOVES] = 1.0
            n += 1
    stays = np.ones(len(out), np.bool_)
    for j in range(len(came)):
        for i in range(n):
            stays[i] = stays[i] and not _his(out[i], came[j], dt)
        who = _emerged(out[:n], stays, came[j], lidar, stamps, sensors, dt)
        if who >= 0:
            stays[who] = False
    for k in range(len(bodies)):
        if bodies[k, B_EDGE] < _EDGE:
            speed = wary.creeping if bodies[k, B_STOOD] > 0.0 else wary.fastest
            out[n, TX], out[n, TY], out[n, MOVES] = bodies[k, BX], bodies[k, BY], 1.0
            out[n, PP] = (bodies[k, B_HALF] / _DEVIATIONS) ** 2
            out[n, VV] = (speed / _DEVIATIONS) ** 2
            n += 1
    return out[:n][stays[:n]]


@jit
def _bodies(loose: Floats, lidar: Lidar, sensor: Pose) -> Floats:
    """The loose points of a sweep by bodies, (b, 5) as `BX` and so on: those side by side that are
    no farther apart than `_SAME`."""
    out, n = np.empty((len(loose), 5)), 0
    low, high = np.zeros(2), np.zeros(2)
    for k in range(len(loose)):
        x, y, stood = loose[k, LX], loose[k, LY], loose[k, STOOD]
        edge = within_view(lidar, sensor, x, y)
        if k > 0 and math.hypot(x - loose[k - 1, LX], y - loose[k - 1, LY]) < _SAME:
            edge, stood = min(edge, out[n - 1, B_EDGE]), min(stood, out[n - 1, B_STOOD])
        else:
            low[0] = high[0] = x
            low[1] = high[1] = y
            n += 1
        low[0], low[1] = min(low[0], x), min(low[1], y)
        high[0], high[1] = max(high[0], x), max(high[1], y)
        out[n - 1, BX], out[n - 1, BY] = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
        out[n - 1, B_HALF] = 0.5 * math.hypot(high[0] - low[0], high[1] - low[1])
        out[n - 1, B_EDGE], out[n - 1, B_STOOD] = edge, stood
    return out[:n]


@jit_inline
def _his(one: Floats, came: Floats, dt: float) -> bool:
    """Whether it was the loose points of who is found to move: he was in view when they were."""
    far = math.hypot(one[TX] - came[TX], one[TY] - came[TY])
    near = far < _reach(one) + came[RADIUS]
    return near and one[RADIUS] == 0.0 and one[MISSED] < came[SEEN] * dt


@jit_inline
def _again(one: Floats, bodies: Floats) -> bool:
    """Whether it is something loose that is seen again."""
    if one[RADIUS] > 0.0:
        return False
    for k in range(len(bodies)):
        far = math.hypot(bodies[k, BX] - one[TX], bodies[k, BY] - one[TY])
        if far < bodies[k, B_HALF] + _SAME:
            return True
    return False


@jit
def _emerged(
    gone: Floats, stays: NDArray[np.bool_], came: Floats, lidar: Lidar, stamps: Floats,
    sensors: Floats, dt: float,
) -> int:  # fmt: skip
    """Which of those out of view the one may be that is found to move: the nearest that it may be,
    if it was first seen at the edge of the view, or came into it as the robot turned; -1 for
    nobody."""
    ago = came[SEEN] * dt
    x, y = came[TX] - ago * came[TVX], came[TY] - ago * came[TVY]
    who, best = -1, 1.0
    k = int(np.argmin(np.abs(stamps - (stamps[-1] - ago))))
    edge = math.inf
    for j in range(max(k - 1, 0), k + 1):
        then = Pose(sensors[j, 0], sensors[j, 1], sensors[j, 2])
        edge = min(edge, within_view(lidar, then, x, y))
    if edge > came[RADIUS] + 2.0 * _EDGE:
        return who
    for i in range(len(gone)):
        far = math.hypot(gone[i, TX] - x, gone[i, TY] - y) / (_reach(gone[i]) + came[RADIUS])
        if stays[i] and far < best:
            who, best = i, far
    return who


@jit_inline
def _reach(one: Floats) -> float:
    """How far from its place a track may be, its radius included [m]."""
    return one[RADIUS] + _DEVIATIONS * math.sqrt(one[PP])


def out_of_view(tracks: Floats, gone: Floats, max_acceleration: float) -> Floats:
    """Those who may be where nothing looks, (h, 6): tracks (t, COLUMNS) that move or perhaps do,
    and who departed."""
    those = np.vstack((tracks, gone))
    out = np.empty((len(those), 6))
    out[:, HX : HVY + 1] = those[:, TX : TVY + 1]
    out[:, UNSEEN] = those[:, MISSED]
    out[:, REACH] = those[:, RADIUS] + _DEVIATIONS * np.sqrt(those[:, PP])
    out[:, REACH] += 0.5 * max_acceleration * out[:, UNSEEN] ** 2
    return out


@jit_inline
def in_view(lidar: Lidar, sensor: Pose, x: float, y: float) -> bool:
    """Whether a beam points at an `odom` point, whatever it ends on."""
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    wx, wy = x - sensor.x, y - sensor.y
    return 0 <= beam_at(lidar, c * wx + s * wy, -s * wx + c * wy) < len(lidar.beams)


@jit_inline
def within_view(lidar: Lidar, sensor: Pose, x: float, y: float) -> float:
    """How far an `odom` point is from the edge of a LiDAR's view; 0 where no beam points [m]."""
    if all_round(lidar):
        return math.inf
    if not in_view(lidar, sensor, x, y):
        return 0.0
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    wx, wy = x - sensor.x, y - sensor.y
    bearing = math.atan2(-s * wx + c * wy, c * wx + s * wy)
    if bearing < lidar.first - 0.5 * lidar.step:
        bearing += 2.0 * math.pi
    last = lidar.first + (len(lidar.beams) - 1) * lidar.step
    edge = min(bearing - lidar.first, last - bearing)
    return math.hypot(wx, wy) * math.sin(min(max(edge, 0.0), 0.5 * math.pi))
