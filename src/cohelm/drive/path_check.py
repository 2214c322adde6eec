"""Checks requested waypoints or a goal: is there a collision-free path for the robot?"""

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
"""Least clearance between the outline and mapped obstacles [m]."""
_SPACING = 0.05
_MAX_LENGTH = 200.0
_MOST = 256
"""Waypoints of one path: a person sets a few dozen."""
_NEAR = 0.05
_EXTRA_ROOM = 0.02
"""Clearance of planning beyond `ROOM`: the curve through the points cuts corners [m]."""
_SPARSE, _DENSE = 0.3, 0.1
"""Spacing of the waypoints of a planned path: in open space, and in narrow places [m]."""
_AT_GOAL = 0.1
"""A goal within this distance is reached already [m]."""
NONE = 65535
"""No waypoint is at fault."""


class CheckedPath(NamedTuple):
    """The result of checking a path."""

    reference: Reference | None
    """The path as it would be followed; None: refused."""
    why: str
    worst: int
    """The waypoint at fault, from 0; 65535: none. Of a goal 0 only if it can not be reached."""


class PathChecker(NamedTuple):
    """What a path is checked against: sent once to the process that checks."""

    speed: float
    """u_d [m/s]."""
    outline: Floats
    known: Floats
    """Surfaces of the map, (p, 2) [m]."""
    bounds: Floats
    """Corners of the map, (2, 2) [m]."""
    zones: KeepOut | None = None
    """Keep-out zones."""

    def __call__(self, what: Floats | Goal, robot: Pose) -> CheckedPath:
        """The path from the robot through all waypoints (n, 2) [m], or to a goal.

        Moving and small obstacles are left to the guard, which sees them when they are there.
        Takes up to a second; some seconds on a large map.
        """
        fenced = self
        if self.zones is not None:
            if isinstance(what, Goal) and self.zones.depth.at(np.array([what]))[0] > 0.0:
                return CheckedPath(None, f"the goal {_text(what)} is in a keep-out zone", 0)
            fence = Fence(self.zones, self.outline).everywhere(robot)
            fenced = self._replace(known=np.vstack((self.known, fence)))
        return fenced._to(what, robot) if isinstance(what, Goal) else fenced._along(what, robot)

    def _along(self, points: Floats, robot: Pose) -> CheckedPath:
        if len(points) > _MOST:
            return CheckedPath(None, f"more than {_MOST} waypoints: leave some out", NONE)
        for i, point in enumerate(points):
            if not self._on_map(point):
                return CheckedPath(None, f"waypoint {i + 1} is not on the map", i)
        line = np.vstack(((robot.x, robot.y), points))
        steps = np.hypot(*np.diff(line, axis=0).T)
        if float(steps.sum()) > _MAX_LENGTH:
            return CheckedPath(None, f"the path is longer than {_MAX_LENGTH:.0f} m", NONE)
        if steps[0] < _NEAR and len(points) > 1:  # the first one is where the robot stands
            line = np.delete(line, 1, axis=0)
        try:
            reference = through(line, self.speed)
        except CohelmError as error:
            return CheckedPath(None, str(error), NONE)
        poses = poses_along(reference, _SPACING)
        gaps = swept_clearances(np.ascontiguousarray(self.known), self.outline, poses)
        # the clearance where the robot stands already does not count
        gaps[: math.ceil(0.5 / _SPACING)] = np.maximum(gaps[: math.ceil(0.5 / _SPACING)], ROOM)
        tight = int(np.argmin(gaps))
        if gaps[tight] >= ROOM:
            return CheckedPath(reference, "", NONE)
        tau = reference.duration * tight / (len(poses) - 1)
        leg = int(np.searchsorted(reference.knots, tau, side="left"))
        i = min(max(leg - 1, 0) + len(points) + 1 - len(line), len(points) - 1)
        x, y = poses[tight, :2]
        room = f"{100.0 * gaps[tight]:.0f} cm of clearance" if gaps[tight] > 0.0 else "an obstacle"
        return CheckedPath(None, f"on the path to {i + 1}: {room} at {x:.1f}, {y:.1f}", i)

    def _to(self, goal: Goal, robot: Pose) -> CheckedPath:
        """Around mapped obstacles. The heading at the goal is free."""
        at = _text(goal)
        point = np.array([goal], dtype=np.float64)
        if not self._on_map(point):
            return CheckedPath(None, f"the goal {at} is not on the map", 0)
        if len(self.known):
            gap = float(np.hypot(*(self.known - point).T).min())
            if gap < inscribed_radius(self.outline) + ROOM:
                return CheckedPath(None, f"the goal {at} is in a wall, or too near to one", 0)
        far = math.hypot(goal.x - robot.x, goal.y - robot.y)
        if far < _AT_GOAL:
            return CheckedPath(None, f"the robot is at {at} already", NONE)
        if far > _MAX_LENGTH:
            why = f"the goal {at} is more than {_MAX_LENGTH:.0f} m away"
            return CheckedPath(None, why, NONE)
        share = np.linspace(0.0, 1.0, math.ceil(far / _DENSE) + 1)[:, None]
        line: Floats = (1.0 - share) * np.array([robot[:2]]) + share * point
        fenced = np.vstack((self.known, _border(self.bounds)))
        everywhere = float(np.ptp(self.bounds, axis=0).max()) if len(self.bounds) else 0.0
        result = CheckedPath(None, f"no path to {at} was found", 0)
        for border in (PathParams().border, everywhere):
            path_params = PathParams(
                clearance=ROOM + _EXTRA_ROOM, stray=0.0, beside=0.0, border=border
            )
            found = plan_path(robot, fenced, line, self.outline, path_params, farther=False)
            if found is None:
                continue
            for spacing in (_SPARSE, _DENSE):
                every = max(
                    round(spacing / path_params.spacing), math.ceil(len(found.points) / _MOST)
                )
                kept = np.vstack((found.points[every:-1:every], point))
                result = self._along(kept, robot)
                if result.reference is not None:
                    return result
                result = result._replace(worst=NONE)  # there is a path, but no curve along it
        return result

    def _on_map(self, point: Floats) -> bool:
        bounds = self.bounds
        return not len(bounds) or bool(((bounds[0] <= point) & (point <= bounds[1])).all())


def _text(goal: Goal) -> str:
    return f"{goal.x:.1f}, {goal.y:.1f}"


def _border(bounds: Floats) -> Floats:
    """Points along the edge of the map whose corners these are, (p, 2) [m]."""
    if not len(bounds):
        return np.empty((0, 2))
    x, y = (np.arange(low, high, _SPACING) for low, high in bounds.T)
    sides = [(x, bounds[k, 1]) for k in (0, 1)] + [(bounds[k, 0], y) for k in (0, 1)]
    return np.vstack([np.column_stack(np.broadcast_arrays(*side)) for side in sides])
