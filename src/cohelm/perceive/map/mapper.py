"""Mapping (SLAM): puts a drive's scans together step by step, and closes loops.

A scan is matched against the *submap* of the last places; every 0.3 m or rad it becomes a place
itself. As far around as drift may have led astray, the submap is looked for among old places
(`loop_closure`), and where it fits alone, a link of the pose graph says so: at once if that agrees
with the drive, else when it has held for a while (`place_graph`). At the end every place is linked
with all that see the same walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.glimpses import Glimpse
from cohelm.perceive.map.loop_closure import LoopClosure, revisits
from cohelm.perceive.map.mapper_params import MapperParams
from cohelm.perceive.map.place_graph import Place, PlaceGraph
from cohelm.perceive.map.pose_graph import ROUGH, Link, into_axes, library
from cohelm.perceive.match.odometry_covariance import (
    SCALE,
    Wheels,
    inverted,
    joined,
    moved as foretell,
    updated,
)
from cohelm.perceive.match.scan_matching import MatchParams, ScanFit, align
from cohelm.perceive.match.surfaces import Surfaces, normals, thinned
from cohelm.robot.sensors import Lidar

_SET_DOWN = 0.5  # a robot is put back by hand within this of where it stood [m]


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
        self._graph = PlaceGraph(self.care, self.matching)
        self._closure = LoopClosure(self._graph)
        self._scans: list[tuple[int, Pose]] = []  # of each scan: its place, and its pose there
        self._pose = Pose(0.0, 0.0, 0.0)
        self._odometry: Pose | None = None
        wheels = np.diag([SCALE, self.care.bend]) ** 2
        self._joint = joined(np.diag([1e-6, 1e-6, 1e-7]), wheels)
        self._wheels = Wheels()
        self._submap: Surfaces | None = None

    @property
    def scans(self) -> int:
        """So many were added."""
        return len(self._scans)

    @property
    def places(self) -> int:
        """So many of them became places."""
        return len(self._graph)

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
            self._joint = joined(np.diag(ROUGH**2), self._joint[3:, 3:])
        step = self._wheels.corrected(between(self._odometry, glimpse.odometry))
        self._odometry = glimpse.odometry
        foretold, joint = foretell(self._pose, self._joint, step, self.care.mount)
        prior = inverted(joint[:3, :3])
        fit = align(self._submap, points, across, foretold, prior, self.matching)
        if len(points) < 20 or fit.share < 0.3:
            fit = ScanFit(foretold, np.zeros((3, 3)), 0.0, math.inf, False)
        shift = np.array([
            fit.pose.x - foretold.x, fit.pose.y - foretold.y, wrap(fit.pose.psi - foretold.psi)
        ])  # fmt: skip
        self._wheels = self._wheels.learnt(joint, shift)
        self._joint = updated(joint, fit.information)
        self._pose = fit.pose
        since = between(self._graph.poses[-1], fit.pose)
        if math.hypot(since.x, since.y) > self.care.apart or abs(since.psi) > self.care.apart:
            self._found(points, across, since)
        else:
            self._scans.append((len(self._graph) - 1, since))

    def set_down(self) -> None:
        """The next glimpse begins another drive, about where the last one ended; its odometry may
        begin anywhere. `add` raises CohelmError where that is not so."""
        self._odometry = None

    def finished(self, tell: Callable[[float], None] = lambda share: None) -> Surveyed:
        """Link all places that see the same, twice, the second time from where the first put them,
        and place every scan."""
        graph = self._graph
        if not graph.places:
            raise CohelmError("there is no scan with a wall in it: nothing to map")
        if any(link.loop for link in graph.links):
            graph.agree_again()
        graph.link_all(lambda share: tell(0.5 * share), torn=True)
        self._closure.look_again()
        graph.link_all(lambda share: tell(0.5 + 0.5 * share), torn=False)
        poses = [compose(graph.poses[place], pose) for place, pose in self._scans]
        self._pose = poses[-1]
        places = [place.scan for place in graph.places]
        return Surveyed(poses, places, graph.met(), 1.0 + self._wheels.scale)

    def keep_apart(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Pairs of scans that were taken to have met, as `Surveyed.loops` has them, and did not:
        no place around the one of a pair is linked any more with one around the other."""
        self._graph.keep_apart(pairs)
        self._come_along()

    def leave_out(self, scans: Sequence[int]) -> None:
        """No place among these scans is linked with any but those just before and after it."""
        self._graph.leave_out(scans)
        self._come_along()

    def _come_along(self) -> None:
        """Where the newest scan is, now that the places may have moved."""
        if self._scans:
            place, since = self._scans[-1]
            self._pose = compose(self._graph.poses[place], since)

    def state(self) -> dict[str, NDArray[Any]]:
        """All that `restored` goes on from but what was told by `keep_apart` and `leave_out`, as
        arrays of numbers."""
        seen = self._closure
        return {
            **self._graph.state(),
            "scans": np.array([(k, *p) for k, p in self._scans], dtype=np.float64).reshape(-1, 4),
            "pose": np.array(self._pose), "joint": self._joint, "wheels": np.array(self._wheels),
            "odometry": np.array(self._odometry or ()),
            "looked": np.array([seen.looked, seen.wide, seen.met]),
            "strayed": np.array(seen.strayed),
        }  # fmt: skip

    @classmethod
    def restored(cls, lidar: Lidar, state: Mapping[str, NDArray[Any]]) -> Self:
        """One that goes on where another was when it told its `state`. KeyError, ValueError,
        IndexError or TypeError where that is none."""
        made = cls(lidar)
        made._graph.restore(state)
        made._scans = [(int(k), Pose(*pose)) for k, *pose in state["scans"].tolist()]
        made._pose, made._joint = Pose(*state["pose"].tolist()), state["joint"]
        made._wheels = Wheels(*state["wheels"].tolist())
        made._odometry = Pose(*state["odometry"].tolist()) if len(state["odometry"]) else None
        seen = made._closure
        seen.looked, seen.wide, seen.met = state["looked"].tolist()
        seen.strayed = state["strayed"].tolist()
        if made._graph.places:
            made._renew()
        return made

    def _where(self, points: Floats, across: Floats) -> Pose:
        """Where a drive begins that goes on where the last one ended: within _SET_DOWN of it and
        turned by a right angle at most, for a corridor looks alike both ways."""
        c, here = self.care, self._pose
        gaps = np.hypot(*(np.array(self._graph.poses)[:, :2] - here[:2]).T)
        known = self._graph.around(np.flatnonzero(gaps < c.behind).tolist(), None)
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
        graph, k = self._graph, len(self._graph)
        kept, sides = thinned(points, across, 0.04)
        step = self._step(k, since) if since is not None else None
        graph.add(Place(len(self._scans), kept, sides), self._pose, step)
        self._scans.append((k, Pose(0.0, 0.0, 0.0)))
        self._closure.look()
        self._pose = graph.poses[-1]
        self._renew()
        # what follows is measured from here on
        self._joint = joined(np.diag([1e-6, 1e-6, 1e-7]), self._joint[3:, 3:])

    def _step(self, k: int, since: Pose) -> Link:
        """From the last place to place k."""
        way = math.hypot(since.x, since.y)
        sigma = (0.004 + 0.01 * way, 0.004 + 0.01 * way, 0.002 + 0.01 * abs(since.psi))
        weak = into_axes(self._pose, inverted(self._joint[:3, :3]))
        information = inverted(inverted(weak) + np.diag(sigma) ** 2)
        return Link(k - 1, k, since, information, False)

    def _renew(self) -> None:
        k = len(self._graph)
        self._submap = self._graph.around(range(max(0, k - self.care.submap), k), None)


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
