"""An episode on the twin, driven by the loop that drives robots: keeper, gate and monitors too.

What a robot is driven with is all here, in simulated time: `Loop` with its watch over the senses,
the stick that has to be armed, plans that take their time, the gate, the collision monitor and the
plausibility monitor. What a person would do about a stop is done: reset it a second later, and
choose the mode again. How often that was, and how often gate and monitors changed a command, is
counted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.trace import ROW, Trace
from cohelm.core.types import SAFE, Desired, Stick, X, Y
from cohelm.law.human import supplied_energy
from cohelm.law.reference import evaluate
from cohelm.law.track import pose_error
from cohelm.link.messages import Mode
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop, Ways
from cohelm.loop.operator import Scripted
from cohelm.loop.planning import InProcessPlanner
from cohelm.perceive.seen import Perception
from cohelm.pilot.careful import SLOP, noise, roomier
from cohelm.pilot.course import nearly_done
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.step import Decision
from cohelm.robot.gate.gate import Passed, Proposal
from cohelm.robot.gate.modes import driving, latched
from cohelm.robot.keep.gated_robot import GatedRobot, rules
from cohelm.robot.keep.record_pipe import Line
from cohelm.sim.operator_model import IDLE, operate, replayed
from cohelm.sim.setup import Setup
from cohelm.sim.twin.drive import DECIDED, between, held
from cohelm.sim.twin.robot import Truth, Twin
from cohelm.sim.twin.settings import lag
from cohelm.study.campaign.acted import Acted

_RESET_AFTER = 1.0
"""Somebody who looks on sees to a stop so soon [s]."""


class Watched(GatedRobot):
    """A keeper in this process that counts what it does."""

    def __init__(self, robot: Twin, period: float, acted: Acted) -> None:
        super().__init__(robot, rules(robot.model, period))
        self._acted = acted

    def propose(self, proposal: Proposal) -> Passed:
        """As any keeper."""
        passed, acted = super().propose(proposal), self._acted
        if driving(self.gate.mode):
            by_monitor = self.let_through < 1.0
            acted.monitors += by_monitor
            acted.gate += not by_monitor and passed.out != proposal.twist
        return passed


def pieces(setup: Setup, acted: Acted, length: int) -> Iterator[Trace]:
    """The drive in traces of `length` steps, the last one shorter; it ends on arrival."""
    run, k = _Drive(setup, acted), 0
    while k < setup.steps and not run.arrived:
        n, m = min(length, setup.steps - k), len(setup.around.discs)
        rows, h, discs = np.zeros(n, dtype=ROW), np.empty((n, m)), np.empty((n, m, 6))
        done = 0
        while done < n and not run.arrived:
            discs[done] = run.twin.things()
            away = discs[done, :, [X, Y]].T - run.truth.pose[:2]
            h[done] = (away**2).sum(axis=1) - discs[done, :, SAFE] ** 2
            run.step(k + done, rows[done])
            rows[done]["h"] = h[done].min(initial=math.inf)
            done += 1
        yield Trace(rows[:done], h[:done], discs[:done], setup.names, setup.dt, setup.scenario)
        k += done


class _Drive:
    """One drive between two periods."""

    def __init__(self, setup: Setup, acted: Acted) -> None:
        given, wanted = setup.twin, setup.pilot
        if given is None or given.known is None or wanted is None or wanted.lidar is None:
            raise CohelmError("the loop needs a twin with a LiDAR, a map and a pilot")
        model = given.robot.model_copy(update={"delay_s": given.robot.delay_s + setup.delay})
        around = setup.around
        if setup.barred is not None:  # the map's borders come with the map
            around = around._replace(walls=setup.barred)
        self.setup, self.acted = setup, acted
        self.twin = Twin(
            model, setup.start, around, grid=setup.grid, seed=setup.seed,
            settings=given.physics, camera="none", timeout=max(0.5, 3.0 * setup.dt),
        )  # fmt: skip
        self.keeper = Watched(self.twin, setup.dt, acted)
        sees = noise(self.twin.model)
        settings = wanted.settings._replace(limits=held(model.bounds(), given.physics))
        settings, manners, care = roomier(settings, wanted.manners, wanted.care, SLOP + sees, sees)
        delay = lag(model, given.physics, setup.dt)
        self.pilot = Pilot(setup.reference, settings, delay=delay, manners=manners, care=care)
        self.stick, self.person, self.energy = Stick(0.0, 0.0), IDLE, 0.0
        hands = setup.operator.active or bool(np.any(setup.hands.x) or np.any(setup.hands.psi))
        self.mode = Mode.SHARED if hands else Mode.AUTOMATIC
        self.loop = Loop(
            self.keeper, Perception(self.twin.model, given.known, setup.start),
            Driver(self.pilot, settings, delay, InProcessPlanner(self.pilot.planner)),
            Scripted(lambda _: self.stick, self.keeper.now), Line(None),
            Ways(period=setup.dt), has_map=True,
        )  # fmt: skip
        end = evaluate(setup.reference.knots, setup.reference.coeffs, setup.reference.duration)
        self.goal = (end.x, end.y)
        self.done = nearly_done(self.pilot.planner.route.line, setup.near)
        self.truth: Truth = self.twin.truth()
        self.course, self.courses = self.pilot.course, 0
        self.last: Decision | None = None
        self.latched_at = math.nan
        self.arrived = False

    def step(self, k: int, row: Any) -> None:
        """Control period k, written into the row."""
        setup, then = self.setup, self.truth
        before, self.stick = self.stick, self._hand(k, then)
        self._seen_to(k * setup.dt)
        self.loop.period()
        self.keeper.wait((k + 1) * setup.dt)
        self.truth = self.twin.truth()
        self.acted.periods += 1
        self.energy = supplied_energy(self.energy, before, self.stick, setup.gains)
        self._write(row, k, then)

    def _hand(self, k: int, then: Truth) -> Stick:
        setup = self.setup
        if not setup.operator.active:
            return replayed(setup.hands, k * setup.dt)
        self.person, stick = operate(
            self.person, setup.operator, then.pose, self.twin.things(), setup.around.noticed, k,
            setup.dt, setup.seed,
        )  # fmt: skip
        return stick

    def _seen_to(self, now: float) -> None:
        """Whoever looks on has the robot drive, at first and again after each stop."""
        gate = self.keeper.gate
        if latched(gate.mode):
            if math.isnan(self.latched_at):
                self.latched_at = now
                self.acted.stops += 1
                self.acted.why = self.acted.why or gate.reason
            if now < self.latched_at + _RESET_AFTER or self.keeper.reset():
                return
        self.latched_at = math.nan
        if not driving(self.keeper.gate.mode) and self.loop.seen is not None:
            self.loop.choose(self.mode)

    def _write(self, row: Any, k: int, then: Truth) -> None:
        setup, pose, d = self.setup, then.pose, self.loop.decision
        applied = between(then, self.truth, setup.dt)
        away = math.hypot(pose.x - self.goal[0], pose.y - self.goal[1])
        self.arrived = away < setup.near and self.pilot.state.row >= self.done
        if self.pilot.course is not self.course:
            self.course = self.pilot.course
            self.courses = self.courses + 1 if self.course.row else 0
        self.last = d or self.last
        row["t"] = k * setup.dt
        row["x"], row["y"], row["psi"] = pose
        if self.last is not None:
            of = self.last
            desired = Desired(of.x_d, of.y_d, of.psi_d, of.u_d, of.r_d)
            row["x_d"], row["y_d"], row["psi_d"], row["u_d"], row["r_d"] = desired
            row["e_p"] = pose_error(pose, desired)
        row["stick_x"], row["stick_psi"] = self.stick
        row["authority_x"] = row["authority_psi"] = 1.0
        row["gap"] = math.inf
        if d is not None:
            for name in DECIDED:
                row[name] = getattr(d, name)
            row["saturated"] = self.keeper.gate.out != (d.v, d.omega)
        row["applied_v"], row["applied_omega"] = applied
        row["clearance"], row["energy"] = then.clearance, self.energy
        row["course"], row["to_go"], row["arrived"] = self.courses, away, self.arrived
