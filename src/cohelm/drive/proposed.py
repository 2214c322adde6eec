"""Checks way-points or a goal that somebody proposes: can the robot go there?"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.law.reference import Reference, through
from cohelm.plan.course import poses_along
from cohelm.plan.distance_field import inscribed_radius, swept_clearances
from cohelm.plan.path_planner import Goal, PathParams, plan_path
from cohelm.plan.zones import Fence, KeepOut

ROOM = 0.05
"""Least gap between the outline and anything known [m]."""
_SPACING = 0.05
_FARTHEST = 200.0
_MOST = 256
"""Way-points of one way: a person sets a few dozen."""
_NEAR = 0.05
_SPARE = 0.02
"""More than the least room is planned with: the curve through the points cuts corners [m]."""
_SPARSE, _DENSE = 0.3, 0.1
"""Between way-points of a way that is planned: where there is room, and where not [m]."""
_THERE = 0.1
"""A goal that is nearer is where the robot stands [m]."""
NONE = 65535
"""No way-point is to blame."""


class CheckedPath(NamedTuple):
    """What is thought of a way."""

    reference: Reference | None
    """The way as it would be followed; None: it can not be."""
    why: str
    worst: int
    """Which way-point is to blame, from 0; 65535: none."""


class PathChecker(NamedTuple):
    """What a way is held against: sent once to where ways are checked."""

    speed: float
    """u_d [m/s]."""
    outline: Floats
    known: Floats
    """(p, 2), surfaces of the map [m]."""
    bounds: Floats
    """(2, 2), its corners [m]."""
    zones: KeepOut | None = None
    """Where no way may lead."""

    def __call__(self, what: Floats | Goal, robot: Pose) -> CheckedPath:
        """`checked_path`, or `planned_path`: up to a second of processor, in a large map some."""
        known = self.known
        if self.zones is not None:
            known = np.vstack((known, Fence(self.zones, self.outline).everywhere(robot)))
        if isinstance(what, Goal):
            if self.zones is not None and self.zones.depth.at(np.array([what]))[0] > 0.0:
                at = f"{what.x:.1f}, {what.y:.1f}"
                return CheckedPath(None, f"the goal {at} is in a keep-out zone", 0)
            return planned_path(what, robot, self.speed, self.outline, known, self.bounds)
        return checked_path(what, robot, self.speed, self.outline, known, self.bounds)


def checked_path(
    points: Floats, robot: Pose, speed: float, outline: Floats, known: Floats, bounds: Floats
) -> CheckedPath:
    """The way from the robot through all points, held against what is known.

    points: (n, 2). known: (p, 2), surfaces of the map [m]. bounds: (2, 2), its corners [m].
    Moving things and small ones are left to the guard, which meets them when they are there.
    """
    if len(points) > _MOST:
        return CheckedPath(None, f"more than {_MOST} way-points: leave some out", NONE)
    for i, point in enumerate(points):
        if len(bounds) and not ((bounds[0] <= point) & (point <= bounds[1])).all():
            return CheckedPath(None, f"way-point {i + 1} is not on the map", i)
    line = np.vstack(((robot.x, robot.y), points))
    steps = np.hypot(*np.diff(line, axis=0).T)
    if float(steps.sum()) > _FARTHEST:
        return CheckedPath(None, f"the way is longer than {_FARTHEST:.0f} m", NONE)
    if steps[0] < _NEAR and len(points) > 1:  # the first one is where the robot stands
        line = np.delete(line, 1, axis=0)
    try:
        reference = through(line, speed)
    except CohelmError as error:
        return CheckedPath(None, str(error), NONE)
    poses = poses_along(reference, _SPACING)
    gaps = swept_clearances(np.ascontiguousarray(known), outline, poses)
    # where the robot stands is not up to the person
    gaps[: math.ceil(0.5 / _SPACING)] = np.maximum(gaps[: math.ceil(0.5 / _SPACING)], ROOM)
    tight = int(np.argmin(gaps))
    if gaps[tight] >= ROOM:
        return CheckedPath(reference, "", NONE)
    tau = reference.duration * tight / (len(poses) - 1)
    leg = int(np.searchsorted(reference.knots, tau, side="left"))
    i = min(max(leg - 1, 0) + len(points) + 1 - len(line), len(points) - 1)
    x, y = poses[tight, :2]
    room = f"{100.0 * gaps[tight]:.0f} cm of room" if gaps[tight] > 0.0 else "something in the way"
    return CheckedPath(None, f"on the way to {i + 1}: {room} at {x:.1f}, {y:.1f}", i)


def planned_path(
    goal: Goal, robot: Pose, speed: float, outline: Floats, known: Floats, bounds: Floats
) -> CheckedPath:
    """A way to a goal around what is known, held against it as `checked_path` does, whose arguments
    it takes. The goal is where it is, with whatever heading the way has there."""
    at = f"{goal.x:.1f}, {goal.y:.1f}"
    point = np.array([goal], dtype=np.float64)
    if len(bounds) and not ((bounds[0] <= point) & (point <= bounds[1])).all():
        return CheckedPath(None, f"the goal {at} is not on the map", 0)
    if len(known):
        gap = float(np.hypot(*(known - point).T).min())
        if gap < inscribed_radius(outline) + ROOM:
            return CheckedPath(None, f"the goal {at} is in a wall, or too near to one", 0)
    far = math.hypot(goal.x - robot.x, goal.y - robot.y)
    if far < _THERE:
        return CheckedPath(None, f"the robot is at {at} already", 0)
    share = np.linspace(0.0, 1.0, math.ceil(far / _DENSE) + 1)[:, None]
    line: Floats = (1.0 - share) * np.array([robot[:2]]) + share * point
    fenced = np.vstack((known, _border(bounds)))
    everywhere = float(np.ptp(bounds, axis=0).max()) if len(bounds) else 0.0
    said = CheckedPath(None, f"no way to {at} is known", 0)
    for border in (PathParams().border, everywhere):
        path_params = PathParams(clearance=ROOM + _SPARE, stray=0.0, beside=0.0, border=border)
        found = plan_path(robot, fenced, line, outline, path_params, farther=False)
        if found is None:
            continue
        for spacing in (_SPARSE, _DENSE):
            every = max(round(spacing / path_params.spacing), math.ceil(len(found.points) / _MOST))
            kept = np.vstack((found.points[every:-1:every], point))
            said = checked_path(kept, robot, speed, outline, known, bounds)
            if said.reference is not None:
                return said
    return said


def _border(bounds: Floats) -> Floats:
    """Points along the edge of the map whose corners these are, (p, 2) [m]."""
    if not len(bounds):
        return np.empty((0, 2))
    x, y = (np.arange(low, high, _SPACING) for low, high in bounds.T)
    sides = [(x, bounds[k, 1]) for k in (0, 1)] + [(bounds[k, 0], y) for k in (0, 1)]
    return np.vstack([np.column_stack(np.broadcast_arrays(*side)) for side in sides])
