"""Mapping (SLAM): matches a drive's scans to submaps, and closes loops.

A scan is matched against the *submap* of the last places; every 0.3 m or rad it becomes a place
itself. Within the possible drift the submap is searched among old places (`loop_closure`). Where it
fits uniquely, a loop is added to the pose graph: at once if it agrees with the drive, else after
confirmation (`place_graph`). At the end every place is linked with all that see the same walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Pose
from cohelm.perceive.map.loop_closure import LoopClosure, revisits
from cohelm.perceive.map.mapper_params import PARAMS
from cohelm.perceive.map.place_graph import Place, PlaceGraph
from cohelm.perceive.map.pose_graph import ROUGH, Link, into_axes, library
from cohelm.perceive.match.odometry_covariance import (
    SCALE,
    OdometryErrors,
    inverted,
    joined,
    predict,
    updated,
)
from cohelm.perceive.match.scan_matching import MatchParams, ScanFit, align
from cohelm.perceive.match.surfaces import FlatPoints, Surfaces, facing, flat_points, one_each
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar

_SET_DOWN = 0.5  # a robot is put back by hand within this of its last position [m]


class MappingResult(NamedTuple):
    """poses: of all scans, the first at the origin. places: numbers of the scans that became
    places. loops: pairs of scans that were linked. scale: factor of odometry distances."""

    poses: list[Pose]
    places: list[int]
    loops: list[tuple[int, int]]
    scale: float


@dataclass
class Mapper:
    """Mapper of one drive: takes its scans in order; `finished` optimizes all of it."""

    lidar: Lidar

    def __post_init__(self) -> None:
        library()  # raises if it is missing, before the work
        self._graph = PlaceGraph()
        self._closure = LoopClosure(self._graph)
        self._scans: list[tuple[int, Pose]] = []  # of each scan: its place, and its pose there
        self._pose = Pose(0.0, 0.0, 0.0)
        self._odometry: Pose | None = None
        wheels = np.diag([SCALE, PARAMS.bend]) ** 2
        self._joint = joined(np.diag([1e-6, 1e-6, 1e-7]), wheels)
        self._wheels = OdometryErrors()
        self._submap: Surfaces | None = None

    @property
    def scans(self) -> int:
        """Number of scans added."""
        return len(self._scans)

    @property
    def places(self) -> int:
        """Number of places."""
        return len(self._graph)

    @property
    def pose(self) -> Pose:
        """Of the newest scan."""
        return self._pose

    def add(self, sweep: DeskewedScan) -> None:
        """Add the next scan of the drive."""
        flat = self._surfaces(sweep)
        if self._submap is None:
            self._odometry = sweep.pose
            self._add_place(flat, None)
            return
        if self._odometry is None:
            self._pose, self._odometry = self._start_pose(flat), sweep.pose
            self._joint = joined(np.diag(ROUGH**2), self._joint[3:, 3:])
        step = self._wheels.corrected(between(self._odometry, sweep.pose))
        self._odometry = sweep.pose
        predicted, joint = predict(self._pose, self._joint, step, PARAMS.mount)
        prior = inverted(joint[:3, :3])
        fit = align(self._submap, flat, predicted, prior, MatchParams())
        if len(flat.points) < 20 or fit.share < 0.3:
            fit = ScanFit(predicted, np.zeros((3, 3)), 0.0, math.inf)
        shift = np.array([
            fit.pose.x - predicted.x, fit.pose.y - predicted.y, wrap(fit.pose.psi - predicted.psi)
        ])  # fmt: skip
        self._wheels = self._wheels.updated_by(joint, shift)
        self._joint = updated(joint, fit.information)
        self._pose = fit.pose
        since = between(self._graph.poses[-1], fit.pose)
        if math.hypot(since.x, since.y) > PARAMS.apart or abs(since.psi) > PARAMS.apart:
            self._add_place(flat, since)
        else:
            self._scans.append((len(self._graph) - 1, since))

    def set_down(self) -> None:
        """The next scan begins another drive, near the end of the last one; its odometry may begin
        anywhere. `add` raises CohelmError if it does not."""
        self._odometry = None

    def finished(self, progress: Callable[[float], None] = lambda share: None) -> MappingResult:
        """Link all places that see the same walls, twice, the second time from the optimized poses,
        and place every scan."""
        graph = self._graph
        if not graph.places:
            raise CohelmError("there is no scan with a wall in it: nothing to map")
        if any(link.loop for link in graph.links):
            graph.select_consistent()
        graph.link_all(lambda share: progress(0.5 * share), move=True)
        self._closure.look_again()
        graph.link_all(lambda share: progress(0.5 + 0.5 * share), move=False)
        made = self.so_far()
        self._pose = made.poses[-1]
        return made

    def so_far(self) -> MappingResult:
        """The scans where they are placed now, without the work of `finished`."""
        graph = self._graph
        poses = [compose(graph.poses[place], pose) for place, pose in self._scans]
        places = [place.scan for place in graph.places]
        return MappingResult(poses, places, graph.loop_pairs(), 1.0 + self._wheels.scale)

    def keep_apart(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Remove wrong loops, pairs of scans as in `MappingResult.loops`: no place around the one
        is linked any more with one around the other."""
        self._graph.keep_apart(pairs)
        self._update_pose()

    def leave_out(self, scans: Sequence[int]) -> None:
        """No place among these scans is linked with any but those just before and after it."""
        self._graph.leave_out(scans)
        self._update_pose()

    def _update_pose(self) -> None:
        """Update the newest pose, after the places may have moved."""
        if self._scans:
            place, since = self._scans[-1]
            self._pose = compose(self._graph.poses[place], since)

    def state(self) -> dict[str, NDArray[Any]]:
        """State for `restored`, without that of `keep_apart` and `leave_out`, as arrays of
        numbers."""
        closure = self._closure
        return {
            **self._graph.state(),
            "scans": np.array([(k, *p) for k, p in self._scans], dtype=np.float64).reshape(-1, 4),
            "pose": np.array(self._pose), "joint": self._joint, "wheels": np.array(self._wheels),
            "odometry": np.array(self._odometry or ()),
            "looked": np.array([closure.looked, closure.wide, closure.met]),
            "strayed": np.array(closure.drift_errors),
        }  # fmt: skip

    @classmethod
    def restored(cls, lidar: Lidar, state: Mapping[str, NDArray[Any]]) -> Self:
        """A mapper that continues from a `state`. KeyError, ValueError, IndexError or TypeError if
        it is invalid."""
        made = cls(lidar)
        made._graph.restore(state)
        made._scans = [(int(k), Pose(*pose)) for k, *pose in state["scans"].tolist()]
        if any(k >= len(made._graph) for k, _ in made._scans) or state["joint"].shape != (5, 5):
            raise ValueError("scans at places that there are not, or no covariance")
        made._pose, made._joint = Pose(*state["pose"].tolist()), state["joint"]
        made._wheels = OdometryErrors(*state["wheels"].tolist())
        made._odometry = Pose(*state["odometry"].tolist()) if len(state["odometry"]) else None
        closure = made._closure
        closure.looked, closure.wide, closure.met = state["looked"].tolist()
        closure.drift_errors = state["strayed"].tolist()
        made._graph.places = [  # those of older versions face either way
            place._replace(flat=facing(place.flat, lidar.mount.x, lidar.mount.y))
            for place in made._graph.places
        ]
        if made._graph.places:
            made._update_submap()
        return made

    def _start_pose(self, flat: FlatPoints) -> Pose:
        """Start pose of a drive that continues where the last one ended: within _SET_DOWN of it and
        turned by a right angle at most, since a corridor looks alike both ways."""
        here = self._pose
        gaps = np.hypot(*(np.array(self._graph.poses)[:, :2] - here[:2]).T)
        known = self._graph.surfaces_around(np.flatnonzero(gaps < PARAMS.behind).tolist(), None)
        near, trail = np.array([_SET_DOWN]), np.array([here[:2]])
        fits = [
            fit for fit in revisits(known, flat, trail, near, here, 0.5 * math.pi)
            if math.hypot(fit.pose.x - here.x, fit.pose.y - here.y) < _SET_DOWN
        ]  # fmt: skip
        alone = len(fits) == 1 or (len(fits) > 1 and fits[1].share < fits[0].share - PARAMS.alone)
        if not alone or fits[0].share < PARAMS.whole or fits[0].rms > PARAMS.rms:
            raise CohelmError(
                "what this drive sees first is not what was seen where the last one ended: begin "
                f"it within {_SET_DOWN:g} m and a right angle of there"
            )
        return fits[0].pose

    def _surfaces(self, sweep: DeskewedScan) -> FlatPoints:
        near = np.hypot(*(sweep.points - self.lidar.mount[:2]).T) < PARAMS.far
        return flat_points(sweep.points[near], sweep.beams[near], self.lidar)

    def _add_place(self, flat: FlatPoints, since: Pose | None) -> None:
        """Add a place; `since`: its pose seen from the last one."""
        graph, k = self._graph, len(self._graph)
        step = self._step(k, since) if since is not None else None
        graph.add(Place(len(self._scans), one_each(flat, 0.04)), self._pose, step)
        self._scans.append((k, Pose(0.0, 0.0, 0.0)))
        self._closure.look()
        self._pose = graph.poses[-1]
        self._update_submap()
        # covariance from here on
        self._joint = joined(np.diag([1e-6, 1e-6, 1e-7]), self._joint[3:, 3:])

    def _step(self, k: int, since: Pose) -> Link:
        distance = math.hypot(since.x, since.y)
        sigma = (0.004 + 0.01 * distance, 0.004 + 0.01 * distance, 0.002 + 0.01 * abs(since.psi))
        weak = into_axes(self._pose, inverted(self._joint[:3, :3]))
        information = inverted(inverted(weak) + np.diag(sigma) ** 2)
        return Link(k - 1, k, since, information, False)

    def _update_submap(self) -> None:
        k = len(self._graph)
        self._submap = self._graph.surfaces_around(range(max(0, k - PARAMS.submap), k), None)


def encounters(made: MappingResult) -> list[list[tuple[int, int]]]:
    """The loops in groups, one for each revisit: a list of pairs of scans, the earlier one first.
    Loops whose ends are within a submap of each other's are one group."""
    if not made.loops:
        return []
    pairs = np.sort(np.array(made.loops, dtype=np.int64), axis=1)
    tree = scipy.spatial.cKDTree(np.searchsorted(made.places, pairs))
    both = tree.query_pairs(PARAMS.submap, p=math.inf, output_type="ndarray")
    n = len(pairs)
    graph = scipy.sparse.csr_array((np.ones(len(both)), both.T), shape=(n, n))
    count, which = scipy.sparse.csgraph.connected_components(graph, directed=False)
    found: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for (a, b), k in zip(pairs.tolist(), which, strict=True):
        found[k].append((a, b))
    return sorted(found, key=lambda one: min(b for _, b in one))
