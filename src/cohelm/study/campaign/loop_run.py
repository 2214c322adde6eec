"""An episode on the twin, driven by the shipped loop with its gate and monitors.

All of it in simulated time: `Loop` with its sensor watchdog, stick arming, plans that take their
time, the gate, the collision monitor and the plausibility monitor. As a supervisor would, it resets
a stop a second later, and chooses the mode again. Interventions of gate and monitors are counted.
An attacker drives by the same loop in manual; attacker and walkers know the true state.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import CENTRED, Floats, Stick
from cohelm.link.messages import Arming, Mode
from cohelm.link.operator import Scripted
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop, LoopParams
from cohelm.loop.planning import InProcessPlanner
from cohelm.perceive.pipeline import Perception
from cohelm.robot.gate.gate import Passed, Proposal
from cohelm.robot.gate.modes import driving, latched
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.sim.adversarial import AdversarialScene, Attack, deflection
from cohelm.sim.setup import Setup
from cohelm.sim.twin.drive import TwinRun, stepped as stepped
from cohelm.sim.twin.movers import Pursuers
from cohelm.sim.twin.robot import Twin
from cohelm.study.campaign.episode import Interventions

_RESET_AFTER = 1.0
"""A stop is reset so soon [s]."""


class Watched(LocalGatedRobot):
    """A gated robot in this process that counts what it does."""

    def __init__(self, robot: Twin, period: float, acted: Interventions) -> None:
        super().__init__(robot, rules(robot.model, period))
        self._acted = acted

    def propose(self, proposal: Proposal) -> Passed:
        """As any gated robot."""
        passed, acted = super().propose(proposal), self._acted
        if driving(self.gate.mode):
            by_monitor = self.monitor_share < 1.0
            acted.monitors += by_monitor
            acted.gate += not by_monitor and passed.applied != proposal.twist
        return passed


class Looped(TwinRun):
    """The loop drives the robot, behind its gate."""

    def __init__(
        self, setup: Setup, acted: Interventions, pursuers: Pursuers | None = None
    ) -> None:
        super().__init__(setup, pursuers)
        if setup.twin is None or not (self.guarded and self.seeing):
            raise CohelmError("the loop needs a twin with a LiDAR and a pilot")
        self.acted = acted
        self.gated = Watched(self.robot, setup.dt, acted)
        steered = setup.operator.active or bool(
            np.any(setup.recorded_stick.x) or np.any(setup.recorded_stick.psi)
        )
        self.mode = Mode.SHARED if steered else Mode.AUTOMATIC
        self.now = self.stick
        """The deflection of this step."""
        self.loop = Loop(
            self.gated, Perception(self.robot.model, setup.twin.known, setup.start),
            Driver(
                self.pilot, self.settings, self.delay, InProcessPlanner(self.pilot.planner),
                self.piloted.zones,
            ),
            Scripted(lambda _: self.now, self.gated.now), RecordLine(None),
            LoopParams(period=setup.dt),
        )  # fmt: skip
        self.course = self.pilot.course
        self.latched_at = math.nan

    def step(self, k: int, row: Any) -> None:
        """Control period k, written into the row."""
        then, self.now = self.truth, self.operator_stick(k, self.discs())
        self._supervise(k * self.setup.dt)
        self.loop.period()
        self.gated.wait((k + 1) * self.setup.dt)
        self.moved(self.now)
        self.acted.periods += 1
        if self.pilot.course is not self.course:
            self.course = self.pilot.course
            self.courses = self.courses + 1 if self.course.row else 0
        decided = self.loop.decision
        if decided is not None:
            row["saturated"] = self.gated.gate.applied != decided.safe
        self.write(row, k, then, decided)

    def _supervise(self, now: float) -> None:
        """Has the robot drive, at first and again after each stop."""
        gate = self.gated.gate
        if latched(gate.mode):
            if math.isnan(self.latched_at):
                self.latched_at = now
                self.acted.stops += 1
                self.acted.why = self.acted.why or gate.reason
            if now < self.latched_at + _RESET_AFTER or self.gated.reset():
                return
        self.latched_at = math.nan
        if not driving(self.gated.gate.mode) and self.loop.seen is not None:
            self.loop.supervisor.choose(self.mode)


class Attacked(Looped):
    """The attacker drives alone, in manual, and centres the stick whenever it has to be armed. The
    walkers pursue the robot."""

    def __init__(
        self, setup: Setup, acted: Interventions, scene: AdversarialScene, attack: Attack
    ) -> None:
        max_acceleration = np.zeros(len(setup.obstacles.discs))
        max_acceleration[: len(scene.max_acceleration)] = scene.max_acceleration
        super().__init__(setup, acted, Pursuers(max_acceleration, scene.walk, attack.seed))
        self.mode, self.attack, self.held = Mode.MANUAL, attack, self.stick

    def operator_stick(self, k: int, discs: Floats) -> Stick:
        """What the attacker does in step k."""
        setup = self.setup
        self.held = deflection(
            self.attack, self.held, k, setup.dt, self.truth.pose, discs, setup.obstacles.walls
        )
        return self.held if self.loop.supervisor.stick_state.arming == Arming.ARMED else CENTRED
