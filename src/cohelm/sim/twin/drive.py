"""A run with the twin as the plant and the true pose given to the pilot, fully recorded.

Episodes of campaigns, which have to localize, go through the whole loop: `study.campaign.loop_run`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.flat import fill
from cohelm.core.frames import compose, inverse
from cohelm.core.obstacles import Surroundings
from cohelm.core.trace import Trace
from cohelm.core.types import SAFE, Floats, Pose, Stick, Twist, X, Y
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.human import supplied_energy
from cohelm.law.track import pose_error
from cohelm.perceive.pipeline import Perception
from cohelm.pilot.margin_inflation import SLOP, inflated, noise
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.replanning import Plan
from cohelm.pilot.step import Decision, Settings
from cohelm.plan.course import nearly_done
from cohelm.plan.zones import Zoned
from cohelm.robot.limits import Limits
from cohelm.sim.closed_loop import near_walls
from cohelm.sim.operator_model import IDLE, operate
from cohelm.sim.setup import Piloted, Setup
from cohelm.sim.twin.mjcf import GRAVITY
from cohelm.sim.twin.movers import Pursuers
from cohelm.sim.twin.robot import Twin, TwinTruth
from cohelm.sim.twin.settings import TwinModel, lag

_GRIP = 0.6  # share of what friction can hold that the guard counts on


def held(limits: Limits, physics: TwinModel) -> Limits:
    """The limits that the floor's friction allows: wheels that slip brake less."""
    most = _GRIP * physics.friction * GRAVITY
    return limits._replace(
        acceleration=min(limits.acceleration, most),
        wheel_acceleration=min(limits.wheel_acceleration, most),
    )


def pieces(setup: Setup, length: int = 200) -> Iterator[Trace]:
    """The run in traces of `length` steps, the last one shorter, in order; it ends on arrival
    where there is a pilot, as the kinematic run does."""
    return stepped(_KnownPose(setup), length)


def stepped(run: TwinRun, length: int) -> Iterator[Trace]:
    """The same for any run on the twin."""
    setup, k = run.setup, 0
    while k < setup.steps and not run.arrived:
        part, done = setup.blank(min(length, setup.steps - k)), 0
        while done < len(part) and not run.arrived:
            part.discs[done] = run.discs()
            part.h[done] = _h(run.truth.pose, part.discs[done])
            run.step(k + done, part.rows[done])
            part.rows[done]["h"] = part.h[done].min(initial=math.inf)
            done += 1
        yield part.until(done)
        k += done


class TwinRun(ABC):
    """One run on the twin between two steps: robot, pilot, operator. Subclasses say what commands
    the robot in a step."""

    def __init__(self, setup: Setup, pursuers: Pursuers | None = None) -> None:
        """pursuers: those of the moving discs that are after the robot."""
        twinned = setup.twin
        if twinned is None:
            raise CohelmError("this setup has no twin: set simulation.plant to twin")
        model = twinned.robot.model_copy(update={"delay_s": twinned.robot.delay_s + setup.delay})
        self.setup = setup
        obstacles = setup.obstacles
        if setup.barred is not None:  # the map's borders come with the map
            obstacles = obstacles._replace(walls=setup.barred)
        self.robot = self.made(
            model, setup.start, obstacles, grid=setup.grid, seed=setup.seed,
            settings=twinned.physics, camera="none", timeout=max(0.5, 3.0 * setup.dt),
            pursuers=pursuers,
        )  # fmt: skip
        self.guarded = setup.pilot is not None
        self.piloted = setup.pilot or _unguarded(setup)
        self.seeing = bool(self.piloted.lidars)
        settings = self.piloted.settings._replace(limits=held(model.bounds(), twinned.physics))
        path_params, replan_params = self.piloted.path_params, self.piloted.replan_params
        if self.guarded:
            sees = noise(self.robot.model) if self.seeing else 0.0
            settings, path_params, replan_params = inflated(
                settings, path_params, replan_params, SLOP + sees, sees
            )
        self.settings = settings
        self.delay = lag(model, twinned.physics, setup.dt) if self.guarded else 0.0
        self.pilot = Pilot(
            setup.reference, settings, delay=self.delay, path_params=path_params,
            replan_params=replan_params,
        )  # fmt: skip
        self.person, self.stick, self.energy = IDLE, Stick(0.0, 0.0), 0.0
        self.truth: TwinTruth = self.robot.truth()
        self.goal = setup.goal
        self.done = nearly_done(self.pilot.planner.route.line, setup.near)
        self.arrived = False
        self.courses = 0
        self.last: Decision | None = None

    made: Callable[..., Twin] = Twin
    """Makes the robot."""

    @abstractmethod
    def step(self, k: int, row: Any) -> None:
        """Control step k, from seeing to the next one, written into the row."""

    def discs(self) -> Floats:
        """All discs as they are."""
        return self.robot.discs()

    def operator_stick(self, k: int, discs: Floats) -> Stick:
        """What the person does in step k."""
        setup = self.setup
        self.person, stick = operate(
            self.person, setup.operator, setup.recorded_stick, self.truth.pose, discs,
            setup.obstacles.noticed, k, setup.dt, setup.seed,
        )  # fmt: skip
        return stick

    def moved(self, stick: Stick) -> None:
        """The step is over."""
        self.truth = self.robot.truth()
        self.energy = supplied_energy(self.energy, self.stick, stick, self.setup.gains)
        self.stick = stick

    def write(self, row: Any, k: int, then: TwinTruth, d: Decision | None) -> None:
        """What came of step k, from where it then was; d: None where nothing was decided,
        and what was to be followed is as it was."""
        setup, pose = self.setup, then.pose
        applied = between(then, self.truth, setup.dt)
        away = math.hypot(pose.x - self.goal[0], pose.y - self.goal[1])
        reached = away < setup.near and (not self.guarded or self.pilot.state.row >= self.done)
        self.arrived = self.guarded and reached
        row["t"] = k * setup.dt
        row["x"], row["y"], row["psi"] = pose
        row["stick_x"], row["stick_psi"] = self.stick
        row["authority_x"] = row["authority_psi"] = 1.0
        row["clearance_seen"] = math.inf
        if d is not None:
            fill(row, d)
        self.last = last = d or self.last
        if last is not None:
            row["x_d"], row["y_d"], row["psi_d"], row["u_d"], row["r_d"] = last.desired
            row["e_p"] = pose_error(pose, last.desired)
        row["applied_v"], row["applied_omega"] = applied
        row["clearance"], row["energy"] = then.clearance, self.energy
        row["course"], row["to_go"], row["arrived"] = self.courses, away, reached


class _KnownPose(TwinRun):
    """The pilot drives with the true pose."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self.walls = setup.obstacles.walls
        self.perception = Perception(self.robot.model) if self.seeing else None
        self.max_acceleration = self.piloted.max_acceleration
        self.period = max(round(self.piloted.period / setup.dt), 1)
        self.thinking = min(round(self.piloted.thinking / setup.dt), self.period - 1)
        self.waiting: Plan | None = None
        zones = self.piloted.zones
        self.zones = None
        if zones:
            self.zones = Zoned(
                zones, self.settings.outline, self.settings.gains.u_d, self.settings.limits
            )

    def step(self, k: int, row: Any) -> None:
        """Control step k, from seeing to the next one, written into the row."""
        then = self.truth
        discs = self.discs()
        pose = then.pose
        obstacles, unobserved, twist, scans = self._seen(k * self.setup.dt, then, discs)
        fastest = math.inf
        if self.zones is not None:
            obstacles = self.zones.beside(obstacles, pose)
            fastest = self.zones.limit(pose)[0]
        stick = self.operator_stick(k, discs)
        self._plan(k, pose, twist, obstacles, unobserved)
        now = k * self.setup.dt
        decided = self.pilot.step(now, pose, twist, stick, obstacles, fastest, scans)
        row["saturated"] = self.robot.send(decided.safe) != decided.safe
        self.robot.wait((k + 1) * self.setup.dt)
        self.moved(stick)
        self.write(row, k, then, decided)

    def _seen(
        self, t: float, now: TwinTruth, discs: Floats
    ) -> tuple[Surroundings, slice, Twist, int]:
        """What is around the robot where it really is, which of its points are unobserved space,
        the robot's speed, and how many scans it has had."""
        if self.perception is None:
            obstacles = surroundings(discs, self.max_acceleration, self.walls)
            return obstacles, slice(0, 0), now.twist, 0
        seen = self.perception.take(t, self.robot.read())
        # Where it is on the map is known; all else is as it senses, without a map in `odom`.
        odom = compose(now.pose, inverse(seen.odometry))
        return seen.obstacles.placed(odom), seen.unobserved, seen.twist, seen.scans

    def _plan(
        self, k: int, pose: Pose, twist: Twist, obstacles: Surroundings, unobserved: slice
    ) -> None:
        """Begins a plan once a period, and takes it up when it would be ready."""
        if not self.guarded:
            return
        if k % self.period == 0:
            reaction = self.period * self.setup.dt + self.delay
            self.walls = near_walls(self.setup.obstacles.walls, pose, self.settings, reaction)
            self.waiting = self.pilot.plan(pose, twist, obstacles, unobserved)
        if self.waiting is not None and k % self.period == self.thinking:
            self.pilot.take(self.waiting, pose, twist)
            if self.waiting.new:
                self.courses = self.courses + 1 if self.waiting.course.row else 0
            self.waiting = None


def _unguarded(setup: Setup) -> Piloted:
    """The paper's law: no plans, and a reference that runs on with time."""
    settings = Settings(
        setup.outline, setup.limits, setup.gains, Rules(dt=setup.dt),
        guarded=False, spline_speed=setup.spline_speed,
    )  # fmt: skip
    return Piloted(settings, np.zeros(len(setup.obstacles.discs)))


def _h(pose: Pose, discs: Floats) -> Floats:
    dx, dy = pose.x - discs[:, X], pose.y - discs[:, Y]
    return dx * dx + dy * dy - discs[:, SAFE] ** 2


def between(a: TwinTruth, b: TwinTruth, dt: float) -> Twist:
    """The twist whose arc leads from one pose to the next; none while the robot stands."""
    if a.standing and b.standing:
        return Twist(0.0, 0.0)
    half = 0.5 * (b.pose.psi - a.pose.psi)
    dx, dy = b.pose.x - a.pose.x, b.pose.y - a.pose.y
    along = math.cos(a.pose.psi + half) * dx + math.sin(a.pose.psi + half) * dy
    stretch = half / math.sin(half) if abs(half) > 1e-9 else 1.0
    return Twist(along * stretch / dt, 2.0 * half / dt)
