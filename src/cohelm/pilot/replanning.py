"""Replans a few times a second: checks the path, plans detours, and starts recovery moves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Desired, Floats, Pose, Twist
from cohelm.law.govern import CourseClock, governed, nearest_ahead
from cohelm.law.reference import through
from cohelm.pilot.rollout import roll_out
from cohelm.pilot.step import MOVES, NO_MOVE, PilotState, Settings, still
from cohelm.pilot.surface_points import surface_points
from cohelm.plan.course import (
    ROUTE_SPACING,
    Course,
    Route,
    course,
    paced,
    row_on_route,
    window,
)
from cohelm.plan.distance_field import swept_clearances
from cohelm.plan.elastic_band import distances
from cohelm.plan.path_planner import PathParams, plan_path
from cohelm.plan.prediction import PredictionParams, predicted_encounters
from cohelm.plan.recovery import (
    RecoveryMove,
    RecoveryParams,
    after,
    back_off,
    clear_distance,
    kind,
    recovery_move,
    turn_to,
)
from cohelm.plan.recovery_search import search_recovery
from cohelm.robot.footprint import farthest_corner

_AHEAD = 0.3  # heading error up to which the path lies ahead [rad]
_SPACING = 0.05  # of points on walls [m]
_DENSE, _DENSE_WITHIN = 0.01, 2.5  # of dense ones, and their radius around the robot [m]
_RECOVERY = RecoveryParams()
_NO_PATH: Floats = np.empty((0, 2))
_CELLS = 1000  # of the grid from a robot that is far from its route to that: larger, not more
_SEARCHES = ((1.5, False, 1.0), (1.5, False, 0.5), (3.0, True, 1.0))
"""Searches for a path, in their order: how far along the route, as a share of `look`; whether far
afield; size of the cells. A gap not much wider than the robot may have no cell of the usual size in
its middle."""
_BACK_OUT = (0.5, 1.0, 1.5, 2.0)  # how far the robot backs out, as shares of its reach
_RARELY = 6  # doublings of the time between such moves
_PERIOD = 0.25  # largest period of plans, so that `_once_a_second` is true once a second [s]


class ReplanParams(NamedTuple):
    """When and how far paths are replanned."""

    look: float = 4.0
    """How far ahead the path has to be clear [m]."""
    known: float = 6.0
    """Obstacles farther from the robot are ignored [m]."""
    accept: float = 0.06
    """Smallest clearance of the outline with which the route itself is followed [m]."""
    ample_clearance: float = 0.2
    """Smallest clearance with which a detour is not reconsidered [m]."""
    max_cross_track_error: float = 0.6
    """Cross-track error at which the path is replanned [m]."""
    reentry_distance: float = 0.3
    """Distance from the route up to which the robot re-enters it [m]."""
    slack: float = 0.02
    """A detour is kept while it is at most this tighter than a new one has to be, for sensor noise
    [m]."""
    patience: float = 0.6
    """Between two plans that are not needed but may be better [s]."""
    beside: float = 0.15
    """A path that ends farther from the route's end than this is replanned [m]."""
    missed: float = 0.08
    """So is one from whose end the robot has come to rest farther than this; less than the default
    of `arrive_m` [m]."""
    waits: float = 1.0
    """How long the robot is held up before a recovery move [s]."""
    pinned: float = 10.0
    """How long it has not got away from a place before it backs out of it [s]."""
    turned: float = 1.2
    """Heading error above which the robot turns on the spot first [rad]."""
    foresight: PredictionParams = PredictionParams()
    """Of movers."""


class Task(NamedTuple):
    """A snapshot for `plan`, which may run elsewhere."""

    state: PilotState
    pose: Pose
    twist: Twist
    obstacles: Surroundings
    course: Course
    since: float
    """How long the path has been followed [s]."""
    led: bool
    """Whether the operator leads."""
    refused_for: float = 0.0
    """How long gate and monitors have refused all commands [s]."""
    unobserved: slice = slice(0, 0)
    """Which of the obstacles' points are the border of unobserved space."""
    outline: Floats | None = None
    """Of the robot, if it differs from the planner's settings."""


class Plan(NamedTuple):
    """The path to follow from now on."""

    course: Course
    new: bool
    """Whether it is a new path, not the current one with new speeds."""
    move: RecoveryMove | None
    """A recovery move to begin with."""
    failed: bool
    """Whether no path was found."""
    clearance: float
    """Smallest clearance of the outline on the path ahead [m]."""
    held: bool = False
    """Whether it was made for a robot that is held up."""
    frees: bool = False
    """Whether it was made for one that does not get away from a place."""


class Planner(NamedTuple):
    """Makes plans for one robot on one route; sent once to where they are made."""

    route: Route
    settings: Settings
    path_params: PathParams = PathParams()
    replan_params: ReplanParams = ReplanParams()

    def __call__(self, task: Task) -> Plan:
        """The plan for a snapshot: the current path with speeds by clearance, or a new one. It
        takes milliseconds, and changes nothing.

        The route itself is followed where it is clear by `accept`; else a detour that re-enters it.
        Held up for long, or facing the wrong way, the robot first makes a recovery move. If there
        is no path over observed ground, one over unobserved space is begun: the filter stops the
        robot at its border, where it can look.
        """
        if task.outline is None:
            return self._plan(task)
        return self._replace(settings=self.settings._replace(outline=task.outline))._plan(task)

    def _plan(self, task: Task) -> Plan:
        state, now, params = task.state, task.course, self.replan_params
        if state.evasion.on and not _once_a_second(task):  # it does not follow the path meanwhile
            return Plan(now, False, None, False, math.inf)
        static_points = surface_points(task.obstacles, task.pose, params.known, _SPACING)
        mover_points = predicted_encounters(
            task.obstacles.discs, task.pose, self.route.reference.speed, params.known,
            params.foresight,
        )  # fmt: skip
        points = blocking = static_points
        if len(mover_points):
            points = np.concatenate((static_points, mover_points))
        refreshed, clearance = self._paced(now, state.clock.tau, points)
        kept = Plan(refreshed, False, None, False, clearance)
        if task.led:
            return kept
        if state.left != NO_MOVE:  # what stops the reference still does at the end of the move
            return kept._replace(course=now)
        free = not len(mover_points)  # else a gap may close, and what is in the way go by itself
        planner = self._replace(path_params=self.path_params._replace(gaps=free))
        far = free and _once_a_second(task)
        made = planner._course(task, points, kept, far)
        if made.failed and not free:
            far = _once_a_second(task)
            made = planner._course(task, static_points, kept, far)
        ended = not made.new and self._ended(task)
        if (made.failed or ended) and task.unobserved.stop > task.unobserved.start:
            observed = task.obstacles._replace(
                points=np.delete(task.obstacles.points, task.unobserved, axis=0)
            )
            blocking = surface_points(observed, task.pose, params.known, _SPACING)
            made = planner._course(task, blocking, kept, far)
        if made.failed:
            made = made._replace(course=self._stopping_short(task, made.course, blocking))
        if free and state.pinned > params.pinned and _once_a_second(task):
            out = self._back_out(task, static_points)
            if out is None:
                out = made._replace(move=self._recovery(task, made, static_points, True))
            return out._replace(held=True, frees=True)
        held = self._held_up(task)
        return made._replace(move=self._recovery(task, made, static_points, held), held=held)

    def _paced(
        self, course: Course, tau: float, points: Floats, standoff: float = -1.0
    ) -> tuple[Course, float]:
        """A path with speeds by clearance, and the smallest clearance ahead of `tau` [m]. standoff:
        as in `paced` [m]."""
        s = self.settings
        return paced(course, tau, self.replan_params.look, points, s.outline, s.pace, standoff)

    def _stopping_short(self, task: Task, course: Course, points: Floats) -> Course:
        """A path that is blocked, up to where the robot can still turn on the spot: what blocks it
        may be a person."""
        outline = self.settings.outline
        nose = float(outline[:, 0].max())
        standoff = farthest_corner(outline) - nose + self.path_params.clearance
        return self._paced(course, task.state.clock.tau, points, standoff)[0]

    def _course(self, task: Task, points: Floats, kept: Plan, far: bool) -> Plan:
        """The path to follow, whatever the robot's heading."""
        state, pose, now, params = task.state, task.pose, task.course, self.replan_params
        on_route = now.row == 0
        at = governed(now.reference, state.clock, pose, self.settings.pace)
        short_of = math.hypot(at.x - pose.x, at.y - pose.y)
        # At the end of a path nothing is tracked that would reduce the cross-track error.
        missed = _remaining(now, state.clock.tau) <= 0.0 and still(task.twist)
        off_path = short_of > (params.missed if missed else params.max_cross_track_error)
        held = self._held_up(task)
        if on_route and kept.clearance >= params.accept and not off_path and not held:
            return kept
        if not on_route and not held:
            back = self._route_reentry(task, points)
            if back is not None:
                return back
        running_out = not now.last and _remaining(now, state.clock.tau) < 0.75 * params.look
        # An obstacle at the route's end may be gone.
        beside, ended = self._beside(now), self._ended(task)
        acceptable = kept.clearance >= self.path_params.clearance - params.slack and not (
            off_path or held or running_out or on_route or ended
        )
        if acceptable and (
            kept.clearance >= params.ample_clearance or task.since < params.patience
        ):
            return kept
        found = self._detour(task, points, far)
        back = found is None or abs(self._on_adoption(found, task)[2]) > params.turned
        if acceptable and not beside and back:  # no path that begins with turning round is better
            return kept
        if found is not None and ended:
            nearer = self._distance_to_end(found.course) < self._distance_to_end(now) - 0.1
            found = found if nearer else None
        return kept._replace(failed=not ended) if found is None else found

    def _distance_to_end(self, course: Course) -> float:
        """Distance of a path's end from the route's end [m]."""
        return math.hypot(*(course.poses[-1, :2] - self.route.line[-1]))

    def _beside(self, now: Course) -> bool:
        """Whether the path is a detour that ends beside the route's end."""
        return now.last and now.row > 0 and self._distance_to_end(now) > self.replan_params.beside

    def _ended(self, task: Task) -> bool:
        """Whether the robot is at the end of such a path."""
        at_end = _remaining(task.course, task.state.clock.tau) < 0.1
        return at_end and self._beside(task.course)

    def _held_up(self, task: Task) -> bool:
        """Whether the robot makes no progress."""
        return max(task.state.clock.waited, task.refused_for) > self.replan_params.waits

    def _on_adoption(self, made: Plan, task: Task) -> tuple[CourseClock, Desired, float]:
        """The clock of a plan's path now, the desired pose, and the robot's heading error [rad]."""
        clock = task.state.clock
        if made.new:
            clock = clock_on_entry(made.course, self.route, task.state.row, task.pose, task.twist)
        to = governed(made.course.reference, clock, task.pose, self.settings.pace)
        return clock, to, math.remainder(to.psi - task.pose.psi, 2.0 * math.pi)

    def _route_reentry(self, task: Task, points: Floats) -> Plan | None:
        """Re-entry of the route, if the robot is on it and it is clear ahead."""
        row, pose = task.state.row, task.pose
        line, params = self.route.line, self.replan_params
        x, y = line[row]
        following = line[min(row + 1, len(line) - 1)] - line[max(row - 1, 0)]
        off = math.remainder(math.atan2(following[1], following[0]) - pose.psi, 2.0 * math.pi)
        if math.hypot(x - pose.x, y - pose.y) > params.reentry_distance or abs(off) > 0.5:
            return None
        own = course(self.route.reference, 0, True, self.settings.pace)
        made, clearance = self._paced(own, float(self.route.times[row]), points)
        if clearance < 1.25 * params.accept:
            return None
        clock = clock_on_entry(made, self.route, row, pose, task.twist)
        drive = roll_out(made, clock, pose, task.twist, params.look, self.settings)
        outline = self.settings.outline
        if len(drive) and swept_clearances(points, outline, drive).min() < params.accept:
            return None
        return Plan(made, True, None, False, clearance)

    def _detour(self, task: Task, points: Floats, far: bool) -> Plan | None:
        """A detour from the robot back onto the route, and on along it.

        far: whether to search far afield if there is none near by.
        """
        line, pose, params = self.route.line, task.pose, self.replan_params
        row = row_on_route(line, pose, task.state.row, task.course, task.state.clock.tau)
        now, clock = task.course, task.state.clock
        chosen = _NO_PATH
        if now.row > 0 and clock.waited <= params.waits:
            chosen = now.poses[slice(*window(now, clock.tau, params.known)), :2]
        away = float(np.hypot(*(line[row] - pose[:2])))
        resolution = max(self.path_params.resolution, away / _CELLS)
        for reach, farther, cell in _SEARCHES[: None if far else 1]:
            if cell < 1.0 and not self.path_params.gaps:
                continue
            end = min(len(line), row + int(reach * params.look / ROUTE_SPACING))
            path_params = self.path_params._replace(resolution=cell * resolution)
            found = plan_path(
                pose, points, line[:end], self.settings.outline, path_params, row, params.look,
                farther, chosen,
            )  # fmt: skip
            if found is not None:
                break
        else:
            return None
        if len(found.points) < 3:
            return None
        tail = line[found.rejoined + 2 : end : 2]
        last = end == len(line)
        corners = np.vstack((found.points[:-1:2], found.points[-1:]))
        around = len(corners)
        if found.rejoined < end - 1:
            corners = np.vstack((corners, tail, line[end - 1 : end]))
        steps = np.diff(distances(corners))
        keep = np.concatenate(([True], steps > 0.02))
        if keep.sum() < 2:
            return None
        reference = through(corners[keep], self.route.reference.speed)
        rejoins = float(reference.knots[keep[:around].sum() - 1])
        made = course(reference, max(found.rejoined, 1), last, self.settings.pace, rejoins)
        made, clearance = self._paced(made, 0.0, points)
        return Plan(made, True, None, False, clearance)

    def _back_out(self, task: Task, points: Floats) -> Plan | None:
        """The path from the nearest place straight behind the robot from which it can drive one,
        and the move there; None if there is none within twice its reach.

        Where the robot does not get away, its path may be clear and yet not one that it can drive
        from where it stands: askew in a door it would have to move sideways, and with its nose at a
        wall its tail has no room to turn. So what is looked at is the predicted drive.
        """
        s, pose = self.settings, task.pose
        reach = farthest_corner(s.outline)
        least = s.rules.soft_margin
        now = float(swept_clearances(points, s.outline, np.array([pose]))[0]) - 1e-6
        clear = clear_distance(
            pose, -1.0, 0.0, 2.0 * reach, points, s.outline, reach, min(least, now)
        )
        for share in _BACK_OUT:
            back = RecoveryMove(-share * reach, 0.0, 0.0)
            if -back.distance > clear:
                break
            there = after(back, pose)
            made = self._detour(task._replace(pose=there), points, True)
            if made is None:
                continue
            heading = float(made.course.poses[1, 2])
            turn = turn_to(there, heading, points, s.outline, reach, least, 0)
            if turn is None:
                continue
            move = back._replace(turn=turn)
            there = after(move, pose)
            clock = clock_on_entry(made.course, self.route, task.state.row, there, Twist(0.0, 0.0))
            drive = roll_out(made.course, clock, there, Twist(0.0, 0.0), self.replan_params.look, s)
            if len(drive) and swept_clearances(points, s.outline, drive).min() >= least:
                return made._replace(move=move)
        return None

    def _recovery(
        self, task: Task, made: Plan, points: Floats, held: bool
    ) -> RecoveryMove | None:  # fmt: skip
        """A recovery move, if one is needed and possible."""
        pose, outline, rules = task.pose, self.settings.outline, self.settings.rules
        params = self.replan_params
        clock, to, off = self._on_adoption(made, task)
        shuffles = task.state.moves >= MOVES  # single moves lead nowhere
        over = clock.tau >= made.course.reference.knots[-1]
        if over or (abs(off) <= (_AHEAD if shuffles else params.turned) and not held):
            return None
        refused = task.state.refused
        recovery_params = _RECOVERY._replace(
            clearances=(
                *(g for g in _RECOVERY.clearances if g > self.path_params.clearance),
                self.path_params.clearance,
            ),
            # Between two of the dense points of a wall a corner may be so much nearer to it.
            least=min(math.hypot(rules.hard_margin, 0.5 * _DENSE), rules.soft_margin),
        )
        if task.refused_for > params.waits:  # by what is not among the points
            move = back_off(pose, points, outline, recovery_params, refused)
            return move or back_off(pose, points, outline, recovery_params)
        move = None
        if not shuffles:
            move = recovery_move(pose, to.psi, points, outline, recovery_params, refused)
        if move is None and (held or refused or shuffles):
            dense = surface_points(task.obstacles, pose, _DENSE_WITHIN, _DENSE)
            if shuffles:
                move = search_recovery(pose, to.psi, dense, outline, recovery_params, refused)
            for without in (refused, 0)[: 2 if refused else 1]:
                move = move or recovery_move(pose, to.psi, dense, outline, recovery_params, without)
                move = move or search_recovery(
                    pose, to.psi, dense, outline, recovery_params, without
                )
        if move is not None and abs(off) <= _AHEAD and move.distance == 0.0:
            # Its heading is right, but it makes no progress. Where there is no path, it does so
            # less and less often: twitching before what blocks it is no way of waiting.
            patience = params.waits * 2.0 ** min(task.state.moves, _RARELY)
            if made.failed and task.state.clock.waited < patience:
                return None
            back = RecoveryMove(-0.2, 0.0, 0.0)
            return RecoveryMove(0.1, 0.0, 0.0) if kind(back) & refused else back
        return move


def clock_on_entry(course: Course, route: Route, row: int, pose: Pose, twist: Twist) -> CourseClock:
    """The clock with which a path is entered while driving.

    row: of the route, where the robot is.
    """
    on_route = course.row == 0
    first = float(route.times[max(row - 2, 0)]) if on_route else 0.0
    tau = nearest_ahead(course.reference, pose, first, 0.6)
    return CourseClock(tau, min(max(twist.v / course.reference.speed, 0.0), 1.0), 0.0)


def _once_a_second(task: Task) -> bool:
    """Whether to search far afield now, which takes long: at the start, then each second."""
    time = task.state.time
    return time < 0.5 or time % 1.0 < _PERIOD


def _remaining(course: Course, tau: float) -> float:
    """Approximate distance to the end of a path [m]."""
    return (course.reference.duration - tau) * course.reference.speed
