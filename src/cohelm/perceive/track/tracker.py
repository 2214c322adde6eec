"""Tracks moving obstacles from scan to scan, with their velocities.

An object moves if it stands where space was seen free a moment ago, or if the space where it stood
is seen free now. A change of shape, as of a corner that comes into view, is neither.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import placed
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats
from cohelm.perceive.scan.clusters import CX, CY, FIRST, LAST, clusters, update_freshness
from cohelm.perceive.scan.deskew import NO_SWEEP, DeskewedScan, was_free
from cohelm.perceive.track.departed import departed, out_of_view
from cohelm.perceive.track.params import TrackerParams
from cohelm.perceive.track.potentially_dynamic import (
    Appeared,
    discs_of_points,
    grown,
    nothing_appeared,
    update_appeared,
)
from cohelm.perceive.track.track import (
    AT_REST,
    COLUMNS,
    ENDS_AGE,
    MISSED,
    MOVES,
    PP,
    PROOF,
    RADIUS,
    SEEN_EMPTY,
    TAX,
    TAY,
    TVX,
    TVY,
    TX,
    TY,
    VV,
    association_cost,
    begin_track,
    no_tracks,
    predict,
    update_proof,
    update_track,
)
from cohelm.robot.sensors import Lidar


class TrackerState(NamedTuple):
    """tracks: (t, n) as in `track`. sweeps: the last ones, oldest first. of_movers: (m,) of the
    newest sweep's points, whether it belongs to a mover. appeared: what may begin to move.
    departed_tracks: movers out of view, as in `departed`."""

    tracks: Floats
    sweeps: tuple[DeskewedScan, ...]
    stamp: float
    of_movers: np.ndarray[tuple[int], np.dtype[np.bool_]]
    appeared: Appeared
    departed_tracks: Floats


def empty_state(lidar: Lidar, params: TrackerParams) -> TrackerState:
    """Of a LiDAR that has not looked yet."""
    appeared = nothing_appeared(lidar, params.dynamic)
    return TrackerState(no_tracks(), (), -math.inf, np.zeros(0, np.bool_), appeared, no_tracks())


_NO_DISCS = np.empty((0, 6)), np.empty((0, 6)), np.empty(0)


def update_tracker(
    before: TrackerState, sweep: DeskewedScan, params: TrackerParams, fixed: NDArray[np.bool_]
) -> TrackerState:
    """The state after a sweep.

    fixed: (m,) which of its points are on walls of a map: they are not merged with a mover that
    passes.
    """
    stamp = sweep.stamp
    dt = min(max(stamp - before.stamp, 0.0), params.longest) if before.sweeps else 0.0
    earlier = [_sweep_at(before.sweeps, stamp - lookback) for lookback in params.lookback]
    found = clusters(sweep, fixed)
    places = placed(sweep.points, sweep.pose)
    for one in earlier:
        if one is not None:
            update_freshness(found, places, one)
    tracks, track_of, dropped, new_movers = _updated_tracks(
        before.tracks, found, places, sweep, dt, params
    )
    of_movers = _mover_points(tracks, track_of, found, places) & ~fixed
    kept = tuple(one for one in before.sweeps if stamp - one.stamp < max(params.lookback) + 0.2)
    way = math.dist(before.sweeps[-1].sensor[:2], sweep.sensor[:2]) if before.sweeps else 0.0
    stood = [one or NO_SWEEP for one in earlier[-2:]]
    appeared = update_appeared(
        before.appeared, sweep, places, of_movers, fixed, kept, stood, dt, way,
        params.dynamic,
    )  # fmt: skip
    kept = (*kept, sweep)
    # a wall on possibly occupied ground is not remembered as a mover: that would never end
    departed_tracks = departed(
        before.departed_tracks, dropped, new_movers, appeared.certain, kept, dt,
        params.max_acceleration, params.dynamic,
    )  # fmt: skip
    return TrackerState(tracks, kept, stamp, of_movers, appeared, departed_tracks)


def _sweep_at(sweeps: tuple[DeskewedScan, ...], when: float) -> DeskewedScan | None:
    """The sweep of about that time, if any."""
    if not sweeps:
        return None
    nearest = min(sweeps, key=lambda sweep: abs(when - sweep.stamp))
    return nearest if abs(when - nearest.stamp) < 0.2 else None


def discs_at(
    tracked: TrackerState, now: float, params: TrackerParams
) -> tuple[Floats, Floats, Floats]:
    """Predicted to `now` [s], in `odom`: discs of the movers (n, 6); all discs for the guard, these
    and behind them those of potentially dynamic points (m, 6); and bounds of the velocity errors of
    all (m,) [m/s]."""
    if not len(tracked.tracks) and not len(tracked.appeared.points):
        return _NO_DISCS
    ahead = min(max(now - tracked.stamp, 0.0), params.longest) if tracked.sweeps else 0.0
    discs, velocity_error = _mover_discs(tracked, ahead, params)
    small, small_error = discs_of_points(
        tracked.appeared.points, ahead, params.max_acceleration, params.dynamic
    )
    return discs, np.vstack((discs, small)), np.concatenate((velocity_error, small_error))


def _mover_discs(
    tracked: TrackerState, ahead: float, params: TrackerParams
) -> tuple[Floats, Floats]:
    """Discs of the movers (n, 6), `ahead` [s] of their sweep, and bounds of their velocity errors
    (n,) [m/s].

    With objects that may move, by one scan so far, unless they are as thin as edges and noise;
    those count as static as well.
    """
    t = _moving(tracked.tracks, params)
    if not len(t):
        return np.empty((0, 6)), np.empty(0)
    discs = np.zeros((len(t), 6))
    push = t[:, TAX : TAY + 1]
    discs[:, :2] = t[:, TX : TY + 1] + ahead * t[:, TVX : TVY + 1] + 0.5 * ahead * ahead * push
    discs[:, 2:4] = t[:, TVX : TVY + 1] + ahead * push
    velocity_error = np.minimum(params.velocity_sigmas * np.sqrt(t[:, VV]), params.dynamic.fastest)
    more, velocity_error = grown(velocity_error, params.max_acceleration, ahead)
    discs[:, 4] = t[:, RADIUS] + params.radius_margin + np.minimum(np.sqrt(t[:, PP]), 0.3) + more
    discs[:, 5] = discs[:, 4]
    return discs, velocity_error


@jit
def _moving(tracks: Floats, params: TrackerParams) -> Floats:
    dynamic_points = np.zeros(len(tracks), np.bool_)
    for i in range(len(tracks)):
        dynamic_points[i] = _may_move(tracks[i], params)
    return tracks[dynamic_points]


@jit_inline
def _may_move(track: Floats, params: TrackerParams) -> bool:
    """Whether it moves, or may and is larger than edges and noise."""
    return track[MOVES] > 0.0 or (track[PROOF] > 0.0 and track[RADIUS] > params.min_body_radius)


def movers_out_of_view(tracked: TrackerState, params: TrackerParams) -> Floats:
    """Movers that may be out of view at the newest sweep, see `out_of_view`."""
    return out_of_view(
        _moving(tracked.tracks, params), tracked.departed_tracks, params.max_acceleration
    )


@jit
def _updated_tracks(
    tracks: Floats, found: Floats, places: Floats, sweep: DeskewedScan, dt: float,
    params: TrackerParams,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """The tracks after these clusters of a sweep's points in `odom`, `places`; the track of each
    cluster (k,); dropped tracks that moved or may have; and tracks found to move by this sweep."""
    t, k = len(tracks), len(found)
    out = np.zeros((t + k, COLUMNS))
    out[:t] = tracks
    for i in range(t):
        track = out[i]
        predict(track, dt, params.max_acceleration)
        track[MISSED] += dt
        track[ENDS_AGE] += dt
        track[AT_REST] += dt
    track_of = np.full(k, -1.0)
    assigned = np.zeros(t, np.bool_)
    while True:
        best, bi, bj = 9.0, -1, -1
        for j in range(k):
            if track_of[j] >= 0.0:
                continue
            for i in range(t):
                if assigned[i]:
                    continue
                points = _points(places, found[j])
                cost = association_cost(out[i], found[j], points, params.scatter)
                if cost < best:
                    best, bi, bj = cost, i, j
        if bi < 0:
            break
        track_of[bj], assigned[bi] = bi, True
        points = _points(places, found[bj])
        update_track(out[bi], found[bj], points, sweep, params)
        update_proof(out[bi], found[bj], points, sweep, params)
    n = t
    for j in range(k):
        if track_of[j] < 0.0 and not _within_mover(out, t, found[j]):
            begin_track(out[n], found[j], _points(places, found[j]), params.scatter)
            track_of[j] = n
            n += 1
    kept, dropped, new_movers = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for i in range(n):
        kept[i] = _is_kept(out[i], sweep, params)
        dropped[i] = not kept[i] and _may_move(out[i], params)
        new_movers[i] = out[i, MOVES] > 0.0 and (i >= t or tracks[i, MOVES] == 0.0)
    number = np.cumsum(kept) - 1
    for j in range(k):
        if track_of[j] >= 0.0:
            i = int(track_of[j])
            track_of[j] = number[i] if kept[i] else -1.0
    return out[:n][kept], track_of, out[:n][dropped], out[:n][new_movers]


@jit
def _points(places: Floats, cluster: Floats) -> Floats:
    return places[int(cluster[FIRST]) : int(cluster[LAST])]


@jit
def _within_mover(tracks: Floats, t: int, cluster: Floats) -> bool:
    """Whether a cluster without a track lies within a mover."""
    for i in range(t):
        if tracks[i, MOVES] > 0.0:
            d = math.hypot(cluster[CX] - tracks[i, TX], cluster[CY] - tracks[i, TY])
            if d < tracks[i, RADIUS] + 0.1:
                return True
    return False


@jit
def _is_kept(track: Floats, sweep: DeskewedScan, params: TrackerParams) -> bool:
    """Whether a track is kept: seen now, or a mover that may be occluded."""
    if track[MISSED] == 0.0:
        return True
    if track[MOVES] == 0.0:
        return track[MISSED] < 0.25
    wx, wy = track[TX] - sweep.sensor.x, track[TY] - sweep.sensor.y
    far = max(math.hypot(wx, wy), 1e-6)
    beyond = 1.0 + (track[RADIUS]) / far
    if was_free(sweep, sweep.sensor.x + beyond * wx, sweep.sensor.y + beyond * wy, 0.0):
        track[SEEN_EMPTY] += 1.0
    return track[SEEN_EMPTY] < 3.0 and track[MISSED] < params.keep


@jit
def _mover_points(
    tracks: Floats, track_of: Floats, found: Floats, places: Floats
) -> NDArray[np.bool_]:  # fmt: skip
    """Which of a sweep's points in `odom` belong to movers: those of their clusters, and within
    their discs."""
    of_movers = np.zeros(len(places), np.bool_)
    for j in range(len(found)):
        i = int(track_of[j])
        if i >= 0 and tracks[i, MOVES] > 0.0:
            of_movers[int(found[j, FIRST]) : int(found[j, LAST])] = True
    for i in range(len(tracks)):
        if tracks[i, MOVES] == 0.0:
            continue
        reach = tracks[i, RADIUS] + 0.05
        for p in range(len(of_movers)):
            dx, dy = places[p, 0] - tracks[i, TX], places[p, 1] - tracks[i, TY]
            if dx * dx + dy * dy < reach * reach:
                of_movers[p] = True
    return of_movers
