"""The control loop: one period after the other, each at its time, whatever happens in it."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Twist
from cohelm.law.guard.surroundings import Surroundings
from cohelm.link.latency_speed_limit import FREE as NOTICED
from cohelm.link.messages import Arming, Ask, Discs, Mode, Severity
from cohelm.link.operator_input import ClientRequest, OperatorInput, stops_first
from cohelm.link.rate import Coalesced
from cohelm.link.recorded_status import StatusWords
from cohelm.loop.alarms import ActiveAlarms
from cohelm.loop.authorization import Authorization
from cohelm.loop.docking import Docking, Ended
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.dropout import WAITING, Dropout, Then, followed
from cohelm.loop.latency_limit import FREE, allowed, cap, crawl, far, silent
from cohelm.loop.operator import Operator
from cohelm.loop.sensor_watchdog import SensorWatchdog, patience
from cohelm.loop.status import PeriodReport, known, predicted, scan_parts, status, unseen
from cohelm.loop.stick_arming import CENTRED, ArmingParams, StickState, updated
from cohelm.loop.timing import Timing
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.pilot.step import Decision
from cohelm.plan.docks import Dock
from cohelm.robot.gate.gate import STANDING, Passed, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import Keeper
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.port import Readings

_GATE = {
    Mode.HOLD: GateMode.IDLE, Mode.AUTOMATIC: GateMode.AUTOMATIC,
    Mode.SHARED: GateMode.SHARED, Mode.MANUAL: GateMode.SHARED,
}  # fmt: skip
_PLANNED = (Mode.AUTOMATIC, Mode.SHARED)
"""Modes that follow a route, and so need plans."""
_MODES = frozenset(int(mode) for mode in Mode)
_MOST_STATUSES = 50.0  # statuses a second, at most
_MOST_DISCS = 40  # shown, at most
_NO_PLANNER = "the path planner is gone: the robot keeps to its course"
_MOST_REQUESTS = 8
"""Done for one client in one period, as many as one command carries; a stop always."""
_LATE_PLANNER = "the path planner does not answer: the robot keeps to its course"
_IN_ZONE = "in a keep-out zone: it can drive out, but no deeper"
_MUTE_RECORDER = "the recorder does not answer: what it has no room for is lost"


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
        self, keeper: Keeper, perception: Perception, driver: Driver, operator: Operator,
        record: RecordLine, params: LoopParams, has_map: bool, live: RecordLine | None = None,
        docks: Sequence[Dock] = (),
    ) -> None:  # fmt: skip
        """has_map: whether `perception` localises on one. live: to who looks on. docks: on it."""
        self.keeper, self.perception, self.driver = keeper, perception, driver
        self.operator, self.params = operator, params
        self.timing, self.alarms = Timing(), ActiveAlarms()
        self.mode = Mode.HOLD
        self.stick_state = StickState()
        self._dropout = Dropout()
        self._lines = Coalesced()  # of requests: a flood fills no record
        self.problem = ""
        """What is wrong with the readings; empty: nothing."""
        self.cap = FREE
        """On the speed, by the driver's delay, or while lost."""
        self._pauses: dict[str, str] = {}
        self._operator_chose = False  # the mode: so he must go on being heard
        self.lease = (0, 0)
        """Who drives, 0: nobody; and a count of the leases."""
        self.rights = Authorization()
        lidars = [one.lidar() for one in keeper.model.lidars]
        self.docking = Docking(docks, driver.settings, driver.delay, lidars)
        self.log = DriveLog(record, keeper.now, live)
        self._latched = (GateMode.IDLE, "")
        self._allowed_share = 1.0
        self._delay = math.nan
        self.readings: Readings | None = None
        self.seen: Seen | None = None
        self.turning = False
        """Whether `run` is at work."""
        self.decision: Decision | None = None
        self.has_map = has_map
        """Whether the pose is that of a map, and not the odometry's."""
        self._senses = SensorWatchdog(
            keeper.model, patience(keeper.model, params.period + params.patience)
        )
        self._lidars = {"": (0, perception.lidar)} | {
            one.name: (k, one.lidar()) for k, one in enumerate(keeper.model.further_lidars, 1)
        }
        """By the names of their scans; the first one's has none that counts."""
        self._number = 0
        self._due = -math.inf
        self._lost = False
        self._arrived = False
        self._safe = STANDING
        self._last_status = -math.inf
        self._garbage: Sweeper | None = None
        self._late = self._took = 0.0
        self._trouble: dict[str, str] = {}
        """With what works for the loop, by name."""
        self._driven_by = (0, "")
        self._held = ""
        """What the guard holds it back for that nothing shows."""

    def run(self, until: Callable[[Loop], bool], real_time: bool = True) -> None:
        """Turn until `until` says so; it is asked after every period.

        real_time: nothing may be late; in simulated time Python sweeps its garbage as it likes.
        """
        self._garbage = Sweeper() if real_time else None
        switch = sys.getswitchinterval()
        sys.setswitchinterval(5e-4)  # another thread may not keep the loop waiting for long
        try:
            self._due = self.keeper.now()
            self.turning = True
            while True:
                self.period()
                if until(self):
                    return
                self.keeper.wait(self._due)
        finally:
            self.turning = False
            sys.setswitchinterval(switch)
            if self._garbage is not None:
                self._garbage.end()

    def record_into(self, line: RecordLine) -> None:
        """Another recorder from now on, or none; the one before is not closed."""
        self.log.into(line)
        self._trouble.pop("recorder", "")
        self.alarms.off("recorder")

    def choose(self, mode: Mode) -> str:
        """Who drives from now on; why not, or nothing. Not for what a person asks for: `_mode`."""
        return self._choose(mode, 0)

    def _choose(self, mode: Mode, who: int) -> str:
        """who: the client that chooses; 0: the robot, or who started it."""
        if mode != Mode.HOLD and self.problem:
            return self.problem
        if mode in _PLANNED and self.driver.pilot is None:
            return "there is no route to follow"
        said = self.keeper.drive(_GATE[mode])
        if not said:
            self._over(Ended(f"mode {mode.name}"))
            self.mode = mode
            self._forget_dropout()
            self._event(f"mode {mode.name}")
            if mode == Mode.HOLD:
                self.rights.end(who, self.keeper.now())
        return said

    def dock(self, number: int = 0, backwards: bool = False) -> str:
        """Dock, or backwards: undock, from now on; why not, or nothing. Not for what a person asks
        for: `_dock`. number: of the dock, from 1; 0: the one it is at."""
        if self.problem or self.seen is None:
            return self.problem or "the robot has seen nothing yet"
        if self._pauses:
            return f"not while the robot waits: {self.paused}"
        said = self.docking.refusal(number, self.seen, self.stick_state.stick, backwards)
        said = said or self.keeper.drive(GateMode.AUTOMATIC)
        if not said:
            self._over(Ended("another was asked for"))
            self.mode = Mode.AUTOMATIC
            self._forget_dropout()
            self.docking.begin(self.keeper.now(), number, self.seen, backwards)
            self._event(self.docking.doing)
        return said

    def _over(self, ended: Ended) -> None:
        """Docking or undocking, if one of them went on."""
        if self.docking.on:
            self._event(f"{self.docking.doing} ended: {ended.why}")
            self.docking.over(ended)
            self.cap = FREE

    def _watch_docking(self, now: float, seen: Seen) -> None:
        """Whatever ends it ends in hold."""
        docking = self.docking
        if not docking.on:
            return
        told = self.keeper.gate.out
        paused = bool(self._pauses)
        ended = docking.ended(now, seen, told, self.stick_state.stick, paused, self._held)
        if ended is None:
            return
        if not ended.arrived:
            self.alarms.on("dock", f"{docking.doing}: {ended.why}", Severity.WARNING)
            self.alarms.off("dock")  # to be acknowledged; there is nothing that goes on
        self._over(ended)
        self.choose(Mode.HOLD)

    def pause(self, name: str, why: str) -> None:
        """Brake and stand in the mode it is, until `go_on(name)`: nothing remembers a mode, so what
        ends the mode meanwhile (hold, stop, fault, another choice) is never undone."""
        if name not in self._pauses:
            self._event(f"stands: {why}")
        self._pauses[name] = why

    def go_on(self, name: str) -> None:
        """What that pause was for is over; where there is another one, the robot still stands."""
        if self._pauses.pop(name, ""):
            self._event(f"goes on: {name}")

    @property
    def paused(self) -> str:
        """Why it stands in a driving mode; empty: it does not."""
        return next(iter(self._pauses.values()), "")

    def period(self) -> None:
        """One turn: read, perceive, step, gate, send; then record and report."""
        keeper = self.keeper
        began = keeper.now()
        late = began - self._due if self._due > -math.inf else 0.0
        readings = self.readings = keeper.read()
        now = keeper.now()  # after them: what a held-up loop reads is not from the future
        self._perceive(now, readings)
        self._follow_gate()
        self._take_input(now)
        decision = None
        seen = self.seen
        if seen is not None:
            self._watch_docking(now, seen)
        free = driving(keeper.gate.mode) and not self.problem and not self._pauses
        if free and seen is not None:
            decision = self._decide(now, seen)
        passed = self._propose(readings, decision)
        self.decision = decision
        self._late, self._took = late, keeper.now() - began
        self._raise_alarms(now)
        report = self._report(now, readings, passed)
        if report is not None:
            self._send_status(report, self._record(report), passed.reason)
        self._keep_time(now)

    def _perceive(self, now: float, readings: Readings) -> None:
        """Are the readings to be relied on, and what do they say?"""
        problem = self._senses.wrong(now, readings)
        if problem and not self.problem:
            self._event(problem, serious=driving(self.keeper.gate.mode))
        elif self.problem and not problem:
            self._event("the readings are sound")
        self.problem = problem
        if problem and driving(self.keeper.gate.mode):
            self.keeper.fault(problem)
        seen = self.perception.take(now, readings)
        if seen.lost != self._lost:
            self._lost = seen.lost
            self._event(f"lost: {seen.reason}" if seen.lost else "found on the map", seen.lost)
        if seen.lost and self.has_map:
            if not self.alarms.on("lost", why := f"lost: {seen.reason}"):
                self.alarms.reword("lost", why)  # what helps now may be something else
        else:
            self.alarms.off("lost")
        self.seen = seen
        self.driver.moved(seen.twist)

    def _in_zone(self, seen: Seen) -> None:
        """Whoever drives is told that the robot is where it must not be, and that it may leave."""
        if self.driver.kept_in(seen):
            if self.alarms.on("zone", _IN_ZONE, Severity.WARNING):
                self._event(_IN_ZONE)
        else:
            self.alarms.off("zone")

    def _take_input(self, now: float) -> None:
        """What does the person want, and may the stick be believed?"""
        received = self.operator.receive()
        self._driven_by = (received.driver, received.name)
        self._allowed_share = allowed(received, self._allowed_share)
        self._heed_lease(received)
        self._answer_requests(received)
        stopped = latched(self.keeper.gate.mode)
        arming, period = self.params.arming, self.params.period
        self.stick_state = updated(self.stick_state, received, arming, period, stopped)
        self._watch_operator(now, received)
        self._delay = far(received, self.stick_state)

    def _watch_operator(self, now: float, received: OperatorInput) -> None:
        """Is the stick in use there, and the driver?"""
        if not driving(self.keeper.gate.mode):
            self._forget_dropout()
        stick = self.stick_state.lost if self.keeper.gate.mode == GateMode.SHARED else ""
        quiet = silent(received, self.params.arming.stale) if self._operator_chose else ""
        if self.stick_state.arming == Arming.ARMED:
            self.alarms.off("stick")
        if not quiet:
            self.alarms.off("driver")
        if not driving(self.keeper.gate.mode):
            return
        name = "stick" if stick else "driver"
        why = stick or quiet
        if why and self.params.carry_on and (not stick or self.mode == Mode.SHARED):
            if self.alarms.on(name, f"the {name} is lost: {why}") or stick:
                self._event(f"{why}: the controller carries on alone", True)
            why = ""
        lost = f"the {name} is lost: {why}" if why else ""
        before = self._dropout
        self._dropout, then = followed(before, lost, received, self.stick_state, now)
        if then == Then.STOP:
            said = before.why or lost
            self.alarms.on("driver" if said.startswith("the driver") else "stick", said)
            self.keeper.stop(said)
            self._pauses.pop("stick", "")  # it does not go on
        elif then == Then.GO_ON:
            self.go_on("stick")
        elif self._dropout.why:
            waiting = math.isfinite(self._dropout.back)
            self.pause("stick", WAITING if waiting else self._dropout.why)

    def _forget_dropout(self) -> None:
        """What ends or chooses a mode wins: nothing of before is gone on with."""
        self._dropout = self._dropout.over
        self.go_on("stick")

    def _heed_lease(self, received: OperatorInput) -> None:
        """A mode lives no longer than the lease in which it was chosen."""
        before, self.lease = self.lease, (received.driver, received.term)
        theirs = self._operator_chose and driving(self.keeper.gate.mode)
        if before[1] == received.term or not theirs:
            return
        if received.driver == 0 and not self.params.carry_on:
            return  # the driver is lost: more than a hold
        self._event("the one who chose the mode drives no more: hold")
        self.choose(Mode.HOLD)

    def _answer_requests(self, received: OperatorInput) -> None:
        """Do or refuse each, and answer."""
        done: dict[int, int] = {}
        for line in self._lines.due(self.keeper.now()):
            self._event(line)
        requests = stops_first(received.requests)
        if requests and requests[0].request.what == Ask.STOP:
            self._stop(requests[0].name)  # once a period, however many say so
        for asked in requests:
            count = done[asked.client] = done.get(asked.client, 0) + 1
            if count > _MOST_REQUESTS and asked.request.what != Ask.STOP:
                granted, reason = False, "too many requests: wait a moment and ask again"
            else:
                granted, reason = self._request(asked, received.driver)
            self.operator.answer(asked.client, asked.request.number, granted, reason)

    def _request(self, asked: ClientRequest, driver: int) -> tuple[bool, str]:
        what, value = asked.request.what, asked.request.value
        said = "the loop does not do that"
        if what == Ask.STOP:
            self.rights.end(asked.client, self.keeper.now())
            self.rights.stand(asked)
            said = ""
        elif what == Ask.RESET:
            said = self._refusal(asked, driver) or self.problem or self.keeper.reset()
        elif what == Ask.ACKNOWLEDGE:
            said = "" if self.alarms.acknowledge(value) else "there is no such alarm"
        elif what == Ask.MODE:
            said = self._mode(asked, driver) if value in _MODES else "there is no such mode"
        elif what in (Ask.DOCK, Ask.UNDOCK):
            said = self._dock(asked, driver)
        text = f"{asked.name} asks for {what.name} {value}: {said or 'done'}"
        for line in self._lines.add(self.keeper.now(), text, text):
            self._event(line)
        return not said, said

    def _stop(self, name: str) -> None:
        before = self.keeper.gate
        self.keeper.stop(f"stop by {name}")
        gate = self.keeper.gate
        if not latched(before.mode) and gate.mode == GateMode.STOPPED:
            self._latched = (gate.mode, gate.reason)  # this person's, not the robot's

    def _mode(self, asked: ClientRequest, driver: int) -> str:
        mode = Mode(asked.request.value)
        hold = mode == Mode.HOLD
        said = self._refusal(asked, driver, hold) or self._choose(mode, asked.client)
        if not said:
            self._operator_chose = not hold
            if hold:
                self.rights.stand(asked)
        return said

    def _dock(self, asked: ClientRequest, driver: int) -> str:
        backwards = asked.request.what == Ask.UNDOCK
        said = self._refusal(asked, driver) or self.dock(asked.request.value, backwards)
        if not said:
            self._operator_chose = True
        return said

    def _refusal(self, asked: ClientRequest, driver: int, hold: bool = False) -> str:
        return self.rights.refusal(asked, driver, self.keeper.now(), hold)

    def _follow_gate(self) -> None:
        """What the gate latched by itself ends all modes; it is heeded before any request."""
        gate = self.keeper.gate
        state = (gate.mode, gate.reason) if latched(gate.mode) else (GateMode.IDLE, "")
        if state != self._latched:
            self._latched = state
            if latched(gate.mode):
                self.rights.end(0, self.keeper.now())
        if not driving(gate.mode) and self.mode != Mode.HOLD:
            self._over(Ended(gate.reason))
            self.mode = Mode.HOLD

    def _decide(self, now: float, seen: Seen) -> Decision:
        obstacles = self.driver.around(seen)
        self._limit_speed(seen, obstacles)
        docking = self.docking
        if docking.on:
            return self.driver.along(docking.pilot, now, seen.pose, obstacles, docking.backwards)
        stick = self.stick_state.stick if self.keeper.gate.mode == GateMode.SHARED else CENTRED
        if self.mode == Mode.MANUAL:
            return self.driver.by_hand(now, seen.pose, stick, obstacles, gently=False)
        if seen.lost or self.driver.pilot is None:
            return self.driver.by_hand(now, seen.pose, stick, obstacles, gently=True)
        return self.driver.follow(now, seen.pose, stick, obstacles)

    def _limit_speed(self, seen: Seen, obstacles: Surroundings) -> None:
        """How fast it may be asked to go: what the driver allows, his delay, speed zones, and where
        the robot has lost its place, what it sees."""
        driver, caps = self.driver, [FREE, self.driver.slowed(seen), self.docking.cap]
        if self._delay > NOTICED or seen.lost:
            clearance, settings = driver.clear(seen.pose, obstacles, seen.blind), driver.settings
            caps += [cap(self._delay, clearance, settings)]
            caps += [crawl(clearance, self.driver.delay, settings)] if seen.lost else []
        self.cap = min(caps)
        share = self._allowed_share
        allowed_speed = share * driver.settings.gains.u_d if share < 1.0 else math.inf
        driver.fastest = min(allowed_speed, self.cap.speed)

    def _propose(self, readings: Readings, decision: Decision | None) -> Passed:
        """To the gate; but with readings that are wrong nothing, and the watchdog counts."""
        safe = Twist(decision.safe_v, decision.safe_omega) if decision is not None else STANDING
        self._safe = safe
        gate = self.keeper.gate
        if self.problem or readings.odometry is None:
            self.driver.given(STANDING)
            return Passed(gate.out, gate.reason or self.problem)
        self._number += 1
        passed = self.keeper.propose(Proposal(self._number, readings.odometry.stamp, safe))
        self.driver.given(STANDING if latched(self.keeper.gate.mode) else passed.out)
        return passed

    def _raise_alarms(self, now: float) -> None:
        """Follow what the gate did by itself, and whether recorder and live view live."""
        gate = self.keeper.gate
        self._follow_gate()
        if latched(gate.mode):
            self.alarms.on("stopped", gate.reason)
        else:
            self.alarms.off("stopped")
        if self.seen is not None:
            self._in_zone(self.seen)
        if self.log.failed():
            self.alarms.off("recorder")
            self.alarms.on("recorder", self.log.fault)
        elif not self.log.fault:
            self._alarm_while("recorder", _MUTE_RECORDER if self.log.mute else "")
        self._alarm_while("live view", self.log.view_trouble())
        late = _LATE_PLANNER if self.driver.planless and self.mode in _PLANNED else ""
        self._alarm_while("planner", _NO_PLANNER if self.driver.stuck else late)
        if self.driver.arrived != self._arrived:
            self._arrived = self.driver.arrived
            if self._arrived:
                self._event("arrived: the route is done")

    def _alarm_while(self, helper: str, trouble: str) -> None:
        """An alarm about what works for the loop, as long as there is trouble with it."""
        before = self._trouble.get(helper, "")
        if trouble == before:
            return
        self._trouble[helper] = trouble
        self.alarms.off(helper)
        if trouble:
            self.alarms.on(helper, trouble)
        self._event(trouble or f"over: {before}", bool(trouble))

    def _report(self, now: float, readings: Readings, passed: Passed) -> PeriodReport | None:
        """What there is to say of this period; None before the robot has seen anything."""
        seen, driver = self.seen, self.driver
        new = self.log.readings(readings)
        if seen is None:
            return None
        for scan in new:
            which, lidar = self._lidars.get("" if scan is readings.scan else scan.sensor, (0, None))
            if lidar is not None:
                self.operator.show(*scan_parts(scan, lidar, seen.pose, which))
        if new and new[0] is readings.scan:
            discs = Discs(new[0].number, self._discs(seen))
            self.operator.show(discs)
            self.log.show(discs)
        clearance = driver.clear(seen.pose, driver.around(seen), seen.blind)
        return PeriodReport(
            now,
            readings,
            seen,
            self.stick_state,
            self.decision,
            passed.out,
            self._progress(),
            clearance,
        )

    def _record(self, report: PeriodReport) -> NDArray[np.void]:
        """The period's row, to the recorder, if it has room for it."""
        gate, (phase, dock) = self.keeper.gate, self.docking.phase(report.seen)
        return self.log.period(
            known(report)
            | {
                "mode": gate.mode, "refused": gate.refused, "dropped": self.log.dropped,
                "safe_v": self._safe.v, "safe_omega": self._safe.omega,
                "docking": phase, "dock": dock,
                "late": self._late, "took": self._took, "overruns": self.timing.overruns,
            }
        )  # fmt: skip

    def _discs(self, seen: Seen) -> NDArray[np.float32]:
        """The nearest round things, in the map, as `core.types` has them, (n, 6)."""
        rows = self.driver.around(seen).discs
        far = np.hypot(rows[:, 0] - seen.pose.x, rows[:, 1] - seen.pose.y)
        return rows[np.argsort(far)[:_MOST_DISCS]].astype(np.float32)

    def _send_status(self, report: PeriodReport, row: NDArray[np.void], refusal: str) -> None:
        """To the operator. refusal: why the gate did not pass what it was given."""
        if report.now - self._last_status < 1.0 / _MOST_STATUSES - 0.25 * self.params.period:
            return
        self._last_status = report.now
        nominal = Twist(float(row["nominal_v"]), float(row["nominal_omega"]))
        self._held = unseen(report, nominal)
        words = StatusWords(
            *self._driven_by, self.mode, self.keeper.gate.reason,
            refusal or self.paused or self._held, *self.cap, self.alarms.worst(),
        )  # fmt: skip
        self.log.words(words)
        told = status(row, words, self.has_map, predicted(report.seen.pose, report.applied))
        timing = told.timing._replace(late=self.timing.recent)
        self.operator.tell(
            told._replace(odometry=report.seen.odometry, recording=self.log.open, timing=timing)
        )

    def _keep_time(self, now: float) -> None:
        """When the next period is due. Missed ones are counted, never made up for in a burst."""
        end, period = self.keeper.now(), self.params.period
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

    def _progress(self) -> float:
        pilot = self.driver.pilot
        if pilot is None:
            return math.nan
        return pilot.state.row / max(len(pilot.planner.route.line) - 1, 1)

    def _event(self, text: str, serious: bool = False) -> None:
        self.log.event(text, serious)
