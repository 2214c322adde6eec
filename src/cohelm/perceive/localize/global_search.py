"""Branch and bound search of the map for the robot's pose, in slices of a few milliseconds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.match.surfaces import moved

_POINTS = 64
_EACH = 0.2  # one point for each square: a wall counts by its length, not by its beams [m]
_TURNS = 120
_BEST = 4  # headings kept of each block
_TOLERANCE = 0.2  # of a point from its wall, at the spacing of places and headings [m]
_BLOCK = 0.4  # side of a block of places that is scored as one at first [m]
_WITHIN = 0.15  # distance of a place from the middle of its block [m]
_SHARE, _LEAST = 0.15, 200  # share, and least number, of blocks and headings that are refined
_AT_ONCE = 10  # refined in the time of a block
_APART, _TURNED = 0.35, 0.3  # candidates nearer to each other than both are merged [m, rad]


class Search(NamedTuple):
    """points: (t, p, 2), a sweep turned by each heading. places: (n, 2) still as on the map, by
    blocks: those of block b are first[b] up to first[b + 1]. middles: (k, 2). scores: (k, 4) of the
    best headings of each block, turns: (k, 4) which ones. done: blocks scored so far. best: (m,),
    which of those scores are refined, found: (m, 4) score, x, y, heading of the best place there,
    refined: how many so far. The arrays are filled in place."""

    points: Floats
    places: Floats
    first: Ints
    middles: Floats
    scores: Floats
    turns: Ints
    done: int
    best: Ints
    found: Floats
    refined: int

    @property
    def over(self) -> bool:
        """Whether the search is complete."""
        return self.done == len(self.middles) and self.refined == len(self.best)


def search(points: Floats, places: Floats, by_length: bool) -> Search:
    """Begin a search. points: (m, 2) of a sweep in the body frame; places: (k, 2) to score.
    by_length: walls count by their length, not by their beams."""
    if by_length:
        squares = np.floor(points / _EACH).astype(np.int64)
        _, alone = np.unique(squares @ np.array([1 << 20, 1]), return_index=True)
        points = points[np.sort(alone)]
    chosen = points[np.linspace(0, len(points) - 1, min(_POINTS, len(points))).astype(int)]
    turned = np.stack([
        moved(Pose(0.0, 0.0, 2.0 * math.pi * t / _TURNS), chosen, False) for t in range(_TURNS)
    ])  # fmt: skip
    cells = np.floor(places / _BLOCK).astype(np.int64)
    order = np.lexsort(cells.T)
    places, cells = places[order], cells[order]
    new = np.ones(len(places), dtype=bool)
    new[1:] = (np.diff(cells, axis=0) != 0).any(axis=1)
    first = np.append(np.flatnonzero(new), len(places)).astype(np.int64)
    sums = np.add.reduceat(places, first[:-1], axis=0) if len(places) else places
    middles = sums / np.diff(first)[:, None]
    k = len(middles)
    return Search(
        turned, places, first, middles, np.full((k, _BEST), -math.inf),
        np.zeros((k, _BEST), dtype=np.int64), 0, np.empty(0, np.int64), np.empty((0, 4)), 0,
    )  # fmt: skip


def search_blocks(state: Search, known: LocalizationMap, count: int) -> Search:
    """Score the next `count` blocks, or refine as many of the best."""
    if state.done < len(state.middles):
        end = min(state.done + count, len(state.middles))
        _score_blocks(
            state.points, state.middles, known, state.done, end, state.scores, state.turns
        )
        state = state._replace(done=end)
        if end == len(state.middles):
            flat = state.scores.ravel()
            most = max(round(_SHARE * len(flat)), _LEAST)
            best = np.argsort(-flat)[:most]
            best = best[np.isfinite(flat[best])]
            state = state._replace(best=best, found=np.empty((len(best), 4)))
        return state
    end = min(state.refined + _AT_ONCE * count, len(state.best))
    _refine(state, known, state.refined, end)
    return state._replace(refined=end)


@jit
def _score_blocks(
    points: Floats, middles: Floats, known: LocalizationMap, first: int, end: int, scores: Floats,
    turns: Ints,
) -> None:  # fmt: skip
    """Upper bounds of the scores of blocks, approximately: a distance to walls changes by no more
    than the place does."""
    headings = points.shape[0]
    sums, likely, cells = np.empty(headings), _likelihoods(_WITHIN), _cells(points, known)
    for k in range(first, end):
        for t in range(headings):
            sums[t] = _score(cells, t, middles[k, 0], middles[k, 1], known, likely)
        for t in range(headings):
            before, after = sums[t - 1], sums[(t + 1) % headings]
            if not (sums[t] >= before and sums[t] > after):
                continue
            worst = 0
            for b in range(1, scores.shape[1]):
                if scores[k, b] < scores[k, worst]:
                    worst = b
            if sums[t] > scores[k, worst]:
                scores[k, worst], turns[k, worst] = sums[t], t


@jit
def _refine(state: Search, known: LocalizationMap, first: int, end: int) -> None:
    """The best place and heading of a block, near its best heading."""
    headings = state.points.shape[0]
    likely, cells = _likelihoods(0.0), _cells(state.points, known)
    for i in range(first, end):
        k, b = state.best[i] // _BEST, state.best[i] % _BEST
        state.found[i, 0] = -math.inf
        for j in range(state.first[k], state.first[k + 1]):
            x, y = state.places[j, 0], state.places[j, 1]
            for beside in range(-1, 2):
                t = (state.turns[k, b] + beside) % headings
                score = _score(cells, t, x, y, known, likely)
                if score > state.found[i, 0]:
                    state.found[i, 0], state.found[i, 1], state.found[i, 2] = score, x, y
                    state.found[i, 3] = 2.0 * math.pi * t / headings


@jit
def _likelihoods(nearer: float) -> Floats:
    """Likelihood of a point by its distance to a wall in 64ths of a metre, less `nearer` [m]."""
    likely = np.empty(64)
    for k in range(64):
        likely[k] = math.exp(-0.5 * (max(k / 64.0 - nearer, 0.0) / _TOLERANCE) ** 2)
    return likely


@jit
def _cells(points: Floats, known: LocalizationMap) -> Floats:
    """The points in cells of the map: looked up half a million times a slice."""
    psi, size = known.origin.psi, known.resolution
    c, s = math.cos(psi) / size, math.sin(psi) / size
    cells = np.empty(points.shape)
    for t in range(points.shape[0]):
        for p in range(points.shape[1]):
            x, y = points[t, p, 0], points[t, p, 1]
            cells[t, p, 0], cells[t, p, 1] = c * x + s * y, -s * x + c * y
    return cells


@jit
def _score(
    cells: Floats, t: int, x: float, y: float, known: LocalizationMap, likely: Floats
) -> float:
    """Mean likelihood of a sweep's points at a place, with heading t."""
    psi, size = known.origin.psi, known.resolution
    c, s = math.cos(psi) / size, math.sin(psi) / size
    dx, dy = x - known.origin.x, y - known.origin.y
    column, row = c * dx + s * dy, -s * dx + c * dy
    rows, columns = known.gap.shape
    total, m = 0.0, cells.shape[1]
    for p in range(m):
        u, v = column + cells[t, p, 0], row + cells[t, p, 1]
        if 0.0 <= u < columns and 0.0 <= v < rows:
            gap = known.gap[int(v), int(u)]
            if gap < 1.0:
                total += likely[int(64.0 * gap)]
    return total / m


def candidates(state: Search, count: int) -> list[Pose]:
    """The best poses found, best first, each apart from all better ones."""
    found = state.found[np.argsort(-state.found[:, 0])]
    return [Pose(*row) for row in _separated(found[:, 1:].copy(), count).tolist()]


@jit
def _separated(poses: Floats, count: int) -> Floats:
    kept = np.empty((count, 3))
    m = 0
    for i in range(len(poses)):
        alone = True
        for j in range(m):
            dx, dy = poses[i, 0] - kept[j, 0], poses[i, 1] - kept[j, 1]
            near = dx * dx + dy * dy < _APART * _APART
            if near and abs(wrap(poses[i, 2] - kept[j, 2])) < _TURNED:
                alone = False
                break
        if alone:
            kept[m] = poses[i]
            m += 1
            if m == count:
                break
    return kept[:m].copy()
