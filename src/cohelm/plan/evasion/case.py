"""All that candidate motions are held against: movers, what stands, and the course ahead."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose
from cohelm.law.govern import CourseClock
from cohelm.law.guard.surroundings import Surroundings
from cohelm.plan.course import Course, window
from cohelm.plan.evasion.params import EvasionParams
from cohelm.plan.evasion.standing import CELL, Field, distance_at, field_about, outline_points
from cohelm.robot.limits import Limits

_FARTHEST = 6.0  # what stands farther away than this is not looked at [m]


class Case(NamedTuple):
    """All that candidates are held against."""

    ahead: Floats
    """(k, m, 7), the movers as they are foretold; see `risk.trajectories`."""
    movers: Floats
    """(m, 13): x, y, vx, vy, radius, the acceleration that the filter takes it to be capable of,
    how fast doubt of where it is grows, the acceleration that it has and for how long, the speed
    that it may reach, how long the robot takes to be out of its way, and by how much the filter
    takes its velocity to be off."""
    field: Field
    way: Floats
    """(k, 3): x, y, what is left of the course from there [m]."""
    outline: Floats
    edge: Floats
    """(e, 2), points all along the outline, body frame."""
    reach: float
    inner: float
    still: float
    """Clearance to what stands that is asked for: no more than there is now [m]."""


@jit
def case_at(
    ahead: Floats, movers: Floats, around: Surroundings, pose: Pose, course: Course,
    clock: CourseClock, outline: Floats, reach: float, limits: Limits, e: EvasionParams,
) -> Case:  # fmt: skip
    """All that candidates are held against, for a robot at this pose."""
    edge = outline_points(outline)
    inner = math.inf
    for i in range(len(edge)):
        inner = min(inner, math.hypot(edge[i, 0], edge[i, 1]))
    fast = min(e.speed, limits.speed)
    field = field_about(around, pose, min(fast * e.horizon, _FARTHEST) + reach + 2.0 * CELL)
    case = Case(ahead, movers, field, _way(course, clock), outline, edge, reach, inner, 0.0)
    now = _room(case, pose)
    still = min(e.static_clearance + CELL, now - 0.25 * CELL)
    return Case(ahead, movers, field, case.way, outline, edge, reach, inner, still)


@jit
def _way(course: Course, clock: CourseClock) -> Floats:
    """The course ahead, every 20 cm for 8 m, and how much of it is left from there."""
    poses = course.poses
    first, end = window(course, clock.tau, 8.0)
    n = (end - 1 - first) // 4 + 1
    way = np.empty((n + 1, 3))
    k = 0
    for i in range(first, end, 4):
        way[k, 0], way[k, 1] = poses[i, 0], poses[i, 1]
        k += 1
    way[k, 0], way[k, 1] = poses[end - 1, 0], poses[end - 1, 1]
    way[k, 2] = 0.0
    for i in range(k - 1, -1, -1):
        way[i, 2] = way[i + 1, 2] + math.hypot(way[i + 1, 0] - way[i, 0], way[i + 1, 1] - way[i, 1])
    return way[: k + 1]


@jit_inline
def _room(case: Case, pose: Pose) -> float:
    """Clearance of the outline to what stands, by the grid; no more than 1 m is told apart [m]."""
    least = 1.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(case.edge)):
        ex, ey = case.edge[i, 0], case.edge[i, 1]
        least = min(
            least, distance_at(case.field, pose.x + c * ex - s * ey, pose.y + s * ex + c * ey)
        )
    return least


@jit_inline
def blocked(case: Case, pose: Pose) -> bool:
    """Whether something stands in the way of the outline."""
    middle = distance_at(case.field, pose.x, pose.y)
    if middle > case.reach + case.still:
        return False
    return middle < 0.9 * case.inner or _room(case, pose) < case.still


@jit_inline
def to_go(case: Case, pose: Pose) -> float:
    """About how far it is from there to the end of the course ahead [m]."""
    least = math.inf
    for i in range(len(case.way) - 1, -1, -1):
        if case.way[i, 2] >= least:
            break
        dx, dy = case.way[i, 0] - pose.x, case.way[i, 1] - pose.y
        least = min(least, case.way[i, 2] + 1.2 * math.sqrt(dx * dx + dy * dy))
    return least
