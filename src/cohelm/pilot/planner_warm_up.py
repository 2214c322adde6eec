"""Compiles all that plans may need before the first one is due."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.replanning import Planner, Task
from cohelm.pilot.step import MOVES, START
from cohelm.plan.course import course, route
from cohelm.plan.distance_field import distance_field, inscribed_radius
from cohelm.plan.path_planner import through_gap
from cohelm.robot.footprint import farthest_corner

_LENGTH = 12.0  # of the route that is planned on [m]


def warm_up_planner(planner: Planner) -> None:
    """Make a plan of every kind on a made-up route, and discard them.

    A route that is clear needs a hundredth of what a detour does: compiled when somebody first
    stands in the way, that takes longer than a plan may, and the robot stands there meanwhile.
    """
    settings, params = planner.settings, planner.replan_params
    reach = farthest_corner(settings.outline)
    line = np.array([[0.0, 0.0], [0.5 * _LENGTH, 0.0], [_LENGTH, 0.0]])
    planner = planner._replace(route=route(through(line, planner.route.reference.speed)))
    start, turned = Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, 2.0 * params.turned)
    ahead, beside = 2.0 + reach, 1.0 + reach
    wall, wider = _walls((ahead, -reach), (ahead, reach)), _walls((ahead, -beside), (ahead, beside))
    near = reach + 0.3
    box = _walls((near, near), (near, -near), (-near, -near), (-near, near), (near, near))
    waited = START.clock._replace(waited=2.0 * params.waits)
    held = START._replace(clock=waited, moves=MOVES)
    task = Task(
        START, start, Twist(0.0, 0.0), wall,
        course(planner.route.reference, 0, True, settings.pace), 2.0 * params.patience, False,
    )  # fmt: skip
    detour = planner(task).course
    for one in (
        task._replace(course=detour, obstacles=wider),  # another detour
        task._replace(course=detour, obstacles=_walls()),  # re-entry of the route
        task._replace(pose=turned),
        task._replace(pose=turned, state=held, obstacles=box),  # a search for recovery moves
        task._replace(pose=turned, state=held._replace(moves=0), obstacles=box),
        task._replace(state=START._replace(pinned=2.0 * params.pinned), obstacles=box),
        task._replace(pose=turned, refused_for=2.0 * params.waits),
    ):
        planner(one)
    _gap(planner, reach)


def _gap(planner: Planner, reach: float) -> None:
    """Go through a gap in which there is hardly any room."""
    outline, path_params = planner.settings.outline, planner.path_params
    ends = np.array([[3.0, reach + 0.05], [3.0, -reach - 0.05]])
    field = distance_field(ends, (-1.0, -3.0), (7.0, 3.0), path_params.resolution)
    along = np.arange(0.0, 6.0, path_params.spacing)
    line = np.column_stack((along, np.zeros(len(along))))
    through_gap(field, line, len(line) // 2, ends, outline, inscribed_radius(outline), path_params)


def _walls(*corners: tuple[float, float]) -> Surroundings:
    """Nothing but a wall along these corners."""
    return surroundings(segments=[(*a, *b) for a, b in pairwise(corners)] or None)
