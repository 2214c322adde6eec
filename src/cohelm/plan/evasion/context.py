"""What candidate motions are evaluated against: movers, static obstacles, and the path ahead."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Floats, Pose
from cohelm.law.govern import CourseClock
from cohelm.plan.course import Course, window
from cohelm.plan.evasion.params import EvasionParams
from cohelm.plan.evasion.static_obstacles import (
    CELL,
    StaticDistances,
    distance_at,
    distance_field_around,
    outline_points,
)
from cohelm.robot.limits import Limits

_FARTHEST = 6.0  # static obstacles farther away than this are ignored [m]


class EvasionContext(NamedTuple):
    """What candidate motions are evaluated against."""

    ahead: Floats
    """(k, m, 7), the predicted movers; see `risk.trajectories`."""
    movers: Floats
    """(m, 13): x, y, vx, vy, radius, max_acceleration, growth rate of the position uncertainty,
    estimated acceleration ax, ay and its duration, speed that it may reach, time that the robot
    takes to get out of its way, and velocity_error."""
    field: StaticDistances
    path: Floats
    """(k, 3): x, y, remaining length of the path from there [m]."""
    outline: Floats
    edge_points: Floats
    """(e, 2), points along the outline, body frame [m]."""
    reach: float
    inscribed_radius: float
    static_clearance: float
    """Required clearance to static obstacles, no more than there is now [m]."""


@jit
def context_at(
    ahead: Floats, movers: Floats, obstacles: Surroundings, pose: Pose, course: Course,
    clock: CourseClock, outline: Floats, reach: float, limits: Limits, e: EvasionParams,
) -> EvasionContext:  # fmt: skip
    """The context of a robot at this pose."""
    edge_points = outline_points(outline)
    inscribed_radius = math.inf
    for i in range(len(edge_points)):
        inscribed_radius = min(inscribed_radius, math.hypot(edge_points[i, 0], edge_points[i, 1]))
    speed = min(e.speed, limits.speed)
    field = distance_field_around(
        obstacles, pose, min(speed * e.horizon, _FARTHEST) + reach + 2.0 * CELL
    )
    context = EvasionContext(
        ahead, movers, field, _sampled_path(course, clock), outline, edge_points, reach,
        inscribed_radius, 0.0,
    )  # fmt: skip
    clearance_now = _static_clearance(context, pose)
    static_clearance = min(e.static_clearance + CELL, clearance_now - 0.25 * CELL)
    return EvasionContext(
        ahead, movers, field, context.path, outline, edge_points, reach, inscribed_radius,
        static_clearance,
    )  # fmt: skip


@jit
def _sampled_path(course: Course, clock: CourseClock) -> Floats:
    """The path ahead, every 20 cm for 8 m, and its remaining length."""
    poses = course.poses
    first, end = window(course, clock.tau, 8.0)
    n = (end - 1 - first) // 4 + 1
    path = np.empty((n + 1, 3))
    k = 0
    for i in range(first, end, 4):
        path[k, 0], path[k, 1] = poses[i, 0], poses[i, 1]
        k += 1
    path[k, 0], path[k, 1] = poses[end - 1, 0], poses[end - 1, 1]
    path[k, 2] = 0.0
    for i in range(k - 1, -1, -1):
        path[i, 2] = path[i + 1, 2] + math.hypot(
            path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        )
    return path[: k + 1]


@jit_inline
def _static_clearance(context: EvasionContext, pose: Pose) -> float:
    """Clearance of the outline to static obstacles, by the grid, capped at 1 m."""
    least = 1.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    edge_points, field = context.edge_points, context.field
    for i in range(len(edge_points)):
        ex, ey = edge_points[i, 0], edge_points[i, 1]
        least = min(least, distance_at(field, pose.x + c * ex - s * ey, pose.y + s * ex + c * ey))
    return least


@jit_inline
def blocked(context: EvasionContext, pose: Pose) -> bool:
    """Whether a static obstacle is too near to the outline."""
    middle = distance_at(context.field, pose.x, pose.y)
    if middle > context.reach + context.static_clearance:
        return False
    return (
        middle < 0.9 * context.inscribed_radius
        or _static_clearance(context, pose) < context.static_clearance
    )


@jit_inline
def path_left(context: EvasionContext, pose: Pose) -> float:
    """Approximate distance from a pose to the end of the path ahead [m]."""
    least = math.inf
    path = context.path
    for i in range(len(path) - 1, -1, -1):
        if path[i, 2] >= least:
            break
        dx, dy = path[i, 0] - pose.x, path[i, 1] - pose.y
        least = min(least, path[i, 2] + 1.2 * math.sqrt(dx * dx + dy * dy))
    return least
