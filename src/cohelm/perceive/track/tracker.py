"""Tracks moving obstacles from scan to scan, with their velocities.

A thing moves if it stands where it was free to see a moment ago, or if where it stood can be seen
free now. A change of shape, as of a corner that comes into view, does neither.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import placed
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.clusters import (
    CX,
    CY,
    FIRST,
    LAST,
    SIZE,
    Look,
    clusters,
    freshen,
    looked,
    was_free,
)
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.perceive.space.free_space_memory import PERHAPS, SURELY, Ground, noted, unknown
from cohelm.perceive.track.departed import departed, out_of_view
from cohelm.perceive.track.potentially_dynamic import (
    NEAR,
    Wary,
    came_by_itself,
    covers,
    loose,
    spread,
    wild,
)
from cohelm.perceive.track.proof import prove
from cohelm.perceive.track.rim_fit import rim_distance
from cohelm.perceive.track.track import (
    CALM,
    COLUMNS,
    GONE,
    MISSED,
    MOVES,
    NEW,
    PP,
    PROOF,
    RADIUS,
    RR,
    SEEN,
    SINCE,
    TAX,
    TAY,
    TVX,
    TVY,
    TX,
    TY,
    VV,
    no_tracks,
    noted_ends,
    predicted,
)
from cohelm.perceive.track.update import UNSURE, centre_variance, is_rim, known, then, updated
from cohelm.robot.sensors import Lidar

_BLIND = Look(np.empty(0), Pose(0.0, 0.0, 0.0), -math.inf)


class TrackerParams(NamedTuple):
    """How movers are told."""

    max_acceleration: float = 1.0
    """How fast they may change their velocity [m/s^2], for the filter and for the guard."""
    scatter: float = 0.05
    """Standard deviation of a cluster's centre [m]."""
    slowest: float = 0.1
    """What moves slower, stands [m/s]."""
    proof: int = 3
    """Scans that must prove it moves; up to twice as many are remembered."""
    calm: float = 3.0
    """Who has moved, and stands, may walk on, and stays a mover for so long [s]; whose radius is
    known, `wary.keep`."""
    keep: float = 1.5
    """Hidden, a mover is foreseen for so long [s]."""
    back: tuple[float, ...] = (0.45, 0.95, 1.4)
    """Sweeps so old are asked what was free then [s]."""
    wider: float = 0.03
    """Added to a mover's radius, beside one standard deviation of its place [m]."""
    body: float = 0.12
    """What is wider than this is told from the first scan that proves it [m, radius]."""
    unsure: float = 1.0
    """So many standard deviations its velocity may be off."""
    wary: Wary = Wary()
    """Of things that may set off."""


class Movers(NamedTuple):
    """tracks: (t, n) as in `track`. looks: earlier sweeps, oldest first. mine: (m,) of the newest
    sweep's points, whether it belongs to a mover. ground: near the robot. worn: its clock [s].
    loose: (l, 3) as in `potentially_dynamic`. covered: whether somebody is within the LiDAR's
    least range. gone: who has left the view, as in `departed`."""

    tracks: Floats
    looks: tuple[Look, ...]
    stamp: float
    mine: np.ndarray[tuple[int], np.dtype[np.bool_]]
    ground: Ground
    worn: float
    loose: Floats
    covered: bool
    gone: Floats


NONE = Movers(
    no_tracks(), (), -math.inf, np.zeros(0, np.bool_), unknown(), 0.0, np.empty((0, 3)),
    False, no_tracks(),
)  # fmt: skip


def follow(
    before: Movers, lidar: Lidar, sweep: DeskewedScan, pose: Pose, stamp: float,
    care: TrackerParams,
    fixed: NDArray[np.bool_] | None = None,
) -> Movers:  # fmt: skip
    """The movers after a sweep from an `odom` pose at `stamp` [s].

    fixed: (m,) which of its points are on what surely stands, as a map says: who walks past that
    is not taken for one thing with it.
    """
    if fixed is None:
        fixed = np.zeros(len(sweep.points), np.bool_)
    dt = min(max(stamp - before.stamp, 0.0), 1.0) if before.looks else 0.0
    found = clusters(lidar, sweep, pose, lidar.range_max, fixed)
    for back in care.back:
        earlier = _look(before.looks, stamp - back)
        if earlier is not None:
            freshen(lidar, found, sweep, pose, earlier)
    now = looked(lidar, sweep, pose, stamp)
    places = placed(sweep.points, pose)
    tracks, whose, lost, came = _followed(before.tracks, found, places, lidar, now, dt, care)
    mine = _owned(tracks, whose, found, sweep, pose) & ~fixed
    kept = tuple(look for look in before.looks if stamp - look.stamp < max(care.back) + 0.2)
    covered = any(covers(lidar, now, look, before.covered) for look in (*kept, _BLIND))
    first, second = (_look(before.looks, stamp - back) or _BLIND for back in care.back[-2:])
    wary, worn = care.wary, before.worn + dt
    if before.looks:
        way = math.dist(before.looks[-1].sensor[:2], now.sensor[:2])
        worn += way * wary.keep / wary.vouched
    near = (np.hypot(sweep.points[:, 0], sweep.points[:, 1]) < NEAR) & ~mine & ~fixed
    since = worn - wary.keep
    there = came_by_itself(places, near, before.ground, since, now, lidar.noise)
    ground = noted(before.ground, lidar, now, places[~mine & (there == 0)], worn)
    may = loose(lidar, places, there >= PERHAPS, first, second)
    leaves = loose(lidar, places, there == SURELY, first, second)
    if covered:
        here = (now.sensor.x, now.sensor.y, 1.0)
        may, leaves = np.vstack((may, here)), np.vstack((leaves, here))
    kept = (*kept, now)
    # a wall where somebody may be does not leave the view as somebody: the doubt would never end
    gone = departed(before.gone, lost, came, leaves, lidar, kept, dt, care.max_acceleration, wary)
    return Movers(tracks, kept, stamp, mine, ground, worn, may, covered, gone)


def _look(looks: tuple[Look, ...], when: float) -> Look | None:
    """The sweep of about that time, if there is one."""
    if not looks:
        return None
    nearest = min(looks, key=lambda look: abs(when - look.stamp))
    return nearest if abs(when - nearest.stamp) < 0.2 else None


def bodies(movers: Movers, now: float, care: TrackerParams) -> tuple[Floats, Floats]:
    """The moving discs (n, 6) foretold to `now` [s], in `odom`, and by how much their velocities
    may be off (n,) [m/s].

    With bodies that perhaps move, by one scan so far: those are told in good time, and count as
    standing as well; edges and noise are thinner.
    """
    t = _moving(movers.tracks, care)
    if not len(t):
        return np.empty((0, 6)), np.empty(0)
    ahead = _ahead(movers, now)
    discs = np.zeros((len(t), 6))
    push = t[:, TAX : TAY + 1]
    discs[:, :2] = t[:, TX : TY + 1] + ahead * t[:, TVX : TVY + 1] + 0.5 * ahead * ahead * push
    discs[:, 2:4] = t[:, TVX : TVY + 1] + ahead * push
    off = np.minimum(care.unsure * np.sqrt(t[:, VV]), care.wary.fastest)
    more, off = spread(off, care.max_acceleration, ahead)
    discs[:, 4] = t[:, RADIUS] + care.wider + np.minimum(np.sqrt(t[:, PP]), 0.3) + more
    discs[:, 5] = discs[:, 4]
    return discs, off


@jit
def _moving(tracks: Floats, care: TrackerParams) -> Floats:
    """Those that move, and those that perhaps do."""
    may = np.zeros(len(tracks), np.bool_)
    for i in range(len(tracks)):
        may[i] = _may_move(tracks[i], care)
    return tracks[may]


@jit_inline
def _may_move(one: Floats, care: TrackerParams) -> bool:
    """Whether it moves, or perhaps does and is no edge or noise."""
    return one[MOVES] > 0.0 or (one[PROOF] > 0.0 and one[RADIUS] > care.body)


def hidden(movers: Movers, care: TrackerParams) -> Floats:
    """Who may be where the LiDAR does not look, at the newest sweep, as `out_of_view` tells."""
    return out_of_view(_moving(movers.tracks, care), movers.gone, care.max_acceleration)


def strays(movers: Movers, now: float, care: TrackerParams) -> tuple[Floats, Floats]:
    """What is loose at `now` [s]: discs that may go anywhere, (l, 6), and how fast (l,) [m/s]."""
    if not len(movers.loose):
        return np.empty((0, 6)), np.empty(0)
    return wild(movers.loose, _ahead(movers, now), care.max_acceleration, care.wary)


def _ahead(movers: Movers, now: float) -> float:
    """How far from the newest sweep on is foretold [s]."""
    return min(max(now - movers.stamp, 0.0), 1.0) if movers.looks else 0.0


@jit
def _followed(
    tracks: Floats, found: Floats, places: Floats, lidar: Lidar, now: Look, dt: float,
    care: TrackerParams,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """The tracks after these clusters of a sweep's points in `odom`, `places`; the track of each
    cluster (k,); tracks that moved, or perhaps did, and are dropped; and those that are found to
    move by this sweep."""
    t, k = len(tracks), len(found)
    out = np.zeros((t + k, COLUMNS))
    out[:t] = tracks
    for i in range(t):
        one = out[i]
        predicted(one, dt, care.max_acceleration)
        one[MISSED] += dt
        one[SINCE] += dt
        one[CALM] += dt
    whose = np.full(k, -1.0)
    taken = np.zeros(t, np.bool_)
    while True:
        best, bi, bj = 9.0, -1, -1
        for j in range(k):
            if whose[j] >= 0.0:
                continue
            for i in range(t):
                if taken[i]:
                    continue
                x, y = then(out[i], found[j])
                d = math.hypot(found[j, CX] - x, found[j, CY] - y)
                if d > 0.6:
                    continue
                if is_rim(out[i], found[j]):
                    d = rim_distance(_seen(places, found[j]), x, y, out[i, RADIUS])
                    cost = d * d / (care.scatter * care.scatter + out[i, PP])
                else:
                    wide = centre_variance(found[j], care.scatter) + out[i, PP]
                    cost = d * d / wide + 4.0 * abs(found[j, SIZE] - out[i, RADIUS])
                if cost < best:
                    best, bi, bj = cost, i, j
        if bi < 0:
            break
        whose[bj], taken[bi] = bi, True
        seen = _seen(places, found[bj])
        updated(
            out[bi], found[bj], seen, lidar, now, care.scatter, care.max_acceleration
        )  # fmt: skip
        calm = care.wary.keep if known(out[bi]) else care.calm
        prove(
            out[bi], found[bj], seen, lidar, now, care.slowest, care.proof, calm,
            care.max_acceleration,
        )  # fmt: skip
    n = t
    for j in range(k):
        if whose[j] < 0.0 and not _within_mover(out, t, found[j]):
            out[n, TX], out[n, TY], out[n, RADIUS] = found[j, CX], found[j, CY], found[j, SIZE]
            out[n, PP], out[n, VV] = centre_variance(found[j], care.scatter), NEW
            out[n, SEEN] = 1.0
            noted_ends(out[n], _seen(places, found[j]))
            out[n, RR] = UNSURE * UNSURE
            whose[j] = n
            n += 1
    kept, lost, came = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for i in range(n):
        kept[i] = _stays(out[i], lidar, now, care)
        lost[i] = not kept[i] and _may_move(out[i], care)
        came[i] = out[i, MOVES] > 0.0 and (i >= t or tracks[i, MOVES] == 0.0)
    number = np.cumsum(kept) - 1
    for j in range(k):
        if whose[j] >= 0.0:
            i = int(whose[j])
            whose[j] = number[i] if kept[i] else -1.0
    return out[:n][kept], whose, out[:n][lost], out[:n][came]


@jit
def _seen(places: Floats, cluster: Floats) -> Floats:
    """The points of a cluster."""
    return places[int(cluster[FIRST]) : int(cluster[LAST])]


@jit
def _within_mover(tracks: Floats, t: int, cluster: Floats) -> bool:
    """Whether a cluster without a track is a piece of a mover."""
    for i in range(t):
        if tracks[i, MOVES] > 0.0:
            d = math.hypot(cluster[CX] - tracks[i, TX], cluster[CY] - tracks[i, TY])
            if d < tracks[i, RADIUS] + 0.1:
                return True
    return False


@jit
def _stays(one: Floats, lidar: Lidar, now: Look, care: TrackerParams) -> bool:
    """Whether a track is kept: seen now, or a mover that may be hidden."""
    if one[MISSED] == 0.0:
        return True
    if one[MOVES] == 0.0:
        return one[MISSED] < 0.25
    wx, wy = one[TX] - now.sensor.x, one[TY] - now.sensor.y
    far = max(math.hypot(wx, wy), 1e-6)
    beyond = 1.0 + (one[RADIUS]) / far
    if was_free(lidar, now, now.sensor.x + beyond * wx, now.sensor.y + beyond * wy, 0.0):
        one[GONE] += 1.0
    return one[GONE] < 3.0 and one[MISSED] < care.keep


@jit
def _owned(
    tracks: Floats, whose: Floats, found: Floats, sweep: DeskewedScan, pose: Pose
) -> np.ndarray:  # fmt: skip
    """Which points of the sweep are a mover's: those of its cluster, and any within its disc."""
    mine = np.zeros(len(sweep.points), np.bool_)
    for j in range(len(found)):
        i = int(whose[j])
        if i >= 0 and tracks[i, MOVES] > 0.0:
            mine[int(found[j, FIRST]) : int(found[j, LAST])] = True
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(tracks)):
        if tracks[i, MOVES] == 0.0:
            continue
        reach = tracks[i, RADIUS] + 0.05
        for p in range(len(mine)):
            x = pose.x + c * sweep.points[p, 0] - s * sweep.points[p, 1]
            y = pose.y + s * sweep.points[p, 0] + c * sweep.points[p, 1]
            dx, dy = x - tracks[i, TX], y - tracks[i, TY]
            if dx * dx + dy * dy < reach * reach:
                mine[p] = True
    return mine
