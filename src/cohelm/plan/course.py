"""The given route, and the path followed now with its speed profile."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.types import Floats, Pose
from cohelm.law.govern import PaceParams, Profile, profile
from cohelm.law.reference import Reference, evaluate
from cohelm.plan.distance_field import swept_clearances

SPACING = 0.05
"""Between poses along a path [m]."""
ROUTE_SPACING = 0.1
"""Between rows of the route [m]."""
_ROWS_AHEAD = 20  # rows of the route among which the robot is searched
_NEARER = 0.3  # a metre of the route passed over has to bring the robot so much nearer [m]
_LEFT_OVER = 2.0  # how far ahead of the last one the nearest point of the route is searched [m]


class Course(NamedTuple):
    """The path that is followed now, with its speeds."""

    reference: Reference
    poses: Floats
    """(n, 3), at times evenly over the reference, both ends included [m, m, rad]."""
    paced: Profile
    """The allowed rate of the clock at each of the poses."""
    row: int
    """Row of the route at which it re-enters the route; 0 for the route itself."""
    rejoins: float
    """Time of its reference at which it does [s]."""
    last: bool
    """Whether it ends at the route's end, or as near to it as possible."""


class Route(NamedTuple):
    """The given reference, also as a polyline."""

    reference: Reference
    line: Floats
    """(m, 2), world frame, evenly spaced [m]."""
    times: Floats
    """(m,), when the reference is there [s]."""


def route(reference: Reference, spacing: float = ROUTE_SPACING) -> Route:
    """The route that a reference describes, as points at most about `spacing` apart [m]."""
    poses = poses_along(reference, 0.25 * spacing)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    along = np.concatenate((np.zeros(1), np.cumsum(steps)))
    n = max(math.ceil(float(along[-1]) / spacing), 1) + 1
    at = np.linspace(0.0, float(along[-1]), n)
    line = np.column_stack([np.interp(at, along, poses[:, c]) for c in (0, 1)])
    every = np.linspace(0.0, reference.duration, len(poses))
    return Route(reference, np.ascontiguousarray(line), np.interp(at, along, every))


def nearly_done(line: Floats, near: float) -> int:
    """The row of a route's line from which on the robot has arrived when `near` its end [m].

    Before it the robot only passes there: a closed route begins at its end. At most a last corner
    is cut off.
    """
    if len(line) < 2:
        return 0
    spacing = math.hypot(line[1, 0] - line[0, 0], line[1, 1] - line[0, 1])
    last = len(line) - 1
    left = (near + min(_LEFT_OVER, 0.25 * last * spacing)) / max(spacing, 1e-9)
    return max(math.floor(last - left), min(last, 1))


def course(
    reference: Reference, row: int, last: bool, pace: PaceParams, rejoins: float = 0.0
) -> Course:
    """The path along a reference without obstacles."""
    poses = poses_along(reference, SPACING)
    free = np.full(len(poses), math.inf)
    return Course(reference, poses, profile(reference, free, pace), row, rejoins, last)


def poses_along(reference: Reference, spacing: float) -> Floats:
    """Poses at times evenly over a reference, about `spacing` apart at its speed, (n, 3)."""
    n = max(math.ceil(reference.duration * reference.speed / spacing), 1) + 1
    return _poses(reference, n)


@jit
def _poses(reference: Reference, n: int) -> Floats:
    poses = np.empty((n, 3))
    end = reference.knots[-1]
    for i in range(n):
        m = evaluate(reference.knots, reference.coeffs, end * i / (n - 1))
        poses[i, 0], poses[i, 1], poses[i, 2] = m.x, m.y, math.atan2(m.vy, m.vx)
    return poses


@jit
def paced(
    course: Course, tau: float, far: float, points: Floats, outline: Floats, pace: PaceParams,
    standoff: float = -1.0,
) -> tuple[Course, float]:  # fmt: skip
    """The path with speeds by the obstacles known now, and the smallest clearance of the outline
    [m].

    From the time `tau` on to `far` metres ahead; beyond that it counts as free. points: (p, 2), of
    obstacles [m]. standoff: how far before the first of them that the outline would overlap the
    reference stops; negative: it does not [m].
    """
    n = len(course.poses)
    clearances = np.full(n, math.inf)
    first, end = window(course, tau, far)
    clearances[first:end] = swept_clearances(points, outline, course.poses[first:end])
    least = math.inf
    for i in range(first + 1, end):  # the robot is at the first already
        least = min(least, clearances[i])
    if standoff >= 0.0:
        _stop_before(clearances, course.poses, first, end, standoff)
    made = profile(course.reference, clearances, pace)
    return Course(
        course.reference, course.poses, made, course.row, course.rejoins, course.last
    ), least


@jit_no_refcount
def _stop_before(clearances: Floats, poses: Floats, first: int, end: int, standoff: float) -> None:
    """Write -inf from `standoff` before the first overlap on."""
    for blocked in range(first + 1, end):
        if clearances[blocked] <= 0.0:
            k, way = blocked, 0.0
            while k > first and way < standoff:
                k -= 1
                way += math.hypot(poses[k + 1, 0] - poses[k, 0], poses[k + 1, 1] - poses[k, 1])
            for i in range(k, end):
                clearances[i] = -math.inf
            return


@jit_no_refcount
def window(course: Course, tau: float, far: float) -> tuple[int, int]:
    """The poses from the time `tau` to `far` metres ahead, as first and one past the last."""
    n = len(course.poses)
    first = int(max(tau, 0.0) / course.reference.knots[-1] * (n - 1))
    first = min(first, n - 2)
    end, way = first + 1, 0.0
    while end < n and way < far:
        a, b = course.poses[end - 1], course.poses[end]
        way += math.hypot(b[0] - a[0], b[1] - a[1])
        end += 1
    return first, end


@jit_no_refcount
def row_on_route(line: Floats, pose: Pose, row: int, course: Course, tau: float) -> int:
    """The row of the route's line where the robot is now.

    row: where it was. tau: the time along the course [s]. Until the course re-enters the route, no
    row after that is looked at. The nearest row ahead, but rows are passed over only if that brings
    the robot nearer by `_NEARER` of their length: else a route that crosses or meets itself would
    be cut short there.
    """
    on_route = tau >= course.rejoins
    first = max(row, course.row) if on_route else row
    last = first + _ROWS_AHEAD if on_route else course.row
    best, least = first, math.inf
    for i in range(first, min(last + 1, len(line))):
        passed_over = _NEARER * ROUTE_SPACING * (i - first)
        if passed_over >= least:
            break
        away = passed_over + math.hypot(line[i, 0] - pose.x, line[i, 1] - pose.y)
        if away < least:
            best, least = i, away
    return best
