"""Searches the whole map for the robot, in slices that a control loop can afford."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, wrap
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.match.surfaces import moved

_POINTS = 64
_TURNS = 120
_BEST = 4  # headings kept of each place
_TOLERANCE = 0.2  # of a point from its wall, at the raster of places and headings [m]
_APART, _TURNED = 0.35, 0.3  # candidates nearer to each other than both are one [m, rad]


class Search(NamedTuple):
    """points: (t, p, 2), a sweep turned by each heading. places: (k, 2) still as on the map.
    scores: (k, 4) of the best headings of each place, turns: (k, 4) which ones. done: places
    looked at so far. The arrays are filled in as it goes."""

    points: Floats
    places: Floats
    scores: Floats
    turns: Floats
    done: int


def search(points: Floats, places: Floats) -> Search:
    """Begin. points: (m, 2) of a sweep in the body frame; places: (k, 2) to look at."""
    chosen = points[np.linspace(0, len(points) - 1, min(_POINTS, len(points))).astype(int)]
    turned = np.stack([
        moved(Pose(0.0, 0.0, 2.0 * math.pi * t / _TURNS), chosen, False) for t in range(_TURNS)
    ])  # fmt: skip
    k = len(places)
    return Search(turned, places, np.full((k, _BEST), -math.inf), np.zeros((k, _BEST)), 0)


def looked(state: Search, known: LocalizationMap, count: int) -> Search:
    """Look at the next `count` places."""
    end = min(state.done + count, len(state.places))
    _look(state.points, state.places, known, state.done, end, state.scores, state.turns)
    return state._replace(done=end)


@jit
def _look(
    points: Floats, places: Floats, known: LocalizationMap, first: int, end: int, scores: Floats,
    turns: Floats,
) -> None:  # fmt: skip
    headings, m = points.shape[0], points.shape[1]
    sums = np.empty(headings)
    scale = -0.5 / (_TOLERANCE * _TOLERANCE)
    likely = np.empty(64)
    for k in range(64):
        likely[k] = math.exp(scale * (k / 64.0) ** 2)
    # All in cells of the map from its corner: this is looked up half a million times a slice.
    c, s = (
        math.cos(known.origin.psi) / known.resolution,
        math.sin(known.origin.psi) / known.resolution,
    )
    cells = np.empty((headings, m, 2))
    for t in range(headings):
        for p in range(m):
            x, y = points[t, p, 0], points[t, p, 1]
            cells[t, p, 0], cells[t, p, 1] = c * x + s * y, -s * x + c * y
    rows, columns = known.gap.shape
    for k in range(first, end):
        x, y = places[k, 0] - known.origin.x, places[k, 1] - known.origin.y
        column, row = c * x + s * y, -s * x + c * y
        for t in range(headings):
            total = 0.0
            for p in range(m):
                u, v = column + cells[t, p, 0], row + cells[t, p, 1]
                if 0.0 <= u < columns and 0.0 <= v < rows:
                    gap = known.gap[int(v), int(u)]
                    if gap < 1.0:
                        total += likely[int(64.0 * gap)]
            sums[t] = total / m
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


def candidates(state: Search, count: int) -> list[Pose]:
    """The best poses found, best first, each some way from all better ones."""
    flat = state.scores.ravel()
    order = np.argsort(-flat)[: 60 * count]
    order = order[np.isfinite(flat[order])]
    poses = np.column_stack((
        state.places[order // _BEST],
        2.0 * math.pi / _TURNS * state.turns.ravel()[order],
    ))  # fmt: skip
    return [Pose(*row) for row in _apart(poses, count)[:, :].tolist()]


@jit
def _apart(poses: Floats, count: int) -> Floats:
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
