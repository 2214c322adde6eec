"""Replans a few times a second: is the course clear, is there a better one, a recovery move?"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Desired, Floats, Pose, Twist
from cohelm.law.govern import CourseClock, governed, nearest_ahead
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.reference import through
from cohelm.pilot.rollout import ahead
from cohelm.pilot.step import NO_MOVE, PilotState, Settings, still
from cohelm.pilot.surface_points import surface_points
from cohelm.plan.course import Course, Route, course, nearest_row, paced, window
from cohelm.plan.distance_field import swept
from cohelm.plan.elastic_band import distances
from cohelm.plan.path_planner import PathParams, way
from cohelm.plan.prediction import Foresight, met
from cohelm.plan.recovery import Choices, RecoveryMove, back_off, kind, recovery_move, wriggle

_DENSE, _DENSE_WITHIN = 0.01, 2.5  # between points where millimetres matter, how far that is [m]
_CHOICES = Choices()
_NO_WAY: Floats = np.empty((0, 2))
_PERIOD = 0.25  # of plans, at most, for `_once_a_second` to come once a second [s]


class ReplanParams(NamedTuple):
    """When a new way is looked for, and how far."""

    look: float = 4.0
    """How far ahead the course has to be clear [m]."""
    known: float = 6.0
    """What is farther from the robot is left out of plans [m]."""
    accept: float = 0.06
    """Least clearance of the outline with which the given route is followed as it is [m]."""
    ample_clearance: float = 0.2
    """Least clearance with which a way round is not reconsidered [m]."""
    max_cross_track_error: float = 0.6
    """Distance from the course at which a way back is looked for [m]."""
    reentry_distance: float = 0.3
    """Distance from the route up to which the robot changes back onto it [m]."""
    slack: float = 0.02
    """A way round is kept while it is no more than this tighter than a new one has to be: sensors
    tell now a little more, now a little less [m]."""
    patience: float = 0.6
    """Between two looks for a way that is not needed but might be better [s]."""
    beside: float = 0.15
    """Where a way ends farther from the route's end than this, a better one is looked for [m]."""
    missed: float = 0.08
    """And where the robot has come to rest farther from the way's end than this, which is nearer
    than has to be reached by default, `arrive_m` [m]."""
    waits: float = 1.0
    """How long the robot is held up before it looks for a way out [s]."""
    turned: float = 1.2
    """From this far off the course's heading the robot turns on the spot first [rad]."""
    foresight: Foresight = Foresight()
    """Of things that move."""


class Task(NamedTuple):
    """A snapshot for `plan`, which may run elsewhere."""

    state: PilotState
    pose: Pose
    twist: Twist
    obstacles: Surroundings
    course: Course
    since: float
    """How long the course has been followed [s]."""
    led: bool
    """Whether the person leads."""
    refused_for: float = 0.0
    """How long gate and monitors have refused all that was asked for [s]."""
    unseen: Floats = np.empty((0, 2))
    """Beside the obstacles, ground that nothing has seen and that may hold anything, (n, 2)."""
    outline: Floats | None = None
    """The robot's, if it is another than in the planner's settings."""

    def with_unseen(self) -> Surroundings:
        """The obstacles, and the unseen ground as if it were one."""
        if not len(self.unseen):
            return self.obstacles
        points = np.concatenate((self.obstacles.points, self.unseen))
        return self.obstacles._replace(points=points)


def apart(around: Surroundings, first: int, end: int) -> tuple[Surroundings, Floats]:
    """The obstacles of a `Task` without their points from `first` to `end`, and those: ground that
    nothing has seen."""
    points = np.delete(around.points, slice(first, end), axis=0)
    return around._replace(points=points), around.points[first:end]


class Plan(NamedTuple):
    """What is to be followed from now on."""

    course: Course
    new: bool
    """Whether it is another course, not the old one at new speeds."""
    move: RecoveryMove | None
    """A move out of a tight spot to begin with."""
    failed: bool
    """Whether a way was looked for, and none found."""
    clearance: float
    """Least clearance of the outline on the stretch ahead [m]."""


def plan(
    task: Task,
    route: Route,
    settings: Settings,
    path_params: PathParams,
    replan_params: ReplanParams,
) -> Plan:
    """The plan for a snapshot: the course at the speeds that what is known allows, or another one.

    The route itself is followed where it is clear by `accept`; else a way round what is in the
    way, back onto the route and on along it. Held up for long, or looking the wrong way, the
    robot first gets out of where it is. Where there is no way over ground that has been seen, one
    over ground that has not is begun: the filter ends it where that begins, and there the robot
    looks.
    """
    state, now = task.state, task.course
    if state.evasion.on and not _once_a_second(task):  # it does not follow the course meanwhile
        return Plan(now, False, None, False, math.inf)
    there = surface_points(task.with_unseen(), task.pose, replan_params.known)
    coming = met(
        task.obstacles.discs, task.pose, route.reference.speed, replan_params.known,
        replan_params.foresight,
    )  # fmt: skip
    points = np.concatenate((there, coming)) if len(coming) else there
    refreshed, clearance = paced(
        now, state.clock.tau, replan_params.look, points, settings.outline, settings.pace
    )
    kept = Plan(refreshed, False, None, False, clearance)
    if task.led or state.left != NO_MOVE:
        return kept
    far = not len(coming) and _once_a_second(task)
    made = _course(task, points, kept, route, settings, path_params, replan_params, far)
    if made.failed and len(coming):
        far = _once_a_second(task)
        made = _course(task, there, kept, route, settings, path_params, replan_params, far)
    ended = not made.new and _ended(task, route, replan_params)
    if (made.failed or ended) and len(task.unseen):
        points = surface_points(task.obstacles, task.pose, replan_params.known)
        made = _course(task, points, kept, route, settings, path_params, replan_params, far)
    return made._replace(
        move=_way_out(task, made, there, route, settings, path_params, replan_params)
    )


def _course(
    task: Task, points: Floats, kept: Plan, route: Route, settings: Settings,
    path_params: PathParams, replan_params: ReplanParams, far: bool,
) -> Plan:  # fmt: skip
    """The course to follow, without regard to where the robot looks."""
    state, pose, now = task.state, task.pose, task.course
    on_route = now.row == 0
    at = governed(now.reference, state.clock, pose, settings.pace)
    short_of = math.hypot(at.x - pose.x, at.y - pose.y)
    # At the end of a course nothing is tracked that would bring the robot across to it.
    missed = _remaining(now, state.clock.tau) <= 0.0 and still(task.twist)
    astray = short_of > (replan_params.missed if missed else replan_params.max_cross_track_error)
    held = _held(task, replan_params)
    if on_route and kept.clearance >= replan_params.accept and not astray and not held:
        return kept
    if not on_route and not held:
        back = _rejoined(task, points, route, settings, replan_params)
        if back is not None:
            return back
    short = not now.last and _remaining(now, state.clock.tau) < 0.75 * replan_params.look
    # What stood or walked where the route ends may be gone.
    beside, ended = _beside(now, route, replan_params), _ended(task, route, replan_params)
    fine = kept.clearance >= path_params.clearance - replan_params.slack and not (
        astray or held or short or on_route or ended
    )
    if fine and (
        kept.clearance >= replan_params.ample_clearance or task.since < replan_params.patience
    ):
        return kept
    found = _round(task, points, route, settings, path_params, replan_params, far)
    back = found is None or abs(_taken_up(found, task, route, settings)[2]) > replan_params.turned
    if fine and not beside and back:  # no way that begins with turning round is better
        return kept
    if found is not None and ended:
        nearer = _off_end(found.course, route) < _off_end(now, route) - 0.1
        found = found if nearer else None
    return kept._replace(failed=not ended) if found is None else found


def _off_end(course: Course, route: Route) -> float:
    """How far from the route's end a course ends [m]."""
    return math.hypot(*(course.poses[-1, :2] - route.line[-1]))


def _beside(now: Course, route: Route, replan_params: ReplanParams) -> bool:
    """Whether the course is a way that ends beside the route's end."""
    return now.last and now.row > 0 and _off_end(now, route) > replan_params.beside


def _ended(task: Task, route: Route, replan_params: ReplanParams) -> bool:
    """Whether the robot is where such a way ends."""
    at_end = _remaining(task.course, task.state.clock.tau) < 0.1
    return at_end and _beside(task.course, route, replan_params)


def _held(task: Task, replan_params: ReplanParams) -> bool:
    """Whether the robot does not get on."""
    return max(task.state.clock.waited, task.refused_for) > replan_params.waits


def _taken_up(
    made: Plan, task: Task, route: Route, settings: Settings
) -> tuple[CourseClock, Desired, float]:
    """The clock of a plan's course now, what is desired then, and by how much the robot looks
    another way [rad]."""
    clock = task.state.clock
    if made.new:
        clock = entered(made.course, route, task.state.row, task.pose, task.twist)
    to = governed(made.course.reference, clock, task.pose, settings.pace)
    return clock, to, math.remainder(to.psi - task.pose.psi, 2.0 * math.pi)


def _rejoined(
    task: Task, points: Floats, route: Route, settings: Settings, replan_params: ReplanParams
) -> Plan | None:
    """Back onto the route itself, where the robot is on it and it is clear ahead."""
    row, pose = task.state.row, task.pose
    x, y = route.line[row]
    following = route.line[min(row + 1, len(route.line) - 1)] - route.line[max(row - 1, 0)]
    off = math.remainder(math.atan2(following[1], following[0]) - pose.psi, 2.0 * math.pi)
    if math.hypot(x - pose.x, y - pose.y) > replan_params.reentry_distance or abs(off) > 0.5:
        return None
    own = course(route.reference, 0, True, settings.pace)
    made, clearance = paced(
        own, float(route.times[row]), replan_params.look, points, settings.outline, settings.pace
    )
    if clearance < 1.25 * replan_params.accept:
        return None
    clock = entered(made, route, row, pose, task.twist)
    drive = ahead(made, clock, pose, task.twist, replan_params.look, settings)
    if len(drive) and swept(points, settings.outline, drive).min() < replan_params.accept:
        return None
    return Plan(made, True, None, False, clearance)


def _round(
    task: Task, points: Floats, route: Route, settings: Settings, path_params: PathParams,
    replan_params: ReplanParams, far: bool,
) -> Plan | None:  # fmt: skip
    """A way from the robot back onto the route, and on along it.

    far: whether to look far afield if there is none nearby.
    """
    line, pose = route.line, task.pose
    row = nearest_row(line, pose, task.state.row, max(task.state.row + 20, task.course.row))
    now, clock = task.course, task.state.clock
    chosen = _NO_WAY
    if now.row > 0 and clock.waited <= replan_params.waits:
        chosen = now.poses[slice(*window(now, clock.tau, replan_params.known)), :2]
    for reach, farther in ((1.5, False), (3.0, True))[: 2 if far else 1]:
        end = min(len(line), row + int(reach * replan_params.look / 0.1))
        found = way(
            pose,
            points,
            line[:end],
            settings.outline,
            path_params,
            row,
            replan_params.look,
            farther,
            chosen,
        )
        if found is not None:
            break
    else:
        return None
    if len(found.points) < 3:
        return None
    tail = line[found.rejoined + 2 : end : 2]
    last = end == len(line)
    corners = np.vstack((found.points[:-1:2], found.points[-1:]))
    if found.rejoined < end - 1:
        corners = np.vstack((corners, tail, line[end - 1 : end]))
    steps = np.diff(distances(corners))
    keep = np.concatenate(([True], steps > 0.02))
    if keep.sum() < 2:
        return None
    made = course(
        through(corners[keep], route.reference.speed), max(found.rejoined, 1), last, settings.pace
    )
    made, clearance = paced(made, 0.0, replan_params.look, points, settings.outline, settings.pace)
    return Plan(made, True, None, False, clearance)


def _way_out(
    task: Task, made: Plan, points: Floats, route: Route, settings: Settings,
    path_params: PathParams, replan_params: ReplanParams,
) -> RecoveryMove | None:  # fmt: skip
    """A move out of a tight spot, if one is needed and there is one."""
    pose = task.pose
    clock, to, off = _taken_up(made, task, route, settings)
    held = _held(task, replan_params)
    over = clock.tau >= made.course.reference.knots[-1]
    if over or (abs(off) <= replan_params.turned and not held):
        return None
    refused = task.state.refused
    choices = _CHOICES._replace(
        clearances=(
            *(g for g in _CHOICES.clearances if g > path_params.clearance),
            path_params.clearance,
        ),
        least=min(1.2 * settings.rules.hard_margin, settings.rules.soft_margin),
    )
    if task.refused_for > replan_params.waits:  # by what is not among the points
        move = back_off(pose, points, settings.outline, choices, refused)
        return move or back_off(pose, points, settings.outline, choices)
    move = recovery_move(pose, to.psi, points, settings.outline, choices, refused)
    if move is None and refused:
        move = recovery_move(pose, to.psi, points, settings.outline, choices)
    if move is None and held:
        dense = surface_points(task.with_unseen(), pose, _DENSE_WITHIN, _DENSE)
        move = recovery_move(pose, to.psi, dense, settings.outline, choices, refused)
        move = move or wriggle(pose, dense, settings.outline, choices, refused)
    if move is not None and abs(off) < 0.3 and move.distance == 0.0:
        back = RecoveryMove(-0.2, 0.0, 0.0)  # looks where it should, but does not get on
        return RecoveryMove(0.1, 0.0, 0.0) if kind(back) & refused else back
    return move


def entered(course: Course, route: Route, row: int, pose: Pose, twist: Twist) -> CourseClock:
    """The clock with which another course is taken up on the way.

    row: of the route, where the robot is.
    """
    on_route = course.row == 0
    first = float(route.times[max(row - 2, 0)]) if on_route else 0.0
    tau = nearest_ahead(course.reference, pose, first, 0.6)
    return CourseClock(tau, min(max(twist.v / course.reference.speed, 0.0), 1.0), 0.0)


def _once_a_second(task: Task) -> bool:
    """Whether it is time to look far afield, which takes long: at the start, then each second."""
    time = task.state.time
    return time < 0.5 or time % 1.0 < _PERIOD


def _remaining(course: Course, tau: float) -> float:
    """How far it is to the end of a course, about [m]."""
    return (course.reference.duration - tau) * course.reference.speed
