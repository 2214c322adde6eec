"""Loop closure: where the newest submap fits an old part of the map, over a wide search.

Places and headings are scored on a coarse raster, the best of it on a fine one, and the best of
that are matched. A submap is used because one scan of a corridor fits many places. A loop that
moves the drive is accepted if drift explains it better than a look-alike (`distinct`); the
magnitude of the drift is estimated from the loops of the drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import between, compose, inverse
from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.place_graph import PlaceGraph, agree
from cohelm.perceive.map.pose_graph import ROUGH, Link, into_axes, loop_link, off, spread
from cohelm.perceive.match.odometry_covariance import inverted
from cohelm.perceive.match.scan_matching import MatchParams, ScanFit, align
from cohelm.perceive.match.surfaces import Surfaces

_SIDE, _STEP = 0.3, math.radians(3.0)  # the fine raster of places and headings
_NEAR = 0.25  # of a point from its surface, at that raster [m]
_COARSE = 2  # factor of the coarse raster
_BROAD = 0.55  # [m]
_PEAKS = 24  # of the coarse raster that are refined
BESIDE = 1.2  # a revisit is within this of an earlier path [m]
_POINTS = 150
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
        k, c = len(self.graph) - 1, self.graph.params
        if k > c.again and self.graph.ways[k] - self.looked >= c.every:
            self.looked = self.graph.ways[k]
            self._close(k)

    def look_again(self) -> None:
        """At the end: search where the path is revisited and nothing was linked."""
        graph, c = self.graph, self.graph.params
        linked = {end for link in graph.links if link.loop for end in (link.a, link.b)}
        xy = np.array(graph.poses)[:, :2]
        looked = -math.inf
        for k in range(c.again + 1, len(graph)):
            if k in linked or graph.ways[k] - looked < c.every:
                continue
            gaps = np.hypot(*(xy[: k - c.again] - xy[k]).T)
            if gaps.min() < c.search + BESIDE:
                looked = graph.ways[k]
                self._close(k)

    def variance_factor(self) -> float:
        """Factor between the covariance of this drive's drift and the model's.

        Robust, from the median at loops, since a match that slid and a wrong loop are outliers. The
        model counts as much as the loops along two submaps; within one they are dependent.
        """
        c = self.graph.params
        model = round(2.0 * c.submap * c.apart / c.every) * [_MEDIAN]
        return float(np.median([*self.drift_errors, *model])) / _MEDIAN

    def _close(self, k: int) -> None:
        """Close loops where the newest submap fits old places uniquely.

        Places near by drift are searched separately, so that look-alikes far off do not make them
        ambiguous.
        """
        graph, c = self.graph, self.graph.params
        drift = spread(graph.poses, graph.links, k)[: k - c.again]
        factor = self.variance_factor()
        covariance = factor * drift
        far = graph.ways[k] - max(self.met, self.wide) > c.lonely
        self.wide = graph.ways[k] if far else self.wide
        reach = c.search + (9.0 if far else 3.0) * np.sqrt(
            np.linalg.eigvalsh(max(factor, 1.0) * drift[:, :2, :2])[:, -1]
        )  # what drifted little so far may drift as the model says from now on
        close = reach < 2.0 * c.search
        newest = graph.surfaces_around(range(max(0, k + 1 - c.submap), k + 1), graph.poses[k])
        new: list[Link] = []
        for subset in (close, ~close):
            link, share = _search_loop(graph, k, newest, covariance, reach, subset)
            if link is None:
                continue
            agrees = agree(graph.there(link), graph.poses[k])
            closed, drift_errors = agrees, _drift_error(graph, link, drift)
            if agrees:
                new.append(link)
            elif share >= c.whole and distinct(graph, link, newest, share, covariance):
                closed = graph.add_contradicting(link)
            if closed:
                self.drift_errors.append(drift_errors)
            if agrees and share >= c.whole:
                self.met = graph.ways[k]
        torn = any(np.abs(off(graph.poses, link) @ _PRECISE).max() > 2.0 for link in new)
        graph.add_loops(new, torn)


def _search_loop(
    graph: PlaceGraph, k: int, newest: Surfaces, covariance: Floats, reach: Floats,
    subset: NDArray[np.bool_],
) -> tuple[Link | None, float]:  # fmt: skip
    """The link of place k to an old place of a subset, if its submap fits uniquely there, and the
    share of the submap that fits."""
    here, c, poses = graph.poses[k], graph.params, graph.poses
    trail = np.array(poses[: len(reach)])[:, :2]
    gaps = np.hypot(trail[:, 0] - here.x, trail[:, 1] - here.y)
    near = subset & (gaps < reach + BESIDE)
    if not near.any():
        return None, 0.0
    old = np.flatnonzero(subset & (gaps < reach[near].max() + c.behind))
    known = graph.surfaces_around(old.tolist(), None)
    turn = 0.1 + 3.0 * math.sqrt(float(covariance[near, 2, 2].max()))
    found: list[tuple[float, ScanFit, int]] = []
    for fit in revisits(known, newest.points, newest.normals, trail[near], reach[near], here, turn):
        a = int(old[np.hypot(trail[old, 0] - fit.pose.x, trail[old, 1] - fit.pose.y).argmin()])
        if graph.separated(a, k):
            continue
        # a place that drift makes unlikely has to fit better
        total = covariance[a] + np.diag(ROUGH**2)
        distance = _mahalanobis(poses[a], compose(here, between(fit.pose, poses[a])), total)
        found.append((fit.share - c.alone * min(distance / 9.0, 1.0), fit, a))
    found.sort(key=lambda one: -one[0])
    if not found or (len(found) > 1 and found[1][0] > found[0][0] - c.alone):
        return None, 0.0
    _, fit, a = found[0]
    if fit.share < c.fits or fit.rms > c.rms:
        return None, 0.0
    if np.linalg.eigvalsh(fit.information[:2, :2])[0] < c.firm:
        return None, 0.0
    link = loop_link(a, k, between(poses[a], fit.pose), fit.information, fit.pose.psi)
    return link, fit.share


def distinct(
    graph: PlaceGraph, link: Link, newest: Surfaces, share: float, covariance: Floats
) -> bool:
    """Whether a loop is a true revisit, and no look-alike.

    The density of the drift at the loop [1/(m^2 rad)] is compared with that of look-alikes: how
    many other places of the whole drive the newest submap fits as well, over the area searched. A
    place without a look-alike is accepted however far off: raw odometry may be worse than its
    model.
    """
    c, here, there = graph.params, graph.poses[link.b], graph.there(link)
    trail = np.array(graph.poses[: link.b - c.again])[:, :2]
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
            range(max(0, first - c.submap), min(last + c.submap, link.b)), None
        )
        reach = np.full(last - first, math.inf)
        fits = revisits(
            known, newest.points, newest.normals, trail[first:last], reach, here, math.pi
        )  # fmt: skip
        for fit in fits:
            counted = any(_same(fit.pose, one) for one in (there, *lookalikes))
            if fit.share > share - c.alone and not counted:
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
    known: Surfaces, points: Floats, across: Floats, trail: Floats, reach: Floats, here: Pose,
    turn: float,
) -> list[ScanFit]:  # fmt: skip
    """Fits of points (n, 2) with normals, in the frame of the robot, best first, each apart from
    all better ones.

    trail: (k, 2), earlier positions, and reach: (k,), search radius of each around `here` [m].
    turn: largest heading difference [rad].
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
        starts.append(_refine(known, few, sides, places[place], headings[heading]))
        scores[np.ix_(near, beside)] = 0.0
    starts.sort(key=lambda start: -start[0])
    params = MatchParams(reach=0.6, rounds=30)
    fits = [align(known, points, across, start, _LOOSE, params) for _, start in starts[:_BEST]]
    fits.sort(key=lambda fit: -fit.share)
    return [f for i, f in enumerate(fits) if not any(_same(f.pose, g.pose) for g in fits[:i])]


def _refine(
    known: Surfaces, points: Floats, across: Floats, place: Floats, heading: float
) -> tuple[float, Pose]:
    """The best score and pose of the fine raster around a place and heading of the coarse one."""
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
    known: Surfaces, points: Floats, across: Floats, places: Floats, headings: Floats, near: float,
) -> Floats:  # fmt: skip
    """(places, headings): share of the points as near as that [m] to a surface of the same
    direction, and of the same side where `known` has sides."""
    rows, columns = known.nearest.shape
    sided = len(known.back) > 0
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
                alignment = ax * known.normals[i, 0] + ay * known.normals[i, 1]
                if sided and alignment < -0.85 and known.back[i] >= 0:
                    i, alignment = known.back[i], -alignment
                flat = (alignment if sided else abs(alignment)) > 0.85
                dx = places[k, 0] + qx + known.x - known.points[i, 0]
                dy = places[k, 1] + qy + known.y - known.points[i, 1]
                if flat and dx * dx + dy * dy < near * near:
                    scores[k, t] += 1.0
    return scores / max(len(points), 1)
