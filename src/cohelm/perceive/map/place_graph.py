"""Places of a drive, the links between them, and which of the loops among these are believed.

No loop is believed for ever: where one comes to contradict others, those that can be true together
are found among all that ever were believed.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.mapper_params import MapperParams
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
from cohelm.perceive.match.scan_matching import MatchParams, align
from cohelm.perceive.match.surfaces import Surfaces, moved, surfaces, thinned

_SAME = 0.5  # a graph moves places by less, in the main [m]
_CLOSED = 0.25  # and once all that see the same are linked, they are not farther off [m]


class Place(NamedTuple):
    """Number of its scan, and its surfaces in the body frame."""

    scan: int
    points: Floats
    across: Floats


@dataclass
class PlaceGraph:
    """Of one drive, or of some that go on from each other."""

    care: MapperParams = field(default_factory=MapperParams)
    matching: MatchParams = field(default_factory=MatchParams)

    def __post_init__(self) -> None:
        self.places: list[Place] = []
        self.poses: list[Pose] = []
        self.ways: list[float] = []  # driven until there [m]
        self.links: list[Link] = []
        self._maybe: list[list[Link]] = []  # loops that say the same, not yet believed
        self._outvoted: list[Link] = []
        self._apart: list[tuple[int, int]] = []  # places that somebody says are not the same,
        self._out: set[int] = set()  # and those that are to be left out

    def __len__(self) -> int:
        return len(self.places)

    def add(self, place: Place, pose: Pose, step: Link | None) -> None:
        """One more. step: from the last one to it."""
        if step is not None:
            self.links.append(step)
            self.ways.append(self.ways[-1] + math.hypot(step.pose.x, step.pose.y))
        else:
            self.ways.append(0.0)
        self.places.append(place)
        self.poses.append(pose)

    def around(self, numbers: Sequence[int], origin: Pose | None) -> Surfaces:
        """The surfaces of some places, in the frame of the map or of a pose in it."""
        points: list[Floats] = []
        across: list[Floats] = []
        for i in numbers:
            pose = self.poses[i] if origin is None else between(origin, self.poses[i])
            points.append(moved(pose, self.places[i].points, True))
            across.append(moved(pose, self.places[i].across, False))
        kept, sides = thinned(np.vstack(points), np.vstack(across), 0.04)
        return surfaces(kept, sides, 0.05, 0.65)

    def solve(self) -> None:
        """Make the places agree with all links."""
        self.poses = solved(self.poses, self.links)

    def believe(self, loops: Sequence[Link], torn: bool) -> None:
        """Loops that agree with the drive. torn: whether the places are to be moved for them."""
        self.links += loops
        if torn:
            self.solve()

    def doubt(self, link: Link) -> bool:
        """A loop that disagrees with the drive: believed with others that say the same. Whether
        it is.

        A scan in between that fits nowhere is no evidence against them. What says the same of an
        old place whose way from theirs is not known says it by chance.
        """
        there = self.there(link)
        held = [link]
        for one in self._maybe:
            since = between(self.poses[one[-1].b], self.poses[link.b])
            same = agree(compose(self.there(one[-1]), since), there)
            if same and self._known(one[-1].a, link.a):
                self._maybe = [other for other in self._maybe if other is not one]
                held = [*one, link]
                break
        if self.ways[link.b] - self.ways[held[0].b] < self.care.holds:
            self._maybe.append(held)
            return False
        # far off, a robust kernel hardly pulls: first without, then all together with it
        sure = [one._replace(loop=False) for one in held]
        self.poses = solved(self.poses, [*self.links, *sure])
        self.links += held
        self.solve()
        loops = [one for one in self.links if one.loop]
        if any(contradicted(self.poses, one) for one in loops) or self._outvoted:
            self.agree_again()
        return any(one is link for one in self.links)

    def _known(self, a: int, b: int) -> bool:
        """Whether the links tell where place b is as seen from place a, to what `agree` asks."""
        unsure = spread(self.poses, self.links, a)[b, :2, :2]
        return math.sqrt(float(np.linalg.eigvalsh(unsure)[-1])) < _SAME

    def agree_again(self) -> None:
        """Sort out which of all loops that ever were believed can be true together."""
        every = [*self.links, *self._outvoted]
        if not any(link.loop for link in every):
            return
        self.links = consistent(self.poses, every)
        kept = {id(link) for link in self.links}
        self._outvoted = [link for link in every if id(link) not in kept]
        sure = [link._replace(loop=False) for link in self.links]
        self.poses = solved(self.poses, sure)
        self.solve()

    def there(self, link: Link) -> Pose:
        """Where a link puts its second place."""
        return compose(self.poses[link.a], link.pose)

    def link_all(self, tell: Callable[[float], None], torn: bool) -> None:
        """Link all places that see the same. torn: two laps may lie beside each other, and the
        loops from before still count."""
        links = self.links if torn else [link for link in self.links if not link.loop]
        others, reach = np.array(self.poses)[:, :2], _SAME if torn else _CLOSED
        found: list[Link] = []
        for i in range(len(self.places)):
            found += self._neighbours(i, others, reach)
            tell(i / len(self.places))
        self.links = links + found
        if torn:  # first, what lies far off is pulled as well
            self.poses = solved(self.poses, self.links, _SAME / float(ROUGH[0]))
        self.solve()

    def _neighbours(self, k: int, others: Floats, reach: float) -> list[Link]:
        """Links of a place with up to three groups of others that are near, but not in time; at
        first, surfaces are looked for within `reach` [m]."""
        here = self.poses[k]
        gaps = np.hypot(others[:, 0] - here.x, others[:, 1] - here.y)
        gaps[max(0, k - self.care.submap) : k + self.care.submap] = math.inf
        links: list[Link] = []
        for _ in range(3):
            i = int(gaps.argmin())
            if gaps[i] > self.care.others:
                break
            numbers = range(max(0, i - 5), min(len(self.poses), i + 6))
            gaps[max(0, i - 20) : i + 20] = math.inf
            around = self.around(numbers, self.poses[i])
            link = self._linked(i, k, around, between(self.poses[i], here), reach)
            if link is not None:
                links.append(link)
        return links

    def _linked(self, a: int, b: int, around: Surfaces, guess: Pose, reach: float) -> Link | None:
        """Place b matched against the surroundings of a, if it fits."""
        points, across = self.places[b].points, self.places[b].across
        if len(points) < 30 or len(around.points) < 30 or self.parted(a, b):
            return None
        loose = np.diag([100.0, 100.0, 400.0])
        care = self.matching._replace(reach=reach, rounds=30)
        fit = align(around, points, across, guess, loose, care)
        if fit.share < self.care.fits or fit.rms > self.care.rms:
            return None
        return loop_link(a, b, fit.pose, fit.information, fit.pose.psi)

    def met(self) -> list[tuple[int, int]]:
        """Pairs of scans that were linked, though not for having come one after the other."""
        return [
            (self.places[k.a].scan, self.places[k.b].scan)
            for k in self.links if k.loop and abs(k.b - k.a) > self.care.again
        ]  # fmt: skip

    def keep_apart(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Pairs of scans that did not meet: no place around the one of a pair is linked any more
        with one around the other."""
        scans = [place.scan for place in self.places]
        for pair in pairs:
            a, b = (bisect.bisect_right(scans, scan) - 1 for scan in sorted(pair))
            self._apart.append((a, b))
        self._unlink()

    def leave_out(self, scans: Sequence[int]) -> None:
        """No place among these scans is linked with any but those just before and after it."""
        chosen = set(scans)
        self._out |= {k for k, place in enumerate(self.places) if place.scan in chosen}
        self._unlink()

    def _unlink(self) -> None:
        every = [*self.links, *self._outvoted]
        kept = [link for link in every if not (link.loop and self.parted(link.a, link.b))]
        if len(kept) == len(every):
            return
        self.links, self._outvoted = kept, []
        if any(link.loop for link in kept):
            self.agree_again()
        else:
            self.solve()

    def parted(self, a: int, b: int) -> bool:
        """Whether somebody says that what is around place a is not what is around place b."""
        if a in self._out or b in self._out:
            return True
        if not self._apart:
            return False
        off = np.abs(np.array(self._apart) - (min(a, b), max(a, b)))
        return bool((off <= self.care.submap).all(axis=1).any())

    def state(self) -> dict[str, NDArray[Any]]:
        """All that `restore` goes on from, but what was told by `keep_apart` and `leave_out`."""
        places, held = self.places, [link for one in self._maybe for link in one]
        return {
            "scan": np.array([p.scan for p in places], dtype=np.int64),
            "size": np.array([len(p.points) for p in places], dtype=np.int64),
            "points": np.vstack([np.empty((0, 2)), *(p.points for p in places)]),
            "across": np.vstack([np.empty((0, 2)), *(p.across for p in places)]),
            "poses": np.array(self.poses, dtype=np.float64).reshape(-1, 3),
            "links": rows(self.links), "outvoted": rows(self._outvoted), "maybe": rows(held),
            "held": np.array([len(one) for one in self._maybe], dtype=np.int64),
            "ways": np.array(self.ways),
        }  # fmt: skip

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on where another was when it told its `state`."""
        ends = np.cumsum(state["size"])[:-1]
        self.places = [
            Place(int(scan), points, across) for scan, points, across in zip(
                state["scan"], np.split(state["points"], ends), np.split(state["across"], ends),
                strict=True,
            )
        ] if len(state["scan"]) else []  # fmt: skip
        self.poses = [Pose(*row) for row in state["poses"].tolist()]
        self.ways = state["ways"].tolist()
        self.links, self._outvoted = from_rows(state["links"]), from_rows(state["outvoted"])
        held = iter(from_rows(state["maybe"]))
        self._maybe = [[next(held) for _ in range(n)] for n in state["held"].tolist()]


def agree(a: Pose, b: Pose) -> bool:
    """Whether two poses are one, but for what a graph moves places by."""
    return math.hypot(a.x - b.x, a.y - b.y) < _SAME and abs(wrap(a.psi - b.psi)) < 0.1
