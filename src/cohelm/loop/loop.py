"""The control loop: one period after the other, each at its time, whatever happens in it."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from cohelm.core.types import CENTRED, Floats, Twist
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.verdict import Verdict
from cohelm.link.latency_speed_limit import FREE as NOTICED
from cohelm.link.messages import Mode, Severity
from cohelm.loop.alarms import ActiveAlarms
from cohelm.loop.docking import Docking
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.latency_limit import FREE, cap, crawl
from cohelm.loop.operator import Operator
from cohelm.loop.reporter import Reporter
from cohelm.loop.sensor_watchdog import SensorWatchdog, patience
from cohelm.loop.stick_arming import ArmingParams
from cohelm.loop.supervisor import PLANNED, Supervisor
from cohelm.loop.timing import Timing
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.pilot.reshaping import Shape
from cohelm.pilot.step import Decision
from cohelm.plan.docks import Dock
from cohelm.robot.gate.gate import STANDING, Passed, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import GatedRobot, standing
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.port import Readings

_NO_PLANNER = "the path planner is gone: the robot keeps to its course"
_LATE_PLANNER = "the path planner does not answer: the robot keeps to its course"
_RESHAPED = "the robot has another outline: both count until it can stop clear with both"
_RESHAPING = "the outline changes, and both count until it fits"
_IN_ZONE = "in a keep-out zone: it can drive out, but no deeper"
_RECORDER_HANGS = "the recorder does not answer: what it has no room for is lost"


class LoopParams(NamedTuple):
    """How the loop drives."""

    period: float = 0.02
    """[s]"""
    carry_on: bool = False
    """Whether the controller drives on alone when a stick in use, or the driver, vanishes, instead
    of stopping."""
    arming: ArmingParams = ArmingParams()
    """When a stick is believed."""
    patience: float = 0.0
    """How much longer than usual a reading may be missing [s]."""


class Loop:
    """One robot's loop. `period()` is one turn; `run` turns until it is told to end."""

    def __init__(
        self, gated: GatedRobot, perception: Perception, driver: Driver, operator: Operator,
        record: RecordLine, params: LoopParams, has_map: bool, live: RecordLine | None = None,
        docks: Sequence[Dock] = (),
    ) -> None:  # fmt: skip
        """has_map: whether `perception` localises on one. live: to who looks on. docks: on it."""
        self.gated, self.perception, self.driver = gated, perception, driver
        self.operator, self.params = operator, params
        self.timing, self.alarms = Timing(), ActiveAlarms()
        self.log = DriveLog(record, gated.now, live)
        lidars = [one.lidar() for one in gated.model.lidars]
        docking = Docking(docks, driver.settings, driver.delay, lidars)
        self.supervisor = Supervisor(
            gated, driver, operator, docking, self.alarms, self.log, params.arming,
            params.period, params.carry_on,
        )  # fmt: skip
        self._reporter = Reporter(
            self.log, operator, driver, gated.model, perception.lidar, has_map, params.period
        )
        self.cap = FREE
        """On the speed, by the driver's delay, zones, docking, or while lost."""
        self.readings: Readings | None = None
        self.seen: Seen | None = None
        self.turning = False
        """Whether `run` is at work."""
        self.decision: Decision | None = None
        self._shape = Shape(gated.model.outline, self._reshape)
        self._reshaping = False
        """Whether the outline before counts too."""
        self.has_map = has_map
        """Whether the pose is that of a map, and not the odometry's."""
        self._senses = SensorWatchdog(
            gated.model, patience(gated.model, params.period + params.patience)
        )
        self._number = 0
        self._due = -math.inf
        self._lost = False
        self._arrived = False
        self._safe = STANDING
        self._garbage: Sweeper | None = None
        self._late = self._took = 0.0

    def run(self, until: Callable[[Loop], bool], real_time: bool = True) -> None:
        """Turn until `until` says so; it is asked after every period.

        real_time: nothing may be late; in simulated time Python sweeps its garbage as it likes.
        """
        self._garbage = Sweeper() if real_time else None
        switch = sys.getswitchinterval()
        sys.setswitchinterval(5e-4)  # another thread may not keep the loop waiting for long
        try:
            self._due = self.gated.now()
            self.turning = True
            while True:
                self.period()
                if until(self):
                    return
                self.gated.wait(self._due)
        finally:
            self.turning = False
            sys.setswitchinterval(switch)
            if self._garbage is not None:
                self._garbage.end()

    def record_into(self, line: RecordLine) -> None:
        """Another recorder from now on, or none; the one before is not closed."""
        self.log.into(line)
        self.alarms.over("recorder")

    @property
    def outline(self) -> Floats:
        """The robot's, as it said last; the same array as long as it is the same, (k, 2) [m]."""
        return self._shape.told

    def take_up(self, driver: Driver) -> None:
        """Another driver from now on; the one before is not closed."""
        driver.zones = self.driver.zones  # those may be others by now
        driver.reshape(self._shape.outline)
        self.driver = self.supervisor.driver = self._reporter.driver = driver

    def period(self) -> None:
        """One turn: read, perceive, step, gate, send; then record and report."""
        gated = self.gated
        began = gated.now()
        late = began - self._due if self._due > -math.inf else 0.0
        readings = self.readings = gated.read()
        now = gated.now()  # after them: what a held-up loop reads is not from the future
        if self._shape.take(readings.outline):
            self._reshaping = True
            self.log.event(_RESHAPED)
        seen = self._perceive(now, readings)
        supervisor = self.supervisor
        supervisor.follow_gate()
        supervisor.take_input(now)
        supervisor.watch_docking(now, seen, self._reporter.held)
        decision = self.decision = self._decide(now, seen) if supervisor.free else None
        if decision is None:
            self.cap = FREE
        passed = self._propose(readings, decision)
        if self._reshaping:
            passed = self._settle(seen, decision, passed)
        self._late, self._took = late, gated.now() - began
        self._raise_alarms(seen)
        report = self._reporter.report(
            now, readings, seen, supervisor.stick_state, decision, passed.out
        )
        row = self._reporter.record(report, self._own(seen))
        words = supervisor.words(passed.reason, self.cap)
        self._reporter.tell(report, row, words, self.timing.recent)
        self._keep_time(now)

    def _perceive(self, now: float, readings: Readings) -> Seen:
        """Are the readings to be relied on, and what do they say?"""
        problem, before = self._senses.wrong(now, readings), self.supervisor.problem
        if problem and not before:
            self.log.event(problem, serious=driving(self.gated.gate.mode))
        elif before and not problem:
            self.log.event("the readings are sound")
        if problem and driving(self.gated.gate.mode):
            self.gated.fault(problem)
        seen = self.perception.take(now, readings)
        if seen.lost != self._lost:
            self._lost = seen.lost
            self.log.event(f"lost: {seen.reason}" if seen.lost else "found on the map", seen.lost)
        if seen.lost and self.has_map:
            if not self.alarms.on("lost", why := f"lost: {seen.reason}"):
                self.alarms.reword("lost", why)  # what helps now may be something else
        else:
            self.alarms.off("lost")
        self.seen = seen
        self.supervisor.sensed(problem, seen)
        self.driver.moved(seen.twist)
        return seen

    def _decide(self, now: float, seen: Seen) -> Decision:
        obstacles = self.driver.around(seen)
        self._limit_speed(seen, obstacles)
        supervisor, docking = self.supervisor, self.supervisor.docking
        if docking.on:
            return self.driver.along(docking.pilot, now, seen.pose, obstacles, docking.backwards)
        by_stick = self.gated.gate.mode == GateMode.SHARED
        stick = supervisor.stick_state.stick if by_stick else CENTRED
        if supervisor.mode == Mode.MANUAL:
            return self.driver.by_hand(now, seen.pose, stick, obstacles, gently=False)
        if seen.lost or self.driver.pilot is None:
            return self.driver.by_hand(now, seen.pose, stick, obstacles, gently=True)
        return self.driver.follow(now, seen.pose, stick, obstacles)

    def _limit_speed(self, seen: Seen, obstacles: Surroundings) -> None:
        """How fast it may be asked to go: what the driver allows, his delay, speed zones, and where
        the robot has lost its place, what it sees."""
        driver, supervisor = self.driver, self.supervisor
        caps = [FREE, driver.slowed(seen), supervisor.docking.cap]
        if supervisor.delay > NOTICED or seen.lost:
            clearance, settings = driver.clear(seen.pose, obstacles, seen.blind), driver.settings
            caps += [cap(supervisor.delay, clearance, settings)]
            caps += [crawl(clearance, driver.delay, settings)] if seen.lost else []
        self.cap = min(caps)
        share = supervisor.allowed_share
        allowed_speed = share * driver.settings.gains.u_d if share < 1.0 else math.inf
        driver.fastest = min(allowed_speed, self.cap.speed)

    def _propose(self, readings: Readings, decision: Decision | None) -> Passed:
        """To the gate; but with readings that are wrong nothing, and the watchdog counts."""
        safe = Twist(decision.safe_v, decision.safe_omega) if decision is not None else STANDING
        self._safe = safe
        gate, problem = self.gated.gate, self.supervisor.problem
        if problem or readings.odometry is None:
            self.driver.given(STANDING)
            return Passed(gate.out, gate.reason or problem)
        self._number += 1
        passed = self.gated.propose(Proposal(self._number, readings.odometry.stamp, safe))
        self.driver.given(STANDING if latched(self.gated.gate.mode) else passed.out)
        return passed

    def _reshape(self, outline: Floats) -> None:
        for one in (self.driver, self.perception, self.supervisor.docking):
            one.reshape(outline)

    def _settle(self, seen: Seen, decision: Decision | None, passed: Passed) -> Passed:
        """Does the outline before still count, and is it why the robot brakes?"""
        verdict = Verdict.STANDING if decision is None else Verdict(decision.verdict)
        stands = passed.out == STANDING and standing(seen.twist)
        self._reshaping = self._shape.settle(verdict, stands)
        if not self._reshaping:
            self.log.event("the outline of before counts no more")
            self.log.outline(self.outline)
        elif decision is not None and verdict in (Verdict.BRAKING, Verdict.STANDING):
            return passed._replace(reason=passed.reason or _RESHAPING)
        return passed

    def _raise_alarms(self, seen: Seen) -> None:
        """Follow what the gate did by itself, and whether what works for the loop lives."""
        gate, alarms = self.gated.gate, self.alarms
        self.supervisor.follow_gate()
        if latched(gate.mode):
            alarms.on("stopped", gate.reason)
        else:
            alarms.off("stopped")
        if not self.driver.kept_in(seen):
            alarms.off("zone")
        elif alarms.on("zone", _IN_ZONE, Severity.WARNING):
            self.log.event(_IN_ZONE)
        if self.log.failed():
            alarms.off("recorder")
            alarms.on("recorder", self.log.fault)
        elif not self.log.fault:
            self._alarm_while("recorder", _RECORDER_HANGS if self.log.hung else "")
        self._alarm_while("live view", self.log.view_trouble())
        late = _LATE_PLANNER if self.driver.planless and self.supervisor.mode in PLANNED else ""
        self._alarm_while("planner", _NO_PLANNER if self.driver.stuck else late)
        if self.driver.arrived != self._arrived:
            self._arrived = self.driver.arrived
            if self._arrived:
                self.log.event("arrived: the route is done")

    def _alarm_while(self, helper: str, trouble: str) -> None:
        """An alarm about what works for the loop, as long as there is trouble with it."""
        before = self.alarms.trouble(helper, trouble)
        if before != trouble:
            self.log.event(trouble or f"over: {before}", bool(trouble))

    def _own(self, seen: Seen) -> dict[str, Any]:
        """What the loop adds to a period's row."""
        gate, (phase, dock) = self.gated.gate, self.supervisor.docking.phase(seen)
        return {
            "mode": gate.mode, "refused": gate.refused,
            "safe_v": self._safe.v, "safe_omega": self._safe.omega,
            "docking": phase, "dock": dock,
            "late": self._late, "took": self._took, "overruns": self.timing.overruns,
        }  # fmt: skip

    def _keep_time(self, now: float) -> None:
        """When the next period is due. Missed ones are counted, never made up for in a burst."""
        end, period = self.gated.now(), self.params.period
        if self._due == -math.inf:
            self._due = now
        following = self._due + period
        self.timing.add(now, self._late, self._took, end > following)
        while following < end:  # a period that never was is a late one
            self.timing.missed(end - following)
            following += period
        self._due = following
        if self._garbage is not None and following - end > 0.5 * period:
            self._garbage.sweep(now)
