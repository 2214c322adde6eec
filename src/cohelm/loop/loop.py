"""The control loop: read, perceive, decide, gate, report; one period after the other."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from cohelm.core.types import Floats
from cohelm.law.verdict import Verdict
from cohelm.link.messages import AlarmKind, Severity
from cohelm.link.operator import Operator
from cohelm.loop.alarms import ActiveAlarms
from cohelm.loop.docking import Docking
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.sensor_watchdog import SensorWatchdog, timeouts
from cohelm.loop.speed_caps import NO_CAP, UNCAPPED_DELAY, Cap, latency_cap, lost_cap, unseen_cap
from cohelm.loop.status import PeriodReport, Reporter
from cohelm.loop.stick import ArmingParams
from cohelm.loop.supervisor import PLANNED, Supervisor
from cohelm.loop.timing import Timing
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.pilot.reshaping import Shape
from cohelm.pilot.step import Decision
from cohelm.plan.docks import Dock
from cohelm.robot.gate.gate import STANDING, Passed, Proposal
from cohelm.robot.gate.modes import driving, latched
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import standing, still
from cohelm.robot.keep.process import GatedRobot
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.port import Readings

_JUMPED = 10.0  # no period is as late [s]
_NO_PLANNER = "the path planner has ended: the robot keeps its path"
_LATE_PLANNER = "the path planner does not answer: the robot keeps its path"
_OUTLINE_CHANGED = "the outline has changed: both apply until the robot can stop clear with both"
_OUTLINE_CHANGING = "outline change: both outlines apply until the new one fits"
_IN_ZONE = "in a keep-out zone: only motion out of it is allowed"
_RECORDER_HANGS = "the recorder is too slow: messages are lost"


class LoopParams(NamedTuple):
    """Parameters of the loop."""

    period: float = 0.02
    """[s]"""
    carry_on: bool = False
    """Whether the controller drives on alone when the stick in use, or the driver, is lost,
    instead of stopping."""
    arming: ArmingParams = ArmingParams()
    """Parameters of the stick's arming."""
    patience: float = 0.0
    """Extra time that a reading may be missing [s]."""


class Loop:
    """One robot's loop. `period` executes one period; `run` repeats it."""

    def __init__(
        self, gated: GatedRobot, perception: Perception, driver: Driver, operator: Operator,
        record: RecordLine, params: LoopParams, live: RecordLine | None = None,
        docks: Sequence[Dock] = (),
    ) -> None:  # fmt: skip
        """live: the live view."""
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
            self.log, operator, driver, gated.model, self.has_map, params.period
        )
        self.cap = NO_CAP
        """Speed cap by the driver's delay, speed zones, docking, or a lost pose."""
        self.readings: Readings | None = None
        self.seen: Seen | None = None
        self.decision: Decision | None = None
        self._shape = Shape(gated.model.outline, self._reshape)
        self._outline_changing = False
        """Whether the previous outline still counts too."""
        self._sensor_watchdog = SensorWatchdog(
            gated.model, timeouts(gated.model, params.period + params.patience)
        )
        self._number = 0
        self._due = -math.inf
        self._lost = False
        self._arrived = False
        self._garbage: Sweeper | None = None
        self._late = self._took = 0.0

    def run(self, until: Callable[[Loop], bool], real_time: bool = True) -> None:
        """Execute periods until `until`, called after each one, is true.

        real_time: collect garbage in spare time only.
        """
        self._garbage = Sweeper() if real_time else None
        switch = sys.getswitchinterval()
        sys.setswitchinterval(5e-4)  # bounds the wait for another thread
        try:
            self._due = self.gated.now()
            while True:
                self.period()
                if until(self):
                    return
                self.gated.wait(self._due)
        finally:
            sys.setswitchinterval(switch)
            if self._garbage is not None:
                self._garbage.end()

    def record_into(self, line: RecordLine) -> None:
        """Use another recorder from now on, or none; the previous one is not closed."""
        self.log.set_recorder(line)
        self.alarms.over("recorder")

    @property
    def has_map(self) -> bool:
        """Whether the pose is on a map, and not the odometry's."""
        return self.perception.known is not None

    @property
    def outline(self) -> Floats:
        """The robot's newest outline, (k, 2) [m]; the same array as long as it is unchanged."""
        return self._shape.reported

    def set_driver(self, driver: Driver) -> None:
        """Use another driver from now on; the previous one is not closed."""
        driver.zones = self.driver.zones  # they may have changed meanwhile
        driver.reshape(self._shape.outline)
        self.supervisor.checking_route, self.supervisor.unreachable = False, ""
        self.driver = self.supervisor.driver = self._reporter.driver = driver

    def period(self) -> None:
        """One period: read, perceive, decide, gate, send; then record and report."""
        gated = self.gated
        began = gated.now()
        late = began - self._due if self._due > -math.inf else 0.0
        readings = self.readings = gated.read()
        now = gated.now()  # after reading, so that no reading is from the future
        if self._shape.take(readings.outline):
            self._outline_changing = True
            self.log.event(_OUTLINE_CHANGED)
        seen = self.driver.with_zones(self._perceive(now, readings))
        supervisor = self.supervisor
        supervisor.follow_gate()
        supervisor.take_input(now)
        supervisor.watch_docking(now, seen, self._reporter.held)
        decision, self.cap = None, NO_CAP
        if supervisor.may_drive:
            self._limit_speed(seen)
            decision = supervisor.decide(now, seen)
        self.decision = decision
        passed = self._propose(readings, decision)
        if self._outline_changing:
            passed = self._settle_outline(seen, decision, passed)
        self._late, self._took = late, gated.now() - began
        self._raise_alarms(seen)
        watchdog = self._sensor_watchdog
        report = PeriodReport(
            now, readings, seen, supervisor.stick_state, decision, passed.applied,
            watchdog.measures, watchdog.sees,
        )  # fmt: skip
        limit = Cap(passed.limit, passed.limit_reason)
        slowest = min(self.cap, limit) if limit.speed < self.driver.settings.gains.u_d else self.cap
        words = supervisor.status_words(passed.reason, slowest)
        self._reporter.report(report, self._loop_fields(seen), words, self.timing.recent)
        self._keep_time(now)

    def _perceive(self, now: float, readings: Readings) -> Seen:
        """Check the readings, and update perception."""
        problem, before = self._sensor_watchdog.problem(now, readings), self.supervisor.problem
        if problem and not before:
            self.log.event(problem, serious=driving(self.gated.gate.mode))
        elif before and not problem:
            self.log.event("the readings are valid again")
        if problem and driving(self.gated.gate.mode):
            self.gated.fault(problem)
        seen = self.perception.take(now, readings)
        if seen.lost != self._lost:
            self._lost = seen.lost
            self.log.event(
                f"lost: {seen.reason}" if seen.lost else "localized on the map", seen.lost
            )
        if seen.lost and self.has_map:
            why = f"lost: {seen.reason}"
            if not self.alarms.on("lost", why, kind=AlarmKind.LOST):
                self.alarms.reword("lost", why)  # the remedy may have changed
        else:
            self.alarms.off("lost")
        self.seen = seen
        self.supervisor.problem, self.supervisor.seen = problem, seen
        self.supervisor.unsound = still(readings.health)
        self.driver.update_twist(seen.twist)
        return seen

    def _limit_speed(self, seen: Seen) -> None:
        """Set the speed limit, by the driver's scale and delay, speed zones and docking; while lost
        by the clearance; while backing by ground that was never seen."""
        driver, supervisor = self.driver, self.supervisor
        stick = supervisor.stick_state
        caps = [NO_CAP, driver.speed_zone_cap(seen), supervisor.docking.cap]
        settings = driver.settings
        if self.decision is not None and self.decision.safe.v < 0.0:  # a period ago
            caps += [unseen_cap(seen.assumed_gap, settings)]
        if stick.delay > UNCAPPED_DELAY or seen.lost:
            clearance = driver.clearance(seen)
            caps += [latency_cap(stick.delay, clearance, settings)]
            caps += [lost_cap(clearance, driver.delay, settings)] if seen.lost else []
        self.cap = min(caps)
        share = stick.speed_scale
        allowed_speed = share * driver.settings.gains.u_d if share < 1.0 else math.inf
        driver.max_speed = min(allowed_speed, self.cap.speed)

    def _propose(self, readings: Readings, decision: Decision | None) -> Passed:
        """Propose to the gate; with wrong readings nothing, so that the watchdog trips."""
        safe = STANDING if decision is None else decision.safe
        gate, problem = self.gated.gate, self.supervisor.problem
        if problem or readings.odometry is None:
            self.driver.record_applied(STANDING)
            applied = STANDING if latched(gate.mode) else gate.applied  # which sends a stop
            return Passed(applied, gate.reason or problem)
        self._number += 1
        passed = self.gated.propose(Proposal(self._number, readings.odometry.stamp, safe))
        self.driver.record_applied(STANDING if latched(self.gated.gate.mode) else passed.applied)
        return passed

    def _reshape(self, outline: Floats) -> None:
        for one in (self.driver, self.perception, self.supervisor.docking):
            one.reshape(outline)

    def _settle_outline(self, seen: Seen, decision: Decision | None, passed: Passed) -> Passed:
        """Drop the previous outline once it is safe; while it makes the robot brake, say so."""
        verdict = Verdict.STANDING if decision is None else Verdict(decision.verdict)
        stands = passed.applied == STANDING and standing(seen.twist)
        self._outline_changing = self._shape.settle(verdict, stands)
        if not self._outline_changing:
            self.log.event("the earlier outline no longer applies")
            self.log.outline(self.outline)
        elif decision is not None and verdict in (Verdict.BRAKING, Verdict.STANDING):
            return passed._replace(reason=passed.reason or _OUTLINE_CHANGING)
        return passed

    def _raise_alarms(self, seen: Seen) -> None:
        """Raise and clear alarms, by the gate's state and the helper processes."""
        gate, alarms = self.gated.gate, self.alarms
        self.supervisor.follow_gate()
        alarms.trouble("stopped", gate.reason if latched(gate.mode) else "")
        if not self.driver.in_keep_out(seen):
            alarms.off("zone")
        elif alarms.on("zone", _IN_ZONE, Severity.WARNING):
            self.log.event(_IN_ZONE)
        if self.log.failed():
            alarms.off("recorder")
            alarms.on("recorder", self.log.fault)
        elif not self.log.fault:
            self._alarm_while("recorder", _RECORDER_HANGS if self.log.hung else "")
        self._alarm_while("live view", self.log.view_trouble())
        late = _LATE_PLANNER if self.driver.planner_late and self.supervisor.mode in PLANNED else ""
        self._alarm_while("planner", _NO_PLANNER if self.driver.planner_gone else late)
        if self.driver.arrived != self._arrived:
            self._arrived = self.driver.arrived
            if self._arrived:
                self.log.event("arrived: the route is done")

    def _alarm_while(self, helper: str, trouble: str) -> None:
        """An alarm about a helper process, as long as there is trouble with it."""
        before = self.alarms.trouble(helper, trouble)
        if before != trouble:
            self.log.event(trouble or f"over: {before}", bool(trouble))

    def _loop_fields(self, seen: Seen) -> dict[str, Any]:
        """The loop's own fields of a period's row."""
        gate, (phase, dock) = self.gated.gate, self.supervisor.docking.phase(seen)
        return {
            "mode": gate.mode, "refused": gate.refused,
            "docking": phase, "dock": dock,
            "late": self._late, "took": self._took, "overruns": self.timing.overruns,
        }  # fmt: skip

    def _keep_time(self, now: float) -> None:
        """Schedule the next period. Missed ones are counted, never caught up in a burst."""
        end, period = self.gated.now(), self.params.period
        if self._due == -math.inf:
            self._due = now
        following = self._due + period
        self.timing.add(now, self._late, self._took, end > following)
        if following > end + 2.0 * period or following < end - _JUMPED:
            following = end  # the clock has jumped: neither wait for it nor count
        while following < end:  # a skipped period counts as a late one
            self.timing.missed(end - following)
            following += period
        self._due = following
        if self._garbage is not None and following - end > 0.5 * period:
            self._garbage.sweep(now)
