"""Loop closure: where the newest submap fits an old part of the map, over a wide search.

The best places and headings of a coarse raster are found by upper bounds, which leave few to be
counted (as in Olson 2015; Hess et al. 2016), the best of a fine raster around each, and the best
of these are matched. A submap is used because one scan of a corridor fits many places. A loop that
moves the drive is accepted if drift explains it better than a look-alike (`distinct`); the
magnitude of the drift is estimated from the loops of the drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import between, compose, inverse
from cohelm.core.jit import jit, jit_inline
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.map.mapper_params import PARAMS
from cohelm.perceive.map.place_graph import PlaceGraph, agree
from cohelm.perceive.map.pose_graph import ROUGH, Link, into_axes, loop_link, off, spread
from cohelm.perceive.match.odometry_covariance import inverted
from cohelm.perceive.match.scan_matching import MatchParams, ScanFit, align
from cohelm.perceive.match.surfaces import FlatPoints, Surfaces, row_at

_SIDE, _STEP = 0.3, math.radians(3.0)  # the fine raster of places and headings
_NEAR = 0.25  # of a point from its surface, at that raster [m]
_COARSE = 2  # factor of the coarse raster
_BROAD = 0.55  # [m]
_PEAKS = 24  # of the coarse raster that are refined
BESIDE = 1.2  # a revisit is within this of an earlier path [m]
_POINTS = 150
_ALIGNED = 0.85  # cosine between normals of the same direction,
_OBLIQUE = math.acos(_ALIGNED) + 1e-6  # and the angle
_WAYS = 64  # directions told apart, one bit each, by the bounds of the coarse raster
_STRETCH = 150  # places in one search for look-alikes
_MEDIAN = 2.366  # of chi square, 3
_ODDS = 99.0  # required odds of drift against a look-alike
_AREA = 2.0 * BESIDE  # around a path, searched for look-alikes [m]
_BEST = 8  # that are matched
_APART, _TURNED = 1.0, 0.3  # poses nearer to each other than both are the same [m, rad]
_PRECISE = np.diag(1.0 / ROUGH)
_LOOSE = np.diag([1.0, 1.0, 4.0])  # information of the raster


@dataclass
class LoopClosure:
    """Loop closure of one drive."""

    graph: PlaceGraph

    def __post_init__(self) -> None:
        # distances driven at the last search, the last wide search, and the last loop
        self.looked = self.wide = self.met = 0.0
        # squared Mahalanobis distance of the drift at each loop
        self.drift_errors: list[float] = []

    def look(self) -> None:
        """After a new place: search for loops, if due."""
        k = len(self.graph) - 1
        if k > PARAMS.again and self.graph.ways[k] - self.looked >= PARAMS.every:
            self.looked = self.graph.ways[k]
            self._close(k)

    def look_again(self) -> None:
        """At the end: search where the path is revisited and nothing was linked."""
        graph = self.graph
        linked = {end for link in graph.links if link.loop for end in (link.a, link.b)}
        xy = np.array(graph.poses)[:, :2]
        looked = -math.inf
        for k in range(PARAMS.again + 1, len(graph)):
            if k in linked or graph.ways[k] - looked < PARAMS.every:
                continue
            gaps = np.hypot(*(xy[: k - PARAMS.again] - xy[k]).T)
            if gaps.min() < PARAMS.search + BESIDE:
                looked = graph.ways[k]
                self._close(k)

    def variance_factor(self) -> float:
        """Factor between the covariance of this drive's drift and the model's.

        Robust, from the median at loops, since a match that slid and a wrong loop are outliers. The
        model counts as much as the loops along two submaps; within one they are dependent.
        """
        model = round(2.0 * PARAMS.submap * PARAMS.apart / PARAMS.every) * [_MEDIAN]
        return float(np.median([*self.drift_errors, *model])) / _MEDIAN

    def _close(self, k: int) -> None:
        """Close loops where the newest submap fits old places uniquely.

        Places near by drift are searched separately, so that look-alikes far off do not make them
        ambiguous.
        """
        graph = self.graph
        drift = spread(graph.poses, graph.links, k)[: k - PARAMS.again]
        factor = self.variance_factor()
        covariance = factor * drift
        far = graph.ways[k] - max(self.met, self.wide) > PARAMS.lonely
        self.wide = graph.ways[k] if far else self.wide
        reach = PARAMS.search + (9.0 if far else 3.0) * np.sqrt(
            np.linalg.eigvalsh(max(factor, 1.0) * drift[:, :2, :2])[:, -1]
        )  # what drifted little so far may drift as the model says from now on
        close = reach < 2.0 * PARAMS.search
        newest = graph.points_around(range(max(0, k + 1 - PARAMS.submap), k + 1), graph.poses[k])
        new: list[Link] = []
        for subset in (close, ~close):
            link, share = _search_loop(graph, k, newest, covariance, reach, subset)
            if link is None:
                continue
            agrees = agree(graph.there(link), graph.poses[k])
            closed, drift_errors = agrees, _drift_error(graph, link, drift)
            if agrees:
                new.append(link)
            elif share >= PARAMS.whole and distinct(graph, link, newest, share, covariance):
                closed = graph.add_contradicting(link)
            if closed:
                self.drift_errors.append(drift_errors)
            if agrees and share >= PARAMS.whole:
                self.met = graph.ways[k]
        torn = any(np.abs(off(graph.poses, link) @ _PRECISE).max() > 2.0 for link in new)
        graph.add_loops(new, torn)


def _search_loop(
    graph: PlaceGraph, k: int, newest: FlatPoints, covariance: Floats, reach: Floats,
    subset: NDArray[np.bool_],
) -> tuple[Link | None, float]:  # fmt: skip
    """The link of place k to an old place of a subset, if its submap fits uniquely there, and the
    share of the submap that fits."""
    here, poses = graph.poses[k], graph.poses
    trail = np.array(poses[: len(reach)])[:, :2]
    gaps = np.hypot(trail[:, 0] - here.x, trail[:, 1] - here.y)
    near = subset & (gaps < reach + BESIDE)
    if not near.any():
        return None, 0.0
    old = np.flatnonzero(subset & (gaps < reach[near].max() + PARAMS.behind))
    known = graph.surfaces_around(old.tolist(), None)
    turn = 0.1 + 3.0 * math.sqrt(float(covariance[near, 2, 2].max()))
    found: list[tuple[float, ScanFit, int]] = []
    for fit in revisits(known, newest, trail[near], reach[near], here, turn):
        a = int(old[np.hypot(trail[old, 0] - fit.pose.x, trail[old, 1] - fit.pose.y).argmin()])
        if graph.separated(a, k):
            continue
        # a place that drift makes unlikely has to fit better
        total = covariance[a] + np.diag(ROUGH**2)
        distance = _mahalanobis(poses[a], compose(here, between(fit.pose, poses[a])), total)
        found.append((fit.share - PARAMS.alone * min(distance / 9.0, 1.0), fit, a))
    found.sort(key=lambda one: -one[0])
    if not found or (len(found) > 1 and found[1][0] > found[0][0] - PARAMS.alone):
        return None, 0.0
    _, fit, a = found[0]
    if fit.share < PARAMS.fits or fit.rms > PARAMS.rms:
        return None, 0.0
    if np.linalg.eigvalsh(fit.information[:2, :2])[0] < PARAMS.firm:
        return None, 0.0
    link = loop_link(a, k, between(poses[a], fit.pose), fit.information, fit.pose.psi)
    return link, fit.share


def distinct(
    graph: PlaceGraph, link: Link, newest: FlatPoints, share: float, covariance: Floats
) -> bool:
    """Whether a loop is a true revisit, and no look-alike.

    The density of the drift at the loop [1/(m^2 rad)] is compared with that of look-alikes: how
    many other places of the whole drive the newest submap fits as well, over the area searched. A
    place without a look-alike is accepted however far off: raw odometry may be worse than its
    model.
    """
    here, there = graph.poses[link.b], graph.there(link)
    trail = np.array(graph.poses[: link.b - PARAMS.again])[:, :2]
    cells = np.unique(np.round(trail / _AREA).astype(np.int64), axis=0)
    searched = 2.0 * math.pi * _AREA**2 * len(cells)
    most = _drift_density(graph, link, covariance) * searched / _ODDS
    lookalikes: list[Pose] = []
    nearest_first = sorted(
        range(0, len(trail), _STRETCH),
        key=lambda k: float(np.hypot(*(trail[k : k + _STRETCH] - there[:2]).T).min()),
    )
    for first in nearest_first:
        last = min(first + _STRETCH, len(trail))
        known = graph.surfaces_around(
            range(max(0, first - PARAMS.submap), min(last + PARAMS.submap, link.b)), None
        )
        reach = np.full(last - first, math.inf)
        fits = revisits(known, newest, trail[first:last], reach, here, math.pi)
        for fit in fits:
            counted = any(_same(fit.pose, one) for one in (there, *lookalikes))
            if fit.share > share - PARAMS.alone and not counted:
                lookalikes.append(fit.pose)
        if len(lookalikes) > most:
            return False
    return True


def _drift_density(graph: PlaceGraph, link: Link, covariance: Floats) -> float:
    """Probability density of the drift at a loop [1/(m^2 rad)]."""
    seen = compose(graph.poses[link.b], inverse(link.pose))
    total = covariance[link.a] + np.diag(ROUGH**2)
    distance = _mahalanobis(graph.poses[link.a], seen, total)
    return math.exp(-0.5 * distance) / math.sqrt((2.0 * math.pi) ** 3 * float(np.linalg.det(total)))


def _drift_error(graph: PlaceGraph, link: Link, drift: Floats) -> float:
    """Squared Mahalanobis distance of the drift at a loop from the prediction by the links."""
    here = graph.poses[link.b]
    match = into_axes(Pose(0.0, 0.0, -here.psi), inverted(link.information))
    return _mahalanobis(
        graph.poses[link.a], compose(here, inverse(link.pose)), drift[link.a] + match
    )


def _mahalanobis(there: Pose, seen: Pose, covariance: Floats) -> float:
    """Squared Mahalanobis distance of an old place seen from the newest one from its pose."""
    d = np.array([seen.x - there.x, seen.y - there.y, wrap(seen.psi - there.psi)])
    return float(d @ inverted(covariance) @ d)


def revisits(
    known: Surfaces, flat: FlatPoints, trail: Floats, reach: Floats, here: Pose, turn: float
) -> list[ScanFit]:
    """Fits of points with normals, in the frame of the robot, best first, each apart from all
    better ones.

    trail: (k, 2), earlier positions, and reach: (k,), search radius of each around `here` [m].
    turn: largest heading difference [rad].
    """
    n = len(flat.points)
    chosen = np.linspace(0, n - 1, min(_POINTS, n)).astype(int)
    few = FlatPoints(flat.points[chosen], flat.normals[chosen])
    side, step = _COARSE * _SIDE, _COARSE * _STEP
    wide = math.ceil(BESIDE / side)
    around = np.array([
        (i, j) for i in range(-wide, wide + 1) for j in range(-wide, wide + 1)
        if math.hypot(i, j) <= wide
    ])  # fmt: skip
    cells = np.round((trail - here[:2]) / side).astype(np.int64)[:, None] + around
    inside = side * np.hypot(*np.moveaxis(cells, 2, 0)) < reach[:, None] + 0.5 * side
    cells = np.unique(cells[inside], axis=0)
    if len(cells) == 0 or len(known.points) == 0:
        return []
    places = np.asarray(side * cells + here[:2], dtype=np.float64)
    steps = math.ceil(min(turn, math.pi) / step)
    headings = here.psi + step * np.arange(-steps, steps + 1, dtype=np.float64)
    most = _most_hits(known, few, here, _COARSE * cells, headings)
    starts: list[tuple[int, Pose]] = []
    for place, heading in _peaks(known, few, places, headings, most):
        least = starts[_BEST - 1][0] if len(starts) >= _BEST else -1
        start = _refined(known, few, places[place], headings[heading], least)
        starts = sorted([*starts, start], key=lambda start: -start[0])
    params = MatchParams(reach=0.6, rounds=30)
    fits = [align(known, flat, start, _LOOSE, params) for _, start in starts[:_BEST]]
    fits.sort(key=lambda fit: -fit.share)
    return [f for i, f in enumerate(fits) if not any(_same(f.pose, g.pose) for g in fits[:i])]


def _same(a: Pose, b: Pose) -> bool:
    return math.hypot(a.x - b.x, a.y - b.y) < _APART and abs(wrap(a.psi - b.psi)) < _TURNED


@jit
def _turned(flat: FlatPoints, heading: float) -> Floats:
    """(n, 4): points and their normals, turned."""
    points, normals = flat.points, flat.normals
    c, s = math.cos(heading), math.sin(heading)
    out = np.empty((len(points), 4))
    for n in range(len(points)):
        out[n, 0] = c * points[n, 0] - s * points[n, 1]
        out[n, 1] = s * points[n, 0] + c * points[n, 1]
        out[n, 2] = c * normals[n, 0] - s * normals[n, 1]
        out[n, 3] = s * normals[n, 0] + c * normals[n, 1]
    return out


@jit_inline
def _hits(known: Surfaces, seen: Floats, x: float, y: float, near: float, least: int) -> int:
    """How many points (`_turned`) seen from a place are as near as that [m] to a surface of the
    same direction and side; if not more than `least`, any number that is not either."""
    hits = 0
    for n in range(len(seen)):
        if hits + len(seen) - n <= least:
            break
        px, py, ax, ay = x + seen[n, 0], y + seen[n, 1], seen[n, 2], seen[n, 3]
        i = row_at(known, px, py)
        if i < 0:
            continue
        alignment = ax * known.normals[i, 0] + ay * known.normals[i, 1]
        if alignment < -_ALIGNED and known.back[i] >= 0:
            i, alignment = known.back[i], -alignment
        dx, dy = px - known.points[i, 0], py - known.points[i, 1]
        if alignment > _ALIGNED and dx * dx + dy * dy < near * near:
            hits += 1
    return hits


@jit
def _most_hits(
    known: Surfaces, flat: FlatPoints, here: Pose, cells: Ints, headings: Floats
) -> Ints:
    """(places, headings): upper bounds of the hits on the coarse raster.

    cells: (places, 2), from `here`, in squares of the fine raster. A point counts wherever in its
    square it is.
    """
    margin = 1 + int(np.sqrt((flat.points**2).sum(axis=1).max()) / _SIDE)
    u0, v0 = cells[:, 0].min() - margin, cells[:, 1].min() - margin
    wide = cells[:, 0].max() + margin + 1 - u0
    high = cells[:, 1].max() + margin + 1 - v0
    may_hit = np.zeros((high, wide), np.uint64)
    _mark(may_hit, known, here.x + _SIDE * u0, here.y + _SIDE * v0)
    places = ((cells[:, 1] - v0 - margin) * wide + cells[:, 0] - u0 - margin).astype(np.uint64)
    squares, most = may_hit.ravel(), np.zeros((len(headings), len(cells)), np.int64)
    for t in range(len(headings)):
        seen, row = _turned(flat, headings[t]), most[t]
        for n in range(len(seen)):
            u, v = math.floor(seen[n, 0] / _SIDE), math.floor(seen[n, 1] / _SIDE)
            from_first = squares[(v + margin) * wide + u + margin :]
            way = np.uint64(_way(math.atan2(seen[n, 3], seen[n, 2])) % _WAYS)
            for k in range(len(places)):
                row[k] += np.int64(from_first[places[k]] >> way & np.uint64(1))
    return most.T.copy()


@jit
def _mark(may_hit: NDArray[np.uint64], known: Surfaces, left: float, low: float) -> None:
    """Mark in each square of the fine raster, one bit each, the directions in which a point
    anywhere in it may be a hit on the coarse one. (left, low): corner of the first square [m]."""
    high, wide = may_hit.shape
    reach = _BROAD + 1e-6
    for k in range(2 * len(known.points)):
        i, behind = k // 2, k % 2 == 1
        psi = math.atan2(known.normals[i, 1], known.normals[i, 0])
        if behind:  # there the wall's other side counts
            i, psi = known.back[i], psi + math.pi
        if i < 0:
            continue
        ways = np.uint64(0)
        for way in range(_way(psi - _OBLIQUE), _way(psi + _OBLIQUE) + 1):
            ways |= np.uint64(1) << np.uint64(way % _WAYS)
        x, y = known.points[i, 0] - left, known.points[i, 1] - low
        first, last = math.floor((x - reach) / _SIDE), math.floor((x + reach) / _SIDE)
        for v in range(
            max(math.floor((y - reach) / _SIDE), 0), min(math.floor((y + reach) / _SIDE) + 1, high)
        ):
            dy = max(v * _SIDE - y, y - (v + 1) * _SIDE, 0.0)
            for u in range(max(first, 0), min(last + 1, wide)):
                dx = max(u * _SIDE - x, x - (u + 1) * _SIDE, 0.0)
                if dx * dx + dy * dy < reach * reach:
                    may_hit[v, u] |= ways


@jit_inline
def _way(psi: float) -> int:
    return math.floor(psi * (_WAYS / math.tau))


@jit
def _peaks(
    known: Surfaces, flat: FlatPoints, places: Floats, headings: Floats, most: Ints
) -> list[tuple[int, int]]:
    """Numbers of place and heading of the best on the coarse raster, each apart from all better
    ones. most: upper bounds of the hits; only those are counted that the bounds leave in question.
    """
    counted = np.zeros(most.shape, np.bool_)
    best = np.array([row.max() for row in most])
    found = [(0, 0) for _ in range(0)]
    while len(found) < _PEAKS:
        k = int(best.argmax())
        t = int(most[k].argmax())
        if best[k] <= 0:
            break
        if not counted[k, t]:
            seen = _turned(flat, headings[t])
            most[k, t] = _hits(known, seen, places[k, 0], places[k, 1], _BROAD, -1)
            counted[k, t] = True
            best[k] = most[k].max()
            continue
        found.append((k, t))
        for i in range(len(places)):
            if math.hypot(places[i, 0] - places[k, 0], places[i, 1] - places[k, 1]) < _APART:
                for j in range(len(headings)):
                    if abs(headings[j] - headings[t]) < _TURNED:
                        most[i, j] = 0
                best[i] = most[i].max()
    return found


@jit
def _refined(
    known: Surfaces, flat: FlatPoints, place: Floats, heading: float, least: int
) -> tuple[int, Pose]:
    """The most hits on the fine raster around a place and heading of the coarse one, and the pose;
    if not more than `least`, any number that is not either."""
    headings = heading + _STEP * np.arange(-_COARSE, _COARSE + 1)
    seen = np.empty((len(headings), len(flat.points), 4))
    for t in range(len(headings)):
        seen[t] = _turned(flat, headings[t])
    best, pose = least, Pose(place[0], place[1], heading)
    for i in range(-_COARSE, _COARSE + 1):
        for j in range(-_COARSE, _COARSE + 1):
            x, y = place[0] + _SIDE * i, place[1] + _SIDE * j
            for t in range(len(headings)):
                hits = _hits(known, seen[t], x, y, _NEAR, best)
                if hits > best:
                    best, pose = hits, Pose(x, y, wrap(headings[t]))
    return best, pose
