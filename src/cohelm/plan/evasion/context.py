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

_X, _Y, _LEFT = range(3)
"""Columns of the path ahead: a point, and the remaining length of the path from there [m]."""


class EvasionContext(NamedTuple):
    """What candidate motions are evaluated against."""

    ahead: Floats
    """(k, m, 7), the predicted movers, columns from `risk.PX` on."""
    movers: Floats
    """(m, 13), columns from `movers.MX` on."""
    field: StaticDistances
    path: Floats
    """(k, 3), columns from `_X` on."""
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
    clock: CourseClock, outline: Floats, reach: float, limits: Limits, params: EvasionParams,
) -> EvasionContext:  # fmt: skip
    """The context of a robot at this pose."""
    edge_points = outline_points(outline)
    inscribed_radius = math.inf
    for i in range(len(edge_points)):
        inscribed_radius = min(inscribed_radius, math.hypot(edge_points[i, 0], edge_points[i, 1]))
    speed = min(params.speed, limits.speed)
    field = distance_field_around(
        obstacles, pose, min(speed * params.horizon, _FARTHEST) + reach + 2.0 * CELL
    )
    clearance_now = _static_clearance(field, edge_points, pose)
    static_clearance = min(params.static_clearance + CELL, clearance_now - 0.25 * CELL)
    return EvasionContext(
        ahead, movers, field, _sampled_path(course, clock), outline, edge_points, reach,
        inscribed_radius, static_clearance,
    )  # fmt: skip


@jit
def _sampled_path(course: Course, clock: CourseClock) -> Floats:
    """The path ahead, every 20 cm for 8 m, and its remaining length."""
    poses = course.poses
    first, end = window(course, clock.tau, 8.0)
    n = (end - 1 - first) // 4 + 1
    path = np.empty((n + 1, _LEFT + 1))
    k = 0
    for i in range(first, end, 4):
        path[k, _X], path[k, _Y] = poses[i, 0], poses[i, 1]
        k += 1
    path[k, _X], path[k, _Y] = poses[end - 1, 0], poses[end - 1, 1]
    path[k, _LEFT] = 0.0
    for i in range(k - 1, -1, -1):
        path[i, _LEFT] = path[i + 1, _LEFT] + math.hypot(
            path[i + 1, _X] - path[i, _X], path[i + 1, _Y] - path[i, _Y]
        )
    return path[: k + 1]


@jit_inline
def _static_clearance(field: StaticDistances, edge_points: Floats, pose: Pose) -> float:
    """Clearance of the outline to static obstacles, by the grid, capped at 1 m."""
    least = 1.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
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
        or _static_clearance(context.field, context.edge_points, pose) < context.static_clearance
    )


@jit_inline
def path_left(context: EvasionContext, pose: Pose) -> float:
    """Approximate distance from a pose to the end of the path ahead [m]."""
    least = math.inf
    path = context.path
    for i in range(len(path) - 1, -1, -1):
        if path[i, _LEFT] >= least:
            break
        dx, dy = path[i, _X] - pose.x, path[i, _Y] - pose.y
        least = min(least, path[i, _LEFT] + 1.2 * math.sqrt(dx * dx + dy * dy))
    return least
