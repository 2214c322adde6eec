"""Places of a drive, the links between them, and the selection of loops.

No loop is accepted for good: when one contradicts others, a consistent subset of all loops that
were ever accepted is selected.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.corridor import shifted
from cohelm.perceive.map.mapper_params import PARAMS
from cohelm.perceive.map.pose_graph import (
    ROUGH,
    Link,
    consistent,
    contradicted,
    from_rows,
    loop_link,
    rows,
    solved,
    spread,
)
from cohelm.perceive.match.scan_matching import MatchParams, align, observed
from cohelm.perceive.match.surfaces import (
    FlatPoints,
    Surfaces,
    behind,
    one_each,
    seen_from,
    stacked,
    surfaces,
    thinned,
)

_SAME = 0.5  # typical correction of a place by the graph [m]
_CLOSED = 0.25  # the same after all places were linked [m]
_BESIDE = 0.25  # reach of a match from where submaps fit along a corridor [m]
_ODDS = 99.0  # of that place against any other along it
_TURNS = 4  # of linking places that were too far off before


class Place(NamedTuple):
    """Number of its scan, and its surfaces in the body frame, with normals towards the LiDAR."""

    scan: int
    flat: FlatPoints


class PlaceGraph:
    """The graph of one drive, or of several that continue each other."""

    def __init__(self) -> None:
        self.places: list[Place] = []
        self.poses: list[Pose] = []
        self.ways: list[float] = []  # distances driven [m]
        self.links: list[Link] = []
        self._candidates: list[list[Link]] = []  # groups of loops that agree, not yet accepted
        self._rejected: list[Link] = []
        self._apart: list[tuple[int, int]] = []  # pairs of places that the user separated,
        self._left_out: set[int] = set()  # and places that the user left out

    def __len__(self) -> int:
        return len(self.places)

    def add(self, place: Place, pose: Pose, step: Link | None) -> None:
        """Add a place. step: link from the last one to it."""
        if step is not None:
            self.links.append(step)
            self.ways.append(self.ways[-1] + math.hypot(step.pose.x, step.pose.y))
        else:
            self.ways.append(0.0)
        self.places.append(place)
        self.poses.append(pose)

    def surfaces_around(
        self, numbers: Sequence[int], origin: Pose | None, reach: float = 0.6
    ) -> Surfaces:
        """Surfaces of some places, in the frame of the map or of a pose in it, to be matched from
        so far off; each side of a wall is one."""
        made = surfaces(self.points_around(numbers, origin), 0.05, reach + 0.05)
        return made._replace(back=behind(made))

    def points_around(self, numbers: Sequence[int], origin: Pose | None) -> FlatPoints:
        """Points and normals of these surfaces."""
        return one_each(self._seen_from(numbers, origin), 0.04)

    def solve(self) -> None:
        """Optimize the poses by all links."""
        self.poses = solved(self.poses, self.links)

    def add_loops(self, loops: Sequence[Link], move: bool) -> None:
        """Add loops that agree with the drive. move: whether to optimize for them."""
        self.links += loops
        if move:
            self.solve()

    def add_contradicting(self, link: Link) -> bool:
        """Add a loop that contradicts the drive: accepted once others agree with it. Returns
        whether it is.

        A scan in between that fits nowhere is no evidence against them. A loop to an old place
        whose relative pose is not well known agrees by chance only.
        """
        there = self.there(link)
        held = [link]
        for group in self._candidates:
            since = between(self.poses[group[-1].b], self.poses[link.b])
            same = agree(compose(self.there(group[-1]), since), there)
            if same and self._well_known(group[-1].a, link.a):
                self._candidates = [other for other in self._candidates if other is not group]
                held = [*group, link]
                break
        if self.ways[link.b] - self.ways[held[0].b] < PARAMS.holds:
            self._candidates.append(held)
            return False
        # a robust kernel hardly pulls from far: first without it, then all with it
        certain = [group._replace(loop=False) for group in held]
        self.poses = solved(self.poses, [*self.links, *certain])
        self.links += held
        self.solve()
        loops = [group for group in self.links if group.loop]
        if any(contradicted(self.poses, group) for group in loops) or self._rejected:
            self.select_consistent()
        return any(group is link for group in self.links)

    def _well_known(self, a: int, b: int) -> bool:
        """Whether the relative pose of places a and b is known to the tolerance of `agree`."""
        covariance = spread(self.poses, self.links, a)[b, :2, :2]
        return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])) < _SAME

    def select_consistent(self) -> None:
        """Select a consistent subset of all loops that were ever accepted."""
        every = [*self.links, *self._rejected]
        if not any(link.loop for link in every):
            return
        self.links = consistent(self.poses, every)
        kept = {id(link) for link in self.links}
        self._rejected = [link for link in every if id(link) not in kept]
        certain = [link._replace(loop=False) for link in self.links]
        self.poses = solved(self.poses, certain)
        self.solve()

    def there(self, link: Link) -> Pose:
        """The pose of a link's second place by the link."""
        return compose(self.poses[link.a], link.pose)

    def link_all(self, progress: Callable[[float], None], move: bool) -> None:
        """Link all places that see the same walls. move: two laps may lie beside each other, and
        earlier loops still count; places that are too far from what they see are tried again once
        their neighbours have been pulled there."""
        if not move:
            links = [link for link in self.links if not link.loop]
            self.links = links + self._found({}, _CLOSED, progress)
            self.solve()
            return
        linked: dict[int, list[int]] = {}
        for turn in range(_TURNS):
            found = self._found(linked, _SAME, lambda share, n=turn: progress((n + share) / _TURNS))
            self.links += found
            before = [between(self.poses[link.a], self.poses[link.b]) for link in found]
            # first with a wide kernel, so that distant places are pulled too
            self.poses = solved(self.poses, self.links, _SAME / float(ROUGH[0]))
            self.solve()
            if not any(
                _apart(was, between(self.poses[link.a], self.poses[link.b])) > _CLOSED
                for was, link in zip(before, found, strict=True)
            ):
                break
            for link in found:
                linked.setdefault(link.b, []).append(link.a)

    def _found(
        self, linked: Mapping[int, list[int]], reach: float, progress: Callable[[float], None]
    ) -> list[Link]:
        """Links of all places with others near by (`_neighbours`). linked: those that each is
        linked with already."""
        others = np.array(self.poses)[:, :2]
        found: list[Link] = []
        for k in range(len(self.places)):
            found += self._neighbours(k, others, reach, linked.get(k, []))
            progress(k / len(self.places))
        return found

    def _neighbours(self, k: int, others: Floats, reach: float, linked: list[int]) -> list[Link]:
        """Links of a place with up to three groups of others near by, but not in time, nor where it
        is linked already; `reach`: association distance of the first iteration [m]."""
        here = self.poses[k]
        gaps = np.hypot(others[:, 0] - here.x, others[:, 1] - here.y)
        gaps[max(0, k - PARAMS.submap) : k + PARAMS.submap] = math.inf
        links: list[Link] = []
        own: FlatPoints | None = None
        for _ in range(3):
            i = int(gaps.argmin())
            if gaps[i] > PARAMS.others:
                break
            gaps[max(0, i - 20) : i + 20] = math.inf
            if any(abs(i - a) < 20 for a in linked):
                continue
            # submaps are put together at last: of what has drifted, fewer places are one
            numbers = self._around(i, PARAMS.submap // 2 if reach < _SAME else 5)
            known = self.surfaces_around(numbers, self.poses[i], reach)
            if own is None:
                own = thinned(self._seen_from(self._around(k, PARAMS.submap // 2), here), 0.04)
            link = self._linked(i, k, known, own, between(self.poses[i], here), reach)
            if link is not None:
                links.append(link)
        return links

    def _around(self, k: int, half: int) -> range:
        """So many places before and after one."""
        return range(max(0, k - half), min(len(self.poses), k + half + 1))

    def _seen_from(self, numbers: Sequence[int], origin: Pose | None) -> FlatPoints:
        """Points and normals of some places, in the frame of the map or of a pose in it."""
        seen: list[FlatPoints] = []
        for i in numbers:
            pose = self.poses[i] if origin is None else between(origin, self.poses[i])
            seen.append(seen_from(pose, self.places[i].flat))
        return stacked(seen)

    def _linked(
        self, a: int, b: int, known: Surfaces, own: FlatPoints, guess: Pose, reach: float
    ) -> Link | None:
        """The link of place b matched against the surfaces known around a, if it fits.

        own: points and normals around b, in its frame.
        """
        flat = self.places[b].flat
        if len(flat.points) < 30 or len(known.points) < 30 or self.separated(a, b):
            return None
        loose = np.diag([100.0, 100.0, 400.0])
        params = MatchParams(reach=reach, rounds=30)
        fit = align(known, flat, guess, loose, params)
        information = observed(known, flat, fit.pose, params)
        sizes, axes = np.linalg.eigh(information[:2, :2])
        if sizes[0] < PARAMS.firm and reach < _SAME:  # submaps are put together by then
            axis, beside = np.ascontiguousarray(axes.T)
            shift = shifted(known, own, fit.pose, axis, PARAMS.search, params.share)
            if shift.lead > math.log(_ODDS) and abs(shift.along) > params.least:
                # what the match holds to is not what it saw there; each place of the submap has
                # its share of what that shows
                more = shift.information / PARAMS.submap * np.outer(axis, axis)
                loose[:2, :2] = more + 100.0 * np.outer(beside, beside)
                x, y = (np.array(fit.pose[:2]) + shift.along * axis).tolist()
                there, params = Pose(x, y, fit.pose.psi), params._replace(reach=_BESIDE)
                fit = align(known, flat, there, loose, params)
                information = observed(known, flat, fit.pose, params)
                information[:2, :2] += more
        if fit.share < PARAMS.fits or fit.rms > PARAMS.rms:
            return None
        return loop_link(a, b, fit.pose, information, fit.pose.psi)

    def loop_pairs(self) -> list[tuple[int, int]]:
        """Pairs of scans that were linked by loops."""
        return [
            (self.places[k.a].scan, self.places[k.b].scan)
            for k in self.links if k.loop and abs(k.b - k.a) > PARAMS.again
        ]  # fmt: skip

    def keep_apart(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Remove wrong loops, pairs of scans: no place around the one is linked any more with one
        around the other."""
        scans = [place.scan for place in self.places]
        for pair in pairs:
            a, b = (bisect.bisect_right(scans, scan) - 1 for scan in sorted(pair))
            self._apart.append((a, b))
        self._unlink()

    def leave_out(self, scans: Sequence[int]) -> None:
        """No place among these scans is linked with any but those just before and after it."""
        chosen = set(scans)
        self._left_out |= {k for k, place in enumerate(self.places) if place.scan in chosen}
        self._unlink()

    def _unlink(self) -> None:
        every = [*self.links, *self._rejected]
        kept = [link for link in every if not (link.loop and self.separated(link.a, link.b))]
        if len(kept) == len(every):
            return
        self.links, self._rejected = kept, []
        if any(link.loop for link in kept):
            self.select_consistent()
        else:
            self.solve()

    def separated(self, a: int, b: int) -> bool:
        """Whether the user separated the surroundings of two places."""
        if a in self._left_out or b in self._left_out:
            return True
        if not self._apart:
            return False
        off = np.abs(np.array(self._apart) - (min(a, b), max(a, b)))
        return bool((off <= PARAMS.submap).all(axis=1).any())

    def state(self) -> dict[str, NDArray[Any]]:
        """State for `restore`, without that of `keep_apart` and `leave_out`."""
        places, held = self.places, [link for group in self._candidates for link in group]
        return {
            "scan": np.array([p.scan for p in places], dtype=np.int64),
            "size": np.array([len(p.flat.points) for p in places], dtype=np.int64),
            "points": np.vstack([np.empty((0, 2)), *(p.flat.points for p in places)]),
            "across": np.vstack([np.empty((0, 2)), *(p.flat.normals for p in places)]),
            "poses": np.array(self.poses, dtype=np.float64).reshape(-1, 3),
            "links": rows(self.links), "outvoted": rows(self._rejected), "maybe": rows(held),
            "held": np.array([len(group) for group in self._candidates], dtype=np.int64),
            "ways": np.array(self.ways),
        }  # fmt: skip

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a `state`. ValueError where its arrays do not belong together: compiled
        code would read past the end of one."""
        n, size, links = len(state["scan"]), state["size"], state["links"]
        shapes = {
            "size": (n,), "points": (int(size.sum()), 2), "across": (int(size.sum()), 2),
            "poses": (n, 3), "ways": (n,), "links": (len(links), 15),
        }  # fmt: skip
        for name, shape in shapes.items():
            if state[name].shape != shape or not np.isfinite(state[name]).all():
                raise ValueError(f"{name} is not {shape}")
        if (size < 0).any() or not ((links[:, :2] >= 0) & (links[:, :2] < n)).all():
            raise ValueError("places that there are not")
        ends = np.cumsum(state["size"])[:-1]
        self.places = [
            Place(int(scan), FlatPoints(points, normals)) for scan, points, normals in zip(
                state["scan"], np.split(state["points"], ends), np.split(state["across"], ends),
                strict=True,
            )
        ] if len(state["scan"]) else []  # fmt: skip
        self.poses = [Pose(*row) for row in state["poses"].tolist()]
        self.ways = state["ways"].tolist()
        self.links, self._rejected = from_rows(state["links"]), from_rows(state["outvoted"])
        held = iter(from_rows(state["maybe"]))
        self._candidates = [[next(held) for _ in range(n)] for n in state["held"].tolist()]


def _apart(a: Pose, b: Pose) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def agree(a: Pose, b: Pose) -> bool:
    """Whether two poses are the same, within a typical correction by the graph."""
    return math.hypot(a.x - b.x, a.y - b.y) < _SAME and abs(wrap(a.psi - b.psi)) < 0.1
