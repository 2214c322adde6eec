"""Mapping (SLAM): puts a drive's scans together step by step, and closes loops.

A scan is matched against the *submap* of the last places; every 0.3 m or rad it becomes a place
itself. As far around as drift may have led astray, the submap is looked for among old places, and
where it fits alone, a link of the pose graph says so: at once if that agrees with the drive, else
when it has held for a while. At the end every place is linked with all that see the same walls.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import between, compose
from cohelm.core.types import Floats, Ints, Pose, wrap
from cohelm.perceive.map.loop_closure import BESIDE, revisits
from cohelm.perceive.map.pose_graph import Link, consistent, library, off, solved, spread
from cohelm.perceive.match.odometry_covariance import (
    UNKNOWN,
    Wheels,
    inverted,
    joined,
    moved as foretell,
    updated,
)
from cohelm.perceive.match.scan_matching import Fit, MatchParams, align
from cohelm.perceive.match.surfaces import Surfaces, moved, normals, surfaces, thinned
from cohelm.perceive.scan.deskew import sweep
from cohelm.perceive.scan.odometry_buffer import pose_at
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import Lidar


class Glimpse(NamedTuple):
    """One scan of a drive: stamp [s] and odometry pose of its last beam; points (m, 2) in the
    body frame then, and their beams (m,)."""

    stamp: float
    odometry: Pose
    points: Floats
    beams: Ints


class MapperParams(NamedTuple):
    """How a drive is put together."""

    apart: float = 0.3
    """A place is this far, or has turned as much, from the last [m, rad]."""
    submap: int = 15
    """Places that the next scan is matched against."""
    again: int = 35
    """A place is met again if so many lie between."""
    search: float = 1.0
    """Old places are looked for within this and three sigma of where they are [m];"""
    lonely: float = 5.0
    """within nine, each time that no loop was closed for so much way [m]."""
    behind: float = 8.0
    """What was seen from so much farther counts as well, for the submap is as long [m]."""
    every: float = 0.9
    """After so much way a loop is looked for [m]."""
    fits: float = 0.65
    """A loop is closed if this share of the points lies on surfaces,"""
    rms: float = 0.05
    """so near [m],"""
    alone: float = 0.1
    """no other place comes as near to that share,"""
    firm: float = 5e3
    """and the weaker direction has this information [1/m^2]."""
    whole: float = 0.8
    """What disagrees with the drive must explain this share: a corridor explains 0.7 of another;"""
    holds: float = 2.0
    """and it is believed where views so far apart say the same [m]."""
    others: float = 6.0
    """At the end, places are linked if so near to each other [m]."""
    far: float = 15.0
    """Points farther from the LiDAR than this are left out [m]."""


class Place(NamedTuple):
    """Number of its scan, and its surfaces in the body frame."""

    scan: int
    points: Floats
    across: Floats


class Surveyed(NamedTuple):
    """poses: of all scans, the first at the origin. places: numbers of the scans that became
    places. loops: pairs of scans that met. scale: what the odometry's ways are multiplied by."""

    poses: list[Pose]
    places: list[int]
    loops: list[tuple[int, int]]
    scale: float


@dataclass
class Survey:
    """Takes glimpses in order; `finished` puts the last hand to it."""

    lidar: Lidar
    care: MapperParams = field(default_factory=MapperParams)
    matching: MatchParams = field(default_factory=MatchParams)

    def __post_init__(self) -> None:
        library()  # said before the work, not after
        self.places: list[Place] = []
        self.poses: list[Pose] = []
        self.links: list[Link] = []
        self._scans: list[tuple[int, Pose]] = []  # of each scan: its place, and its pose there
        self._pose = Pose(0.0, 0.0, 0.0)
        self._odometry: Pose | None = None
        self._joint = joined(np.diag([1e-6, 1e-6, 1e-7]), UNKNOWN)
        self._wheels = Wheels()
        self._ways: list[float] = []
        # ways at which loops were looked for, far and wide, and one was found
        self._looked = self._wide = self._met = 0.0
        self._maybe: list[list[Link]] = []  # loops that say the same, not yet believed
        self._outvoted: list[Link] = []
        self._apart: list[tuple[int, int]] = []  # places that somebody says are not the same,
        self._out: set[int] = set()  # and those that are to be left out
        self._submap: Surfaces | None = None

    @property
    def scans(self) -> int:
        """So many were added."""
        return len(self._scans)

    @property
    def pose(self) -> Pose:
        """Of the newest scan."""
        return self._pose

    def add(self, glimpse: Glimpse) -> None:
        """The next scan of the drive."""
        points, across = self._surfaces(glimpse)
        if self._submap is None:
            self._odometry = glimpse.odometry
            self._found(points, across, None)
            return
        if self._odometry is None:
            self._pose, self._odometry = self._where(points, across), glimpse.odometry
            self._joint = joined(np.diag(_ROUGH**2), self._joint[3:, 3:])
        step = self._wheels.corrected(between(self._odometry, glimpse.odometry))
        self._odometry = glimpse.odometry
        foretold, joint = foretell(self._pose, self._joint, step)
        prior = inverted(joint[:3, :3])
        fit = align(self._submap, points, across, foretold, prior, self.matching)
        if len(points) < 20 or fit.share < 0.3:
            fit = Fit(foretold, np.zeros((3, 3)), 0.0, math.inf, False)
        shift = np.array([
            fit.pose.x - foretold.x, fit.pose.y - foretold.y, wrap(fit.pose.psi - foretold.psi)
        ])  # fmt: skip
        self._wheels = self._wheels.learnt(joint, shift)
        self._joint = updated(joint, fit.information)
        self._pose = fit.pose
        since = between(self.poses[-1], fit.pose)
        if math.hypot(since.x, since.y) > self.care.apart or abs(since.psi) > self.care.apart:
            self._found(points, across, since)
        else:
            self._scans.append((len(self.places) - 1, since))

    def set_down(self) -> None:
        """The next glimpse begins another drive, about where the last one ended; its odometry may
        begin anywhere. `add` raises CohelmError where that is not so."""
        self._odometry = None

    def finished(self, tell: Callable[[float], None] = lambda share: None) -> Surveyed:
        """Link all places that see the same, twice, and place every scan."""
        if not self.places:
            raise CohelmError("there is no scan with a wall in it: nothing to map")
        if any(link.loop for link in self.links):
            self._agree_again()
        steps = [link for link in self.links if not link.loop]
        for turn in range(2):
            loops = [link for link in self.links if link.loop] if turn == 0 else []
            others = np.array(self.poses)[:, :2]
            for i in range(len(self.places)):
                loops += self._neighbours(i, others)
                tell(0.5 * (turn + i / len(self.places)))
            self.links = steps + loops
            self.poses = solved(self.poses, self.links)
        pairs = [
            (self.places[k.a].scan, self.places[k.b].scan)
            for k in self.links if k.loop and abs(k.b - k.a) > self.care.again
        ]  # fmt: skip
        poses = [compose(self.poses[place], pose) for place, pose in self._scans]
        scans = [place.scan for place in self.places]
        return Surveyed(poses, scans, pairs, 1.0 + self._wheels.scale)

    def keep_apart(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Pairs of scans that were taken to have met, as `Surveyed.loops` has them, and did not:
        no place around the one of a pair is linked any more with one around the other."""
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
        kept = [link for link in every if not (link.loop and self._parted(link.a, link.b))]
        if len(kept) == len(every):
            return
        self.links, self._outvoted = kept, []
        if any(link.loop for link in kept):
            self._agree_again()
        else:
            self._solve()

    def state(self) -> dict[str, NDArray[Any]]:
        """All that `restored` goes on from but what was told by `keep_apart` and `leave_out`, as
        arrays of numbers."""
        places, held = self.places, [link for one in self._maybe for link in one]
        return {
            "scan": np.array([p.scan for p in places], dtype=np.int64),
            "size": np.array([len(p.points) for p in places], dtype=np.int64),
            "points": np.vstack([np.empty((0, 2)), *(p.points for p in places)]),
            "across": np.vstack([np.empty((0, 2)), *(p.across for p in places)]),
            "poses": np.array(self.poses, dtype=np.float64).reshape(-1, 3),
            "scans": np.array([(k, *p) for k, p in self._scans], dtype=np.float64).reshape(-1, 4),
            "links": _rows(self.links), "outvoted": _rows(self._outvoted), "maybe": _rows(held),
            "held": np.array([len(one) for one in self._maybe], dtype=np.int64),
            "pose": np.array(self._pose), "joint": self._joint, "wheels": np.array(self._wheels),
            "odometry": np.array(self._odometry or ()), "ways": np.array(self._ways),
            "looked": np.array([self._looked, self._wide, self._met]),
        }  # fmt: skip

    @classmethod
    def restored(cls, lidar: Lidar, state: Mapping[str, NDArray[Any]]) -> Self:
        """One that goes on where another was when it told its `state`. KeyError, ValueError,
        IndexError or TypeError where that is none."""
        made = cls(lidar)
        ends = np.cumsum(state["size"])[:-1]
        made.places = [
            Place(int(scan), points, across) for scan, points, across in zip(
                state["scan"], np.split(state["points"], ends), np.split(state["across"], ends),
                strict=True,
            )
        ] if len(state["scan"]) else []  # fmt: skip
        made.poses = [Pose(*row) for row in state["poses"].tolist()]
        made._scans = [(int(k), Pose(*pose)) for k, *pose in state["scans"].tolist()]
        made.links, made._outvoted = _links(state["links"]), _links(state["outvoted"])
        held = iter(_links(state["maybe"]))
        made._maybe = [[next(held) for _ in range(n)] for n in state["held"].tolist()]
        made._pose, made._joint = Pose(*state["pose"].tolist()), state["joint"]
        made._wheels, made._ways = Wheels(*state["wheels"].tolist()), state["ways"].tolist()
        made._odometry = Pose(*state["odometry"].tolist()) if len(state["odometry"]) else None
        made._looked, made._wide, made._met = state["looked"].tolist()
        if made.places:
            made._renew()
        return made

    def _parted(self, a: int, b: int) -> bool:
        """Whether somebody says that what is around place a is not what is around place b."""
        if a in self._out or b in self._out:
            return True
        if not self._apart:
            return False
        off = np.abs(np.array(self._apart) - (min(a, b), max(a, b)))
        return bool((off <= self.care.submap).all(axis=1).any())

    def _where(self, points: Floats, across: Floats) -> Pose:
        """Where a drive begins that goes on where the last one ended: within _SET_DOWN of it and
        turned by a right angle at most, for a corridor looks alike both ways."""
        c, here = self.care, self._pose
        gaps = np.hypot(*(np.array(self.poses)[:, :2] - here[:2]).T)
        known = self._around(np.flatnonzero(gaps < c.behind).tolist(), None)
        near, trail = np.array([_SET_DOWN]), np.array([here[:2]])
        fits = [
            fit for fit in revisits(known, points, across, trail, near, here, 0.5 * math.pi)
            if math.hypot(fit.pose.x - here.x, fit.pose.y - here.y) < _SET_DOWN
        ]  # fmt: skip
        alone = len(fits) == 1 or (len(fits) > 1 and fits[1].share < fits[0].share - c.alone)
        if not alone or fits[0].share < c.whole or fits[0].rms > c.rms:
            raise CohelmError(
                "what this drive sees first is not what was seen where the last one ended: begin "
                f"it within {_SET_DOWN:g} m and a right angle of there"
            )
        return fits[0].pose

    def _surfaces(self, glimpse: Glimpse) -> tuple[Floats, Floats]:
        gaps = np.hypot(
            glimpse.points[:, 0] - self.lidar.mount.x, glimpse.points[:, 1] - self.lidar.mount.y
        )
        near = gaps < self.care.far
        return normals(glimpse.points[near], glimpse.beams[near], self.lidar.step)

    def _found(self, points: Floats, across: Floats, since: Pose | None) -> None:
        """A new place; `since`: its pose seen from the last one."""
        k = len(self.places)
        if since is not None:
            way = math.hypot(since.x, since.y)
            sigma = (0.004 + 0.01 * way, 0.004 + 0.01 * way, 0.002 + 0.01 * abs(since.psi))
            weak = _turned(self._pose, inverted(self._spread()))
            information = inverted(inverted(weak) + np.diag(sigma) ** 2)
            self.links.append(Link(k - 1, k, since, information, False))
            self._ways.append(self._ways[-1] + way)
        else:
            self._ways.append(0.0)
        kept, sides = thinned(points, across, 0.04)
        self.places.append(Place(len(self._scans), kept, sides))
        self.poses.append(self._pose)
        self._scans.append((k, Pose(0.0, 0.0, 0.0)))
        if k > self.care.again and self._ways[k] - self._looked >= self.care.every:
            self._looked = self._ways[k]
            self._close(k)
        self._renew()
        # what follows is measured from here on
        self._joint = joined(np.diag([1e-6, 1e-6, 1e-7]), self._joint[3:, 3:])

    def _renew(self) -> None:
        k = len(self.places)
        self._submap = self._around(range(max(0, k - self.care.submap), k), None)

    def _spread(self) -> Floats:
        return self._joint[:3, :3]

    def _around(self, numbers: Sequence[int], origin: Pose | None) -> Surfaces:
        """The surfaces of some places, in the frame of the map or of a pose in it."""
        points: list[Floats] = []
        across: list[Floats] = []
        for i in numbers:
            pose = self.poses[i] if origin is None else between(origin, self.poses[i])
            points.append(moved(pose, self.places[i].points, True))
            across.append(moved(pose, self.places[i].across, False))
        kept, sides = thinned(np.vstack(points), np.vstack(across), 0.04)
        return surfaces(kept, sides, 0.05, 0.65)

    def _close(self, k: int) -> None:
        """Close loops where the newest submap fits old places, and nowhere else among them.

        Places that drift has hardly torn from here are looked at for themselves, so that what
        looks alike far off does not put them in doubt.
        """
        c = self.care
        unsure = spread(self.poses, self.links, k)[: k - c.again]
        far = self._ways[k] - max(self._met, self._wide) > c.lonely
        self._wide = self._ways[k] if far else self._wide
        reach = c.search + (9.0 if far else 3.0) * np.sqrt(
            np.linalg.eigvalsh(unsure[:, :2, :2])[:, -1]
        )
        close = reach < 2.0 * c.search
        newest = self._around(range(max(0, k + 1 - c.submap), k + 1), self.poses[k])
        new: list[Link] = []
        for among in (close, ~close):
            link, share = self._found_again(k, newest, unsure, reach, among)
            if link is None:
                continue
            agrees = _agree(self._there(link), self.poses[k])
            if agrees:
                new.append(link)
            elif share >= c.whole:
                self._far(link)
            if agrees and share >= c.whole:
                self._met = self._ways[k]
        if any(np.abs(off(self.poses, link) @ _PRECISE).max() > 2.0 for link in new):
            self.links += new
            self._solve()
        else:
            self.links += new

    def _solve(self) -> None:
        self.poses = solved(self.poses, self.links)
        self._pose = self.poses[-1]

    def _found_again(
        self, k: int, newest: Surfaces, unsure: Floats, reach: Floats, among: NDArray[np.bool_]
    ) -> tuple[Link | None, float]:
        """Place k seen from an old one among some, where its submap fits there alone, and the share
        of it that does."""
        here, c = self.poses[k], self.care
        trail = np.array(self.poses[: len(reach)])[:, :2]
        gaps = np.hypot(trail[:, 0] - here.x, trail[:, 1] - here.y)
        near = among & (gaps < reach + BESIDE)
        if not near.any():
            return None, 0.0
        old = np.flatnonzero(among & (gaps < reach[near].max() + c.behind))
        known = self._around(old.tolist(), None)
        turn = 0.1 + 3.0 * math.sqrt(float(unsure[near, 2, 2].max()))
        found: list[tuple[float, Fit, int]] = []
        for fit in revisits(
            known, newest.points, newest.normals, trail[near], reach[near], here, turn
        ):
            a = int(old[np.hypot(trail[old, 0] - fit.pose.x, trail[old, 1] - fit.pose.y).argmin()])
            if self._parted(a, k):
                continue
            # what drift makes unlikely has to fit better
            there, seen = self.poses[a], compose(here, between(fit.pose, self.poses[a]))
            d = np.array([seen.x - there.x, seen.y - there.y, wrap(seen.psi - there.psi)])
            odd = float(d @ inverted(unsure[a] + np.diag(_ROUGH**2)) @ d)
            found.append((fit.share - c.alone * min(odd / 9.0, 1.0), fit, a))
        found.sort(key=lambda one: -one[0])
        if not found or (len(found) > 1 and found[1][0] > found[0][0] - c.alone):
            return None, 0.0
        _, fit, a = found[0]
        if fit.share < c.fits or fit.rms > c.rms:
            return None, 0.0
        if np.linalg.eigvalsh(fit.information[:2, :2])[0] < c.firm:
            return None, 0.0
        link = _link(a, k, between(self.poses[a], fit.pose), fit.information, fit.pose.psi)
        return link, fit.share

    def _far(self, link: Link) -> None:
        """A loop that disagrees with the drive: believed with others that say the same.

        A scan in between that fits nowhere is no evidence against them. None is believed for
        ever: where it comes to contradict others, those that can be true together are.
        """
        there = self._there(link)
        held = [link]
        for one in self._maybe:
            since = between(self.poses[one[-1].b], self.poses[link.b])
            if _agree(compose(self._there(one[-1]), since), there):
                self._maybe = [other for other in self._maybe if other is not one]
                held = [*one, link]
                break
        if self._ways[link.b] - self._ways[held[0].b] < self.care.holds:
            self._maybe.append(held)
            return
        # far off, a robust kernel hardly pulls: first without, then all together with it
        sure = [one._replace(loop=False) for one in held]
        self.poses = solved(self.poses, [*self.links, *sure])
        self.links += held
        self._solve()
        loops = [one for one in self.links if one.loop]
        if any(_odd(self.poses, one) for one in loops) or self._outvoted:
            self._agree_again()

    def _agree_again(self) -> None:
        """Sort out which of all loops that ever were believed can be true together."""
        every = [*self.links, *self._outvoted]
        self.links = consistent(self.poses, every)
        kept = {id(link) for link in self.links}
        self._outvoted = [link for link in every if id(link) not in kept]
        sure = [link._replace(loop=False) for link in self.links]
        self.poses = solved(self.poses, sure)
        self._solve()

    def _there(self, link: Link) -> Pose:
        """Where a link puts its second place."""
        return compose(self.poses[link.a], link.pose)

    def _linked(self, a: int, b: int, around: Surfaces, guess: Pose) -> Link | None:
        """Place b matched against the surroundings of a, if it fits."""
        points, across = self.places[b].points, self.places[b].across
        if len(points) < 30 or len(around.points) < 30 or self._parted(a, b):
            return None
        loose = np.diag([100.0, 100.0, 400.0])
        care = self.matching._replace(reach=0.25, rounds=30)
        fit = align(around, points, across, guess, loose, care)
        if fit.share < self.care.fits or fit.rms > self.care.rms:
            return None
        return _link(a, b, fit.pose, fit.information, fit.pose.psi)

    def _neighbours(self, k: int, others: Floats) -> list[Link]:
        """Links of a place with up to three groups of others that are near, but not in time."""
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
            around = self._around(numbers, self.poses[i])
            link = self._linked(i, k, around, between(self.poses[i], here))
            if link is not None:
                links.append(link)
        return links


_ROUGH = np.array([0.01, 0.01, 0.004])  # a match of two submaps is no better [m, rad]
_PRECISE = np.diag(1.0 / _ROUGH)
_CONTRADICTS = 16.3  # squared sigmas that one right loop in a thousand exceeds (chi square, 3)
_SET_DOWN = 0.5  # a robot is put back by hand within this of where it stood [m]
_FARTHEST = 20_000.0  # from one end of a drive's odometry to the other [m]


def _link(a: int, b: int, pose: Pose, information: Floats, psi: float) -> Link:
    """A loop as matched; information: in axes in which place b has heading psi."""
    rough = np.diag(_ROUGH**2)
    weak = _turned(Pose(0.0, 0.0, psi), information) + np.eye(3)
    return Link(a, b, pose, inverted(inverted(weak) + rough), True)


def _rows(links: Sequence[Link]) -> Floats:
    """Links as rows of numbers, (n, 15)."""
    rows = [(k.a, k.b, *k.pose, *k.information.ravel(), k.loop) for k in links]
    return np.array(rows, dtype=np.float64).reshape(-1, 15)


def _links(rows: Floats) -> list[Link]:
    return [
        Link(
            int(row[0]), int(row[1]), Pose(*row[2:5].tolist()), row[5:14].reshape(3, 3), row[14] > 0
        )
        for row in rows
    ]


def encounters(made: Surveyed, near: int = MapperParams().submap) -> list[list[tuple[int, int]]]:
    """The loops, put together where both ends are within so many places of those of another: one
    list of pairs of scans, the earlier one first, for each time that the robot came back."""
    if not made.loops:
        return []
    pairs = np.sort(np.array(made.loops, dtype=np.int64), axis=1)
    tree = scipy.spatial.cKDTree(np.searchsorted(made.places, pairs))
    both = tree.query_pairs(near, p=math.inf, output_type="ndarray")
    n = len(pairs)
    graph = scipy.sparse.csr_array((np.ones(len(both)), both.T), shape=(n, n))
    count, which = scipy.sparse.csgraph.connected_components(graph, directed=False)
    found: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for (a, b), k in zip(pairs.tolist(), which, strict=True):
        found[k].append((a, b))
    return sorted(found, key=lambda one: min(b for _, b in one))


def _odd(poses: list[Pose], link: Link) -> bool:
    e = off(poses, link)
    return float(e @ link.information @ e) > _CONTRADICTS


def _agree(a: Pose, b: Pose) -> bool:
    return math.hypot(a.x - b.x, a.y - b.y) < 0.5 and abs(wrap(a.psi - b.psi)) < 0.1


def _turned(frame: Pose, information: Floats) -> Floats:
    """Information in world axes, put into the axes of a pose."""
    c, s = math.cos(frame.psi), math.sin(frame.psi)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ information @ turn.T, dtype=np.float64)


def glimpses(lidar: Lidar, odometry: Sequence[Odometry], scans: Sequence[Scan]) -> list[Glimpse]:
    """The scans of a drive, each put to the instant of its last beam, with odometry there.

    Scans that end outside the time of the odometry are left out. CohelmError if none is left, or
    where the odometry says that the robot was farther off than any drive gets.
    """
    rows = np.array([[o.stamp, *o.pose, *o.twist] for o in odometry], dtype=np.float64)
    rows = rows[np.isfinite(rows).all(axis=1)].reshape(-1, 6)
    keep = np.concatenate(([True], np.diff(np.maximum.accumulate(rows[:, 0])) > 0))[: len(rows)]
    trail = rows[keep]
    if len(trail) > 1 and float(np.ptp(trail[:, 1:3], axis=0).max()) > _FARTHEST:
        far = float(np.ptp(trail[:, 1:3], axis=0).max())
        raise CohelmError(
            f"the odometry spans {far:.3g} m, and {_FARTHEST:g} m is the most that is mapped: "
            "it is damaged, or the drive is to be cut"
        )
    found: list[Glimpse] = []
    for scan in scans:
        end = scan.stamp + scan.duration
        if not len(trail) or not trail[0, 0] - 0.1 <= end <= trail[-1, 0] + 0.1:
            continue
        if len(scan.ranges) != len(lidar.beams):
            continue
        seen = sweep(lidar, scan.ranges, scan.stamp, scan.duration, trail)
        found.append(Glimpse(end, Pose(*pose_at(trail, end)), seen.points, seen.beams))
    if not found:
        raise CohelmError("no scan came while there was odometry: record both, on one clock")
    return found
