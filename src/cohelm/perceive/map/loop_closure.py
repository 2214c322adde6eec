"""Finds loop closures: where the newest part of a map fits an old one, over a wide search.

Places and headings are tried on a coarse raster, the best of it on a fine one, and the best of that
are matched. More than one scan is asked
for, because one scan of a corridor fits many.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, wrap
from cohelm.perceive.match.scan_matching import Fit, MatchParams, align
from cohelm.perceive.match.surfaces import Surfaces

_SIDE, _STEP = 0.3, math.radians(3.0)  # the fine raster of places and headings
_NEAR = 0.25  # of a point from its surface, at that raster [m]
_COARSE = 2  # the coarse one is so much wider, and less is asked of it
_BROAD = 0.55  # [m]
_PEAKS = 24  # of the coarse raster, that are looked at finely
BESIDE = 1.2  # a robot comes back within this of where it drove before [m]
_POINTS = 150
_BEST = 8  # that are matched
_APART, _TURNED = 1.0, 0.3  # what is nearer to each other than both is one [m, rad]
_LOOSE = np.diag([1.0, 1.0, 4.0])  # information of the raster


def revisits(
    known: Surfaces, points: Floats, across: Floats, trail: Floats, reach: Floats, here: Pose,
    turn: float,
) -> list[Fit]:  # fmt: skip
    """Fits of points (n, 2) with normals, in the frame of the robot, best first, each some way
    from all better ones.

    trail: (k, 2), where the robot was before, and reach: (k,), how far off it may be if it is
    there again instead of `here` [m]. turn: how far it may be turned [rad].
    """
    chosen = np.linspace(0, len(points) - 1, min(_POINTS, len(points))).astype(int)
    few, sides = points[chosen], across[chosen]
    side, step = _COARSE * _SIDE, _COARSE * _STEP
    wide = math.ceil(BESIDE / side)
    around = np.array([
        (i, j) for i in range(-wide, wide + 1) for j in range(-wide, wide + 1)
        if math.hypot(i, j) <= wide
    ])  # fmt: skip
    cells = np.round((trail - here[:2]) / side).astype(np.int64)[:, None] + around
    inside = side * np.hypot(*np.moveaxis(cells, 2, 0)) < reach[:, None] + 0.5 * side
    cells = np.unique(cells[inside], axis=0)
    if len(cells) == 0:
        return []
    places = np.asarray(side * cells + here[:2], dtype=np.float64)
    steps = math.ceil(min(turn, math.pi) / step)
    headings = here.psi + step * np.arange(-steps, steps + 1, dtype=np.float64)
    scores = _scores(known, few, sides, places, headings, _BROAD)
    starts: list[tuple[float, Pose]] = []
    for _ in range(_PEAKS):
        place, heading = divmod(int(scores.argmax()), len(headings))
        if scores[place, heading] <= 0.0:
            break
        near = np.hypot(*(places - places[place]).T) < _APART
        beside = np.abs(headings - headings[heading]) < _TURNED
        starts.append(_finest(known, few, sides, places[place], headings[heading]))
        scores[np.ix_(near, beside)] = 0.0
    starts.sort(key=lambda start: -start[0])
    care = MatchParams(reach=0.6, rounds=30)
    fits = [align(known, points, across, start, _LOOSE, care) for _, start in starts[:_BEST]]
    fits.sort(key=lambda fit: -fit.share)
    return [f for i, f in enumerate(fits) if not any(_same(f.pose, g.pose) for g in fits[:i])]


def _finest(
    known: Surfaces, points: Floats, across: Floats, place: Floats, heading: float
) -> tuple[float, Pose]:
    """The best of the fine raster around a place and heading of the coarse one, and its score."""
    near = range(-_COARSE, _COARSE + 1)
    places = place + _SIDE * np.array([(i, j) for i in near for j in near], dtype=np.float64)
    headings = heading + _STEP * np.array(near, dtype=np.float64)
    scores = _scores(known, points, across, places, headings, _NEAR)
    k, t = divmod(int(scores.argmax()), len(headings))
    px, py = places[k].tolist()
    return float(scores[k, t]), Pose(px, py, wrap(float(headings[t])))


def _same(a: Pose, b: Pose) -> bool:
    return math.hypot(a.x - b.x, a.y - b.y) < _APART and abs(wrap(a.psi - b.psi)) < _TURNED


@jit
def _scores(
    known: Surfaces, points: Floats, across: Floats, places: Floats, headings: Floats,
    near: float,
) -> Floats:  # fmt: skip
    """(places, headings): share of the points as near as that [m] to a surface of the same
    direction."""
    rows, columns = known.nearest.shape
    scores = np.zeros((len(places), len(headings)))
    for t in range(len(headings)):
        c, s = math.cos(headings[t]), math.sin(headings[t])
        for n in range(len(points)):
            qx = c * points[n, 0] - s * points[n, 1] - known.x
            qy = s * points[n, 0] + c * points[n, 1] - known.y
            ax, ay = c * across[n, 0] - s * across[n, 1], s * across[n, 0] + c * across[n, 1]
            for k in range(len(places)):
                u = (places[k, 0] + qx) / known.resolution
                v = (places[k, 1] + qy) / known.resolution
                if not (0.0 <= u < columns and 0.0 <= v < rows):
                    continue
                i = known.nearest[int(v), int(u)]
                if i < 0:
                    continue
                dx = places[k, 0] + qx + known.x - known.points[i, 0]
                dy = places[k, 1] + qy + known.y - known.points[i, 1]
                flat = abs(ax * known.normals[i, 0] + ay * known.normals[i, 1]) > 0.85
                if flat and dx * dx + dy * dy < near * near:
                    scores[k, t] += 1.0
    return scores / max(len(points), 1)
