"""Accuracy of the loop edges of the Killian Court log as a reference for maps: they err, too.

An edge is a published match of two scans. Two edges from one scan to two others a few steps apart
give the motion between these, and so do the sequential edges: the difference is a contradiction.
And a scan, placed by an edge or by a map, either lies on the points seen around the other scan or
does not. Where one scan shows too little, all that was seen around both may decide.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.frames import between
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.pose_graph import Link, solved
from cohelm.perceive.match.scan_matching import MatchParams, align
from cohelm.perceive.match.surfaces import (
    FlatPoints,
    Surfaces,
    flat_points,
    moved,
    seen_from,
    surfaces,
    thinned,
)
from tests.perceive.killian import Log

_NEAR = 3  # steps between two scans that one edge each leads to
_AROUND = 10  # scans before and after one that belong to its surroundings
_FAR = 15.0  # points farther away are left out, as in mapping [m]
_FIRM = 5e3  # information of a match that is known in every direction [1/m^2]
_SUBMAP = 8  # scans before and after one that are laid on those around another
_CLEAR = 8.0  # points nearer than this are, since those farther away are sparse [m]
_REACH, _SHIFT = 2.0, 0.025  # along the direction that is seen least, and its step [m]
_ELSEWHERE = 0.2  # shifts farther apart are different places [m]
_RASTER = 0.02  # of distances from the points [m]
_HELD = np.diag([1e8, 1e8, 1e8])


def contradictions(log: Log) -> Floats:
    """(n, 2): difference of the second of two edges from one scan to the first one and the
    sequential edges, along the heading and across [m]. The error of one edge is 1/sqrt(2) of it."""
    off: list[tuple[float, float]] = []
    for a in sorted({a for a, _, _ in log.loops}):
        own = sorted((b, pose) for first, b, pose in log.loops if first == a)
        for (b, one), (c, other) in pairwise(own):
            if c - b <= _NEAR:
                e = between(between(log.odometry[b], log.odometry[c]), between(one, other))
                off.append((e.x, e.y))
    return np.array(off)


def fits(log: Log, poses: list[Pose]) -> tuple[Floats, Floats]:
    """For each loop edge, rms distance of its second scan's points from those seen around the
    first, as placed by the edge and by `poses`: (n, 2). And distance of these two placements from
    the best match, where that is unique and constrained in every direction: (m, 2) [m]."""
    seen = _seen(log)
    care = MatchParams(rounds=30)
    rms: list[tuple[float, float]] = []
    off: list[tuple[float, float]] = []
    for a, b, edge in log.loops:
        around, guesses = _around(log, seen, a), (edge, between(poses[a], poses[b]))
        held = [align(around, seen[b], guess, _HELD, care).rms for guess in guesses]
        rms.append((held[0], held[1]))
        loose = np.diag([25.0, 25.0, 100.0])
        best = [align(around, seen[b], guess, loose, care) for guess in guesses]
        apart = between(best[0].pose, best[1].pose)
        firm = min(np.linalg.eigvalsh(fit.information[:2, :2])[0] for fit in best) > _FIRM
        if firm and np.hypot(apart.x, apart.y) < 0.03:
            ways = [between(fit.pose, guess) for fit, guess in zip(best, guesses, strict=True)]
            off.append((float(np.hypot(*ways[0][:2])), float(np.hypot(*ways[1][:2]))))
    return np.array(rms), np.array(off)


def unseen(log: Log, poses: list[Pose]) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, 2): by how much each loop edge and `poses` differ in the direction in which its second
    scan sees least, as along a corridor, and in the other one [m]. And whether it is constrained in
    every direction."""
    seen = _seen(log)
    apart: list[Floats] = []
    firm: list[bool] = []
    for a, b, edge in log.loops:
        here = between(poses[a], poses[b])
        fit = align(_around(log, seen, a), seen[b], here, _HELD, MatchParams(rounds=30))
        information, axes = np.linalg.eigh(fit.information[:2, :2])
        apart.append(np.abs(np.array([here.x - edge.x, here.y - edge.y]) @ axes))
        firm.append(bool(information[0] > _FIRM))
    return np.array(apart), np.array(firm)


class Decided(NamedTuple):
    """For each loop edge, where the scans around both fit best, along the direction in which its
    second scan sees least. edge, ours: (n,), off that place [m]. lead: (n,), share of the points
    that fit there and at no place elsewhere. total: (n,), of the edge off ours, in both directions
    [m]."""

    edge: Floats
    ours: Floats
    lead: Floats
    total: Floats


def decided(log: Log, poses: list[Pose]) -> Decided:
    """The edges and a map, beside what all scans around both ends of an edge show together.

    Every point counts, also where walls end and step back, which both see that drive opposite ways.
    Scans are put together by the sequential edges.
    """
    seen = _seen(log)
    rows: list[tuple[float, ...]] = []
    for a, b, edge in log.loops:
        here = between(poses[a], poses[b])
        fit = align(_around(log, seen, a), seen[b], here, _HELD, MatchParams(rounds=30))
        axis = np.linalg.eigh(fit.information[:2, :2])[1][:, 0]
        shifts, share = _along(_cloud(log, a), _cloud(log, b), here, axis)
        best = int(share.argmax())
        elsewhere = np.abs(shifts - shifts[best]) > _ELSEWHERE
        off = np.array([edge.x - here.x, edge.y - here.y])
        rows.append((
            float(off @ axis) - shifts[best], -shifts[best],
            share[best] - share[elsewhere].max(), float(np.hypot(*off)),
        ))  # fmt: skip
    return Decided(*np.array(rows).T)


def _along(known: Floats, points: Floats, guess: Pose, axis: Floats) -> tuple[Floats, Floats]:
    """Shifts of the points along an axis [m], and the share of them that fits at each."""
    low = known.min(axis=0) - 0.5
    size = np.ceil((known.max(axis=0) + 0.5 - low) / _RASTER).astype(int)
    empty = np.full(size, True)
    empty[tuple(((known - low) / _RASTER).astype(int).T)] = False
    gap = _RASTER * scipy.ndimage.distance_transform_edt(empty)
    fits = np.exp(-0.5 * (gap / 0.05) ** 2)
    shifts = np.arange(-_REACH, _REACH + 0.5 * _SHIFT, _SHIFT)
    share = np.zeros(len(shifts))
    for turn in (-0.006, 0.0, 0.006):
        placed = moved(guess._replace(psi=guess.psi + turn), points, True)
        for beside in (-0.05, -0.025, 0.0, 0.025, 0.05):
            sideways = beside * np.array([-axis[1], axis[0]])
            cells = ((placed + shifts[:, None, None] * axis + sideways - low) / _RASTER).astype(int)
            inside = ((cells >= 0) & (cells < size)).all(axis=2)
            cells[~inside] = 0
            found = np.where(inside, fits[cells[..., 0], cells[..., 1]], 0.0).mean(axis=1)
            share = np.maximum(share, found)
    return shifts, share


def _cloud(log: Log, a: int) -> Floats:
    """All points near the scans around scan a, in its frame, one of each cell of 3 cm."""
    near = range(max(0, a - _SUBMAP), min(len(log.seen), a + _SUBMAP + 1))
    every: list[Floats] = []
    for i in near:
        points = log.seen[i].points
        clear = points[np.hypot(*points.T) < _CLEAR]
        every.append(moved(between(log.odometry[a], log.odometry[i]), clear, True))
    points = np.vstack(every)
    first = np.unique(np.round(points / 0.03).astype(int), axis=0, return_index=True)[1]
    return points[first]


def among_themselves(log: Log, folds: int = 5) -> tuple[Floats, Floats]:
    """(n,): how far each loop edge is off the poses that satisfy all published edges best, and off
    those that satisfy all but one fold of the loop edges, to which it belongs [m]."""
    every = np.diag([500.0, 500.0, 5000.0])  # as published, for nearly all
    chain = zip(log.odometry, log.odometry[1:], strict=False)
    steps = [Link(k, k + 1, between(a, b), every, False) for k, (a, b) in enumerate(chain)]
    loops = [Link(a, b, edge, every, False) for a, b, edge in log.loops]

    def off(poses: list[Pose], some: list[Link]) -> list[float]:
        ways = [between(link.pose, between(poses[link.a], poses[link.b])) for link in some]
        return [float(np.hypot(way.x, way.y)) for way in ways]

    whole = off(solved(log.poses, [*steps, *loops]), loops)
    fold = np.random.default_rng(0).permutation(len(loops)) % folds
    held_out = np.empty(len(loops))
    for one in range(folds):
        kept = [link for link, f in zip(loops, fold, strict=True) if f != one]
        left = [link for link, f in zip(loops, fold, strict=True) if f == one]
        held_out[fold == one] = off(solved(log.poses, [*steps, *kept]), left)
    return np.array(whole), held_out


def _seen(log: Log) -> list[FlatPoints]:
    """Points of each scan with their normals."""
    seen: list[FlatPoints] = []
    for sweep in log.seen:
        near = np.hypot(*sweep.points.T) < _FAR
        seen.append(flat_points(sweep.points[near], sweep.beams[near], log.lidar))
    return seen


def _around(log: Log, seen: list[FlatPoints], a: int) -> Surfaces:
    """Points of the scans around scan a, in its frame, by the sequential edges."""
    near = range(max(0, a - _AROUND), min(len(seen), a + _AROUND + 1))
    ways = [between(log.odometry[a], log.odometry[i]) for i in near]
    placed = [seen_from(way, seen[i]) for way, i in zip(ways, near, strict=True)]
    flat = FlatPoints(*(np.vstack(parts) for parts in zip(*placed, strict=True)))
    return surfaces(thinned(flat, 0.04), 0.05, 0.65)
