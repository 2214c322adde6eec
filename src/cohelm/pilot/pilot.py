"""The pilot for callers in Python: a fast `step`, a slow `plan`, and `take` to adopt a plan."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.flat import made, names, numbers, read, write
from cohelm.core.jit import jit
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Floats, Pose, Stick, Twist
from cohelm.law.govern import Profile
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import Reference
from cohelm.pilot.behavior import FOLLOWING, LED
from cohelm.pilot.delay_compensation import periods
from cohelm.pilot.replanning import Plan, Planner, ReplanParams, Task, clock_on_entry
from cohelm.pilot.step import (
    NO_MOVE,
    PATIENCE,
    START,
    Decision,
    PilotState,
    Settings,
    limit_speed,
    pilot_step,
    still,
)
from cohelm.plan.course import Course, course, route, row_on_route
from cohelm.plan.evasion.movers import empty_mover_history
from cohelm.plan.path_planner import PathParams
from cohelm.plan.recovery import after, begins, kind

_BARS = 3.0
"""A kind of motion that monitors hold back is not chosen for an evasion for so long [s]."""
_PAUSE = 1.0
"""A pilot that was not asked for longer begins anew: the robot may be elsewhere [s]."""
NOTHING_NEAR = surroundings()
"""No obstacles."""


class Pilot:
    """One robot on one route.

    `step` once per control period; every 0.2 s or so `task`, `planner(task)` (here, in
    another thread or in another process) and `take`. Not to be called from two threads at once;
    a planner may run meanwhile, as it changes nothing.

    Frames: everything in one frame, the reference's; `pose` is where the robot is now.
    """

    def __init__(
        self, reference: Reference, settings: Settings, *, delay: float = 0.0,
        path_params: PathParams | None = None, replan_params: ReplanParams | None = None,
    ) -> None:  # fmt: skip
        """settings.rules.dt: the control period. delay: from command to wheels [s]."""
        dt = settings.rules.dt
        if not (math.isfinite(delay) and 0.0 <= delay <= 60.0):
            raise CohelmError(f"the delay must be from 0 to 60 s, got {delay}")
        whole, rest = periods(delay, dt)
        settings = settings._replace(rest=rest, outline=_contiguous(settings.outline))
        self.planner = Planner(
            route(reference), settings, path_params or PathParams(), replan_params or ReplanParams()
        )
        self.settings = settings
        self.state: PilotState = START
        self.course: Course = course(reference, 0, True, settings.pace)
        self.sent: Floats = np.zeros((whole, 2))
        self.mover_history: Floats = empty_mover_history()
        self.behavior = FOLLOWING
        self._safe: Twist | None = None
        self.refused_for = 0.0
        """How long gate and monitors have refused all commands, by `applied` [s]."""
        self._refused = 0
        """Kinds of recovery moves that they refused."""
        self._held_back = 0.0
        """How long they have held back an evasion [s]."""
        self._barred: dict[int, float] = {}
        """Until when each kind of motion is barred [s]."""
        self._now = -math.inf
        self._scans = 0
        self._taken = 0.0
        self._line = _contiguous(self.planner.route.line)
        self._numbers = numbers(settings)
        self._out = np.empty(_STATE + len(names(Decision)))

    def step(
        self, now: float, pose: Pose, twist: Twist, stick: Stick, obstacles: Surroundings,
        fastest: float = math.inf, scans: int = 0,
    ) -> Decision:  # fmt: skip
        """The command for now, and why. now: monotonic [s]. twist: measured now.

        obstacles: as of now. fastest: speed limit beside that of the settings [m/s]. scans: how
        many have updated the obstacles so far, see `perceive.pipeline.Seen`. Never raises on
        numbers, see `pilot_step`.
        """
        dt = self.settings.rules.dt
        passed = now - self._now
        if math.isfinite(passed):
            if passed > max(_PAUSE, 3.0 * dt):
                self._begin_anew(pose, twist)
            dt = min(max(passed, 0.0), 3.0 * dt)  # a late step must not make the reference jump
        self._now = now
        fresh, self._scans = scans != self._scans, scans
        course, reference = self.course, self.course.reference
        limit_speed(self._numbers, self.settings, fastest)
        # an int would compile another specialization
        x, y, psi, v = float(pose[0]), float(pose[1]), float(pose[2]), float(twist[0])
        _step(
            numbers(self.state), x, y, psi, v, float(twist[1]), float(stick[0]), float(stick[1]),
            *obstacles, reference.knots, reference.coeffs, reference.speed, course.poses,
            course.paced.rate, course.row, course.rejoins, self._line, self.settings.outline,
            self._numbers, float(dt), self.sent, self.mover_history, fresh, self._out,
        )  # fmt: skip
        row = self._out.tolist()
        self.state, decision = made(PilotState, row), made(Decision, row, _STATE)
        self.behavior = decision.behavior
        self._safe = decision.safe
        return decision

    def _begin_anew(self, pose: Pose, twist: Twist) -> None:
        """Go on along the route from where the robot is, if that is farther, without what was begun
        before: recovery, evasion, and how long the robot was held up."""
        s, way = self.state, self.planner.route
        row = row_on_route(way.line, pose, s.row, self.course, s.clock.tau)
        here = clock_on_entry(self.course, way, row, pose, twist)
        clock = here if here.tau > s.clock.tau else s.clock._replace(waited=0.0)
        self.state = START._replace(k=s.k, time=s.time, clock=clock, row=s.row)
        self.refused_for, self._refused = 0.0, 0
        self._held_back, self._barred = 0.0, {}

    def applied(self, command: Twist) -> None:
        """The command that gate and monitors passed in this period. A recovery move of which they
        pass nothing is given up."""
        safe, self._safe = self._safe, None
        left = self.state.left
        if safe is not None:
            self._bar(safe, command)
        if safe is None or not still(command):
            self.refused_for = 0.0
            self._refused = 0 if left == NO_MOVE else self._refused
            return
        if still(safe):
            return
        self.refused_for += self.settings.rules.dt
        if left != NO_MOVE and self.refused_for > PATIENCE:
            self._refused |= kind(left)
            self.state = self.state._replace(left=NO_MOVE)

    def _bar(self, safe: Twist, passed: Twist) -> None:
        """Bar the kind of motion of which monitors have passed less than half for `PATIENCE`.

        They know what no obstacle says: a thing that left the view is remembered by them for a
        minute. An evasion that backs towards it would stand there and try.
        """
        evasion, now = self.state.evasion, self.state.time
        goes, asked, got = evasion.v, safe.v, passed.v
        if goes == 0.0:
            goes, asked, got = evasion.omega, safe.omega, passed.omega
        held = evasion.on and goes * asked > 0.0 and goes * got < 0.5 * goes * asked
        self._held_back = self._held_back + self.settings.rules.dt if held else 0.0
        if self._held_back > PATIENCE:
            self._barred[begins(evasion.v, evasion.omega)] = now + _BARS
        barred = sum(one for one, until in self._barred.items() if now < until)
        if barred != self.state.barred:
            self.state = self.state._replace(barred=barred)

    def reshape(self, outline: Floats) -> None:
        """Use another outline from the next step on, (k, 2), as in the settings."""
        self.settings = self.settings._replace(outline=_contiguous(outline))

    def task(
        self, pose: Pose, twist: Twist, obstacles: Surroundings, unobserved: slice = slice(0, 0)
    ) -> Task:  # fmt: skip
        """A snapshot to plan from. unobserved: border of unobserved space, see `Task`."""
        since = self.state.time - self._taken
        led = self.behavior == LED
        state = self.state._replace(refused=self.state.refused | self._refused)
        return Task(
            state, pose, twist, obstacles, self.course, since, led, self.refused_for, unobserved,
            self.settings.outline,
        )  # fmt: skip

    def plan(
        self, pose: Pose, twist: Twist, obstacles: Surroundings, unobserved: slice = slice(0, 0)
    ) -> Plan:  # fmt: skip
        """The slow part here and now: `planner` on a snapshot. `take` it afterwards."""
        return self.planner(self.task(pose, twist, obstacles, unobserved))

    def take(self, made: Plan, pose: Pose, twist: Twist) -> None:
        """Follow a plan from now on; pose and twist are those of now, not of the snapshot."""
        before = self.state.left
        self.state = taken(self.state, made, self.planner, pose, twist)
        if self.state.left != before:
            self.refused_for = 0.0  # a move has its own time to begin
        self.course = made.course
        if made.new:
            self._taken = self.state.time

    @property
    def arrived(self) -> bool:
        """Whether the clock is at the end of the last path."""
        return self.course.last and self.state.clock.tau >= self.course.reference.duration


def taken(state: PilotState, made: Plan, planner: Planner, pose: Pose, twist: Twist) -> PilotState:
    """The state with which a plan is adopted.

    The time for which the robot has been held up is kept, unless the plan was made for that, and
    gets its time.
    """
    clock, waited = state.clock, state.clock.waited
    move = made.move if state.left == NO_MOVE else None
    if made.new:
        there = pose if move is None else after(move, pose)
        clock = clock_on_entry(made.course, planner.route, state.row, there, twist)
        clock = clock._replace(waited=0.0 if made.held else waited)
    if move is not None:
        clock = clock._replace(rate=0.0, waited=0.0)
        return state._replace(
            clock=clock, left=move, moves=state.moves + 1, awaits=False,
            pinned=0.0 if made.frees else state.pinned,
        )  # fmt: skip
    return state._replace(clock=clock, awaits=False)


_STATE = len(names(PilotState))


def _contiguous(array: Floats) -> Floats:
    return np.ascontiguousarray(array, dtype=np.float64)


@jit
def _step(
    state: Floats, x: float, y: float, psi: float, v: float, omega: float, stick_x: float,
    stick_psi: float, discs: Floats, max_acceleration: Floats, velocity_error: Floats,
    segments: Floats, points: Floats,
    knots: Floats, coeffs: Floats, speed: float, poses: Floats, rates: Floats, back: int,
    rejoins: float, line: Floats, outline: Floats, settings: Floats, dt: float, sent: Floats,
    mover_history: Floats, fresh: bool, out: Floats,
) -> None:  # fmt: skip
    """`pilot_step` of numbers and arrays, which come from Python faster than named tuples; state
    and decision are written into out."""
    course = Course(
        Reference(knots, coeffs, speed), poses, Profile(rates, knots[-1]), back, rejoins, True
    )
    next_state, decision = pilot_step(
        read(PilotState, state, 0), Pose(x, y, psi), Twist(v, omega), Stick(stick_x, stick_psi),
        Surroundings(discs, max_acceleration, velocity_error, segments, points), course, line,
        read(Settings, settings, 0, (outline,)), dt, sent, mover_history, fresh,
    )  # fmt: skip
    write(next_state, out, 0)
    write(decision, out, _STATE)
