"""Receives goals, paths and initial poses on topics, and checks their frames and numbers.

`drive.on_topics` hands them to the path check, or to localization.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.plan.path_planner import Goal
from cohelm.ros import messages
from cohelm.ros.localized import NODE, PATH, POSE
from cohelm.ros.names import resolved
from cohelm.ros.port import LATCHED, Qos, Received, Transport
from cohelm.ros.transforms import yaw_of

GOAL = "geometry_msgs/msg/PoseStamped"
ONCE = Qos(reliable=True, depth=5)
"""Of what is published once: it must not be lost."""
_STEP = 0.25
"""Between two poses of a path that are kept, at least [m]."""
_MOST = 250
"""So many poses of a path are kept."""
_MOST_WAITING = 20
"""Sentences that wait to be said."""
_SAME, _SAME_END = 0.25, 0.1
"""A path that is nowhere farther from the route, and ends as near to its end, is no new one [m]."""
_SURE, _LEAST, _MOST_SIGMA = 0.3, 0.05, 1.0
"""Standard deviation of an initial pose that states none, and limits of a stated one [m]."""


class Placed(NamedTuple):
    """An initial pose."""

    topic: str
    pose: Pose
    """In the map."""
    sigma: float
    """[m]"""


class Goals:
    """The newest message of each kind on the topics that the user named."""

    def __init__(
        self, transport: Transport, frame: str, ways: Sequence[str], initial: str,
        log: Callable[[str], None], namespace: str = "/",
    ) -> None:  # fmt: skip
        """ways: topics of goals (PoseStamped) or paths (Path). initial: of initial poses; empty:
        none. frame: the map's, in which all of it has to be. log: receives what is refused, and
        why; it is also published. CohelmError for an invalid topic name."""
        self.frame, self._log = frame, log
        self.route: Floats = np.empty((0, 2))
        """(m, 2), the route that is followed: a path that is the same is no new one [m]."""
        self._executor = ThreadPoolExecutor(1, "goals")
        self._waiting, self._closed = 0, False
        self._lock = threading.Lock()
        self._way: tuple[str, Goal | Floats] | None = None
        self._initial: Placed | None = None
        self._reason = transport.publish(
            resolved(f"{NODE}/reason", namespace), messages.STRING, LATCHED
        )
        self.ways = tuple(resolved(name, namespace) for name in ways)
        kept = [(topic, GOAL, self._goal) for topic in self.ways]
        kept += [(topic, PATH, self._path) for topic in self.ways]
        if initial:
            kept.append((resolved(initial, namespace), POSE, self._initial_pose))
        for topic, kind, keep in kept:
            transport.subscribe(topic, kind, ONCE, partial(self._take, topic, keep))

    def way(self) -> tuple[str, Goal | Floats] | None:
        """The newest way and its topic, once: a goal, or waypoints (n, 2) [m]."""
        with self._lock:
            made, self._way = self._way, None
        return made

    def initial(self) -> Placed | None:
        """The newest initial pose, once."""
        with self._lock:
            made, self._initial = self._initial, None
        return made

    def report(self, topic: str, what: str) -> None:
        """What became of something on a topic, in a sentence; returns at once."""
        self.note(f"{topic}: {what}")

    def note(self, text: str) -> None:
        """Logs and publishes a sentence; returns at once. What comes faster than it can be said is
        left out."""
        with self._lock:
            if self._closed or self._waiting >= _MOST_WAITING:
                return
            self._waiting += 1
            self._executor.submit(self._say, text)

    def close(self) -> None:
        """Publish no more."""
        with self._lock:
            self._closed = True
        self._executor.shutdown()

    def _say(self, text: str) -> None:
        try:
            with suppress(CohelmError):  # the transport is closed
                self._reason.send(messages.reason(text))
            self._log(text)
        finally:
            with self._lock:
                self._waiting -= 1

    def _take(self, topic: str, keep: Callable[[str, Any], None], received: Received) -> None:
        """Keep what a message says, or report what is wrong with it."""
        try:
            if received.message is None:
                raise CohelmError(received.damage)
            keep(topic, received.message)
        except CohelmError as error:
            self.report(topic, str(error))

    def _goal(self, topic: str, message: Any) -> None:
        _check_frames((message.header,), self.frame)
        at = message.pose.position
        if not (math.isfinite(at.x) and math.isfinite(at.y)):
            raise CohelmError("the goal is not a number")
        with self._lock:
            self._way = topic, Goal(float(at.x), float(at.y))

    def _path(self, topic: str, message: Any) -> None:
        poses: list[Any] = message.poses
        _check_frames((message.header, *(one.header for one in poses)), self.frame, True)
        if not poses:
            raise CohelmError("the path is empty")
        places = [(one.pose.position.x, one.pose.position.y) for one in poses]
        points: Floats = np.array(places, dtype=np.float64)
        if not np.isfinite(points).all():
            raise CohelmError("the path has a pose that is not a number")
        if not _same(made := thinned(points), self.route):
            with self._lock:
                self._way = topic, made

    def _initial_pose(self, topic: str, message: Any) -> None:
        _check_frames((message.header,), self.frame)
        made = placed(topic, message.pose)
        with self._lock:
            self._initial = made


def placed(topic: str, message: Any) -> Placed:
    """Of a `geometry_msgs/msg/PoseWithCovariance`. CohelmError for what is none."""
    at, psi = message.pose.position, yaw_of(message.pose.orientation)
    if not (math.isfinite(at.x) and math.isfinite(at.y)):
        raise CohelmError("the initial pose is not a number")
    if math.isnan(psi):
        raise CohelmError("the initial pose's orientation is no rotation")
    worst = max(float(message.covariance[0]), float(message.covariance[7]))
    if not math.isfinite(worst) or worst < 0.0:
        raise CohelmError("the initial pose's covariance is invalid")
    sigma = min(max(math.sqrt(worst), _LEAST), _MOST_SIGMA) if worst > 0.0 else _SURE
    return Placed(topic, Pose(float(at.x), float(at.y), psi), sigma)


def thinned(points: Floats) -> Floats:
    """Of (n, 2) those some way apart, and the last one; at most 250."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate((np.zeros(1), np.cumsum(steps)))
    step = max(_STEP, float(along[-1]) / (_MOST - 2))
    _, first = np.unique(np.floor(along / step), return_index=True)
    kept = points[first]
    if len(points) > 1 and float(np.hypot(*(points[-1] - kept[-1]))) > 1e-6:
        close = len(kept) > 1 and float(np.hypot(*(points[-1] - kept[-1]))) < 0.5 * step
        kept = np.vstack((kept[:-1] if close else kept, points[-1:]))
    return np.ascontiguousarray(kept)


def _same(points: Floats, route: Floats) -> bool:
    """Whether a path leads where the route does, on the same way."""
    if not len(route) or float(np.hypot(*(points[-1] - route[-1]))) > _SAME_END:
        return False
    off = points[:: max(len(points) // 60, 1), None] - route[None, :]
    return float(np.hypot(off[..., 0], off[..., 1]).min(axis=1).max()) < _SAME


def _check_frames(headers: Sequence[Any], frame: str, empty: bool = False) -> None:
    """CohelmError where headers have another frame. empty: whether they may be left out, but for
    the first."""
    for i, one in enumerate(headers):
        name = one.frame_id.lstrip("/")
        if name != frame and not (empty and i and not name):
            raise CohelmError(
                f"it is in the frame {name!r}, and the map's is {frame!r}: publish it in that "
                "(RViz: Fixed Frame), or name the map's with --map-frame"
            )
