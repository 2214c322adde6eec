"""Remembers movers that have left the view of a LiDAR that does not look all round.

Each is a track without measurements, predicted as any other. It is deleted when a mover comes out
of unobserved ground near enough to be the same object, or after a while.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import DeskewedScan, within_view
from cohelm.perceive.track.params import PotentiallyDynamicParams
from cohelm.perceive.track.potentially_dynamic import LX, LY, STOOD
from cohelm.perceive.track.track import (
    COLUMNS,
    KPP,
    KPV,
    KVV,
    KVX,
    KVY,
    KX,
    KY,
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
    keep_as_seen,
    predict,
)
from cohelm.robot.sensors import Lidar

KEEP = 10.0
"""A mover out of view is remembered for so long [s]."""

HX, HY, HVX, HVY, REACH, UNSEEN = range(6)
"""Columns of movers out of view: position if it kept its velocity [m], that velocity [m/s], bound
of the distance from that position, with uncertainty, acceleration and radius [m], time since it was
in view [s]."""

BX, BY, B_HALF, B_EDGE, B_STOOD = range(5)
"""Columns of clusters of potentially dynamic points: middle and half the extent [m], distance of
the nearest point from the edge of the view [m], whether all of it has stood (1) or not (0)."""

_DEVIATIONS = 2.0  # standard deviations of a predicted position
_EDGE = 0.15  # an object as near to the edge of the view may be out of it at the next scan [m]
_SAME = 0.3  # association gate of clusters between scans [m]


def departed(
    before: Floats, dropped: Floats, new_movers: Floats, points: Floats,
    sweeps: tuple[DeskewedScan, ...], dt: float, max_acceleration: float,
    dynamic: PotentiallyDynamicParams,
) -> Floats:  # fmt: skip
    """Movers out of view after a sweep, (g, COLUMNS), as in `track`.

    before: those after the sweep before, dt [s] ago. dropped, new_movers: tracks that were dropped
    at this sweep, and tracks found to move at it. points: as in `potentially_dynamic`. sweeps: the
    newest, oldest first.
    """
    if not (len(before) or len(dropped) or len(points)):
        return before
    stamps = np.array([sweep.stamp for sweep in sweeps])
    sensors = np.array([sweep.sensor for sweep in sweeps])
    return _departed(
        before, dropped, new_movers, points, sweeps[-1].lidar, stamps, sensors, dt,
        max_acceleration, dynamic,
    )  # fmt: skip


@jit
def _departed(
    before: Floats, dropped: Floats, new_movers: Floats, points: Floats, lidar: Lidar,
    stamps: Floats, sensors: Floats, dt: float, max_acceleration: float,
    dynamic: PotentiallyDynamicParams,
) -> Floats:  # fmt: skip
    sensor = Pose(sensors[-1, 0], sensors[-1, 1], sensors[-1, 2])
    clusters = _clusters(points, lidar, sensor)
    out = np.zeros((len(before) + len(dropped) + len(clusters), COLUMNS))
    n = 0
    for i in range(len(before)):
        if before[i, MISSED] + dt < KEEP and not _seen_again(before[i], clusters):
            out[n] = before[i]
            predict(out[n], dt, max_acceleration)
            out[n, MISSED] += dt
            n += 1
    for i in range(len(dropped)):
        if within_view(lidar, sensor, dropped[i, TX], dropped[i, TY]) < dropped[i, RADIUS] + _EDGE:
            out[n] = dropped[i]
            out[n, MOVES] = 1.0
            n += 1
    kept = np.ones(len(out), np.bool_)
    for j in range(len(new_movers)):
        for i in range(n):
            kept[i] = kept[i] and not _same_object(out[i], new_movers[j], dt)
        index = _reappeared(out[:n], kept, new_movers[j], lidar, stamps, sensors, dt)
        if index >= 0:
            kept[index] = False
    for k in range(len(clusters)):
        if clusters[k, B_EDGE] < _EDGE:
            speed = dynamic.creeping if clusters[k, B_STOOD] > 0.0 else dynamic.fastest
            out[n, TX], out[n, TY], out[n, MOVES] = clusters[k, BX], clusters[k, BY], 1.0
            out[n, PP] = (clusters[k, B_HALF] / _DEVIATIONS) ** 2
            out[n, VV] = (speed / _DEVIATIONS) ** 2
            keep_as_seen(out[n])
            n += 1
    return out[:n][kept[:n]]


@jit
def _clusters(points: Floats, lidar: Lidar, sensor: Pose) -> Floats:
    """The potentially dynamic points of a sweep in clusters, (b, 5), columns from `BX` on:
    neighbours no farther apart than `_SAME`."""
    out, n = np.empty((len(points), 5)), 0
    low, high = np.zeros(2), np.zeros(2)
    for k in range(len(points)):
        x, y, stood = points[k, LX], points[k, LY], points[k, STOOD]
        edge = within_view(lidar, sensor, x, y)
        if k > 0 and math.hypot(x - points[k - 1, LX], y - points[k - 1, LY]) < _SAME:
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
def _same_object(track: Floats, new: Floats, dt: float) -> bool:
    """Whether a remembered cluster belongs to a new mover, which was in view at the same time."""
    distance = math.hypot(track[TX] - new[TX], track[TY] - new[TY])
    near = distance < _reach(track) + new[RADIUS]
    return near and track[RADIUS] == 0.0 and track[MISSED] < new[SEEN] * dt


@jit_inline
def _seen_again(track: Floats, clusters: Floats) -> bool:
    if track[RADIUS] > 0.0:
        return False
    for k in range(len(clusters)):
        distance = math.hypot(clusters[k, BX] - track[TX], clusters[k, BY] - track[TY])
        if distance < clusters[k, B_HALF] + _SAME:
            return True
    return False


@jit
def _reappeared(
    departed_tracks: Floats, kept: NDArray[np.bool_], new: Floats, lidar: Lidar,
    stamps: Floats, sensors: Floats, dt: float,
) -> int:  # fmt: skip
    """The index of the mover out of view that a new mover is taken for: the nearest within its
    bound, if the new one was first seen at the edge of the view, or came into view as the robot
    turned; else -1."""
    ago = new[SEEN] * dt
    x, y = new[TX] - ago * new[TVX], new[TY] - ago * new[TVY]
    index, best = -1, 1.0
    k = int(np.argmin(np.abs(stamps - (stamps[-1] - ago))))
    edge = math.inf
    for j in range(max(k - 1, 0), k + 1):
        then = Pose(sensors[j, 0], sensors[j, 1], sensors[j, 2])
        edge = min(edge, within_view(lidar, then, x, y))
    if edge > new[RADIUS] + 2.0 * _EDGE:
        return index
    for i in range(len(departed_tracks)):
        distance = math.hypot(departed_tracks[i, TX] - x, departed_tracks[i, TY] - y) / (
            _reach(departed_tracks[i]) + new[RADIUS]
        )
        if kept[i] and distance < best:
            index, best = i, distance
    return index


@jit_inline
def _reach(track: Floats) -> float:
    """Bound of the distance of a track from its position, with its radius [m]."""
    return track[RADIUS] + _DEVIATIONS * math.sqrt(track[PP])


def out_of_view(tracks: Floats, departed_tracks: Floats, max_acceleration: float) -> Floats:
    """Movers that may be on unobserved ground, (h, 6), columns from `HX` on: of tracks
    (t, COLUMNS) that move or may, and of departed ones."""
    those = np.vstack((tracks, departed_tracks))
    out = np.empty((len(those), 6))
    t = out[:, UNSEEN] = those[:, MISSED]
    out[:, HX : HY + 1] = those[:, KX : KY + 1] + t[:, None] * those[:, KVX : KVY + 1]
    out[:, HVX : HVY + 1] = those[:, KVX : KVY + 1]
    # Not PP: it has the acceleration, as noise, that the last term bounds.
    variance = those[:, KPP] + 2.0 * t * those[:, KPV] + t * t * those[:, KVV]
    out[:, REACH] = those[:, RADIUS] + _DEVIATIONS * np.sqrt(variance)
    out[:, REACH] += 0.5 * max_acceleration * t * t
    return out
