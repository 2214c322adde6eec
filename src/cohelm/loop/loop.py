"""The loop: one period after the other, each at its time, whatever happens in it."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.row import ROW, values
from cohelm.core.types import Twist, wrap
from cohelm.law.guard.surroundings import Surroundings
from cohelm.link.latency_speed_limit import FREE as NOTICED
from cohelm.link.messages import Arming, Ask, Discs, Map, Mode, Polyline, Status
from cohelm.link.operator_input import Asked, OperatorInput, stops_first
from cohelm.link.rate import Coalesced
from cohelm.link.recorded_status import Shown, Told
from cohelm.loop.alarms import Alarms
from cohelm.loop.driver import Driver
from cohelm.loop.dropout import WAITING, Dropout, Then, followed
from cohelm.loop.latency_limit import FREE, allowed, cap, crawl, far, silent
from cohelm.loop.operator import Operator
from cohelm.loop.sensor_watchdog import SensorWatchdog, patience
from cohelm.loop.status import Said, limiting, predicted, scan_parts, sigma, status
from cohelm.loop.stick_arming import CENTRED, ArmingParams, Person, renewed
from cohelm.loop.timing import Timing
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.pilot.step import Decision
from cohelm.robot.gate.gate import STANDING, Passed, Proposal
from cohelm.robot.gate.modes import Mode as GateMode, driving, latched
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import Event, Keeper
from cohelm.robot.keep.record_pipe import Line
from cohelm.robot.port import Readings

_GATE = {
    Mode.HOLD: GateMode.IDLE, Mode.AUTOMATIC: GateMode.AUTOMATIC,
    Mode.SHARED: GateMode.SHARED, Mode.MANUAL: GateMode.SHARED,
}  # fmt: skip
_PLANNED = (Mode.AUTOMATIC, Mode.SHARED)
"""Modes that follow a route, and so need plans."""
_MODES = frozenset(int(mode) for mode in Mode)
_TOLD = 50.0  # statuses a second, at most
_DISCS = 40  # shown, at most
_NO_PLANNER = "what plans ways round is gone: the robot keeps to the course it has"
_MOST_REQUESTS = 8
"""Done for one client in one period, as many as one command carries; a stop always."""
_REMEMBERED = 10.0
"""No request is done that is so old [s]."""
_LATE_PLANNER = "what plans ways round does not answer: the robot keeps to the course it has"
_MUTE_RECORDER = "the recorder gives no sign of life: what it has no room for is lost"


class LoopParams(NamedTuple):
    """How the loop goes about it."""

    period: float = 0.02
    """[s]"""
    carry_on: bool = False
    """Whether the controller drives on alone when a stick in use, or the driver, vanishes, instead
    of stopping."""
    manner: ArmingParams = ArmingParams()
    patience: float = 0.0
    """How much longer than usual a reading may be missing [s]."""


class Loop:
    """One robot's loop. `period()` is one turn; `run` turns until it is told to end."""

    def __init__(
        self, keeper: Keeper, perception: Perception, driver: Driver, operator: Operator,
        record: Line, ways: LoopParams, has_map: bool,
    ) -> None:  # fmt: skip
        """has_map: whether `perception` localises on one."""
        self.keeper, self.perception, self.driver = keeper, perception, driver
        self.operator, self.ways = operator, ways
        self.timing, self.alarms = Timing(), Alarms()
        self.mode = Mode.HOLD
        self.person = Person()
        self._dropout = Dropout()
        self._lines = Coalesced()  # of requests: a flood fills no record
        self.problem = ""
        """What is wrong with the readings; empty: nothing."""
        self.cap = FREE
        """On the speed, by the driver's delay, or while lost."""
        self._pauses: dict[str, str] = {}
        self._led = False  # a person chose the mode, and must go on being heard
        self.lease = (0, 0)
        """Who drives, 0: nobody; and a count of the leases."""
        self.ended = 0
        """How often a mode was ended, or forbidden: by a stop, hold, fault, or the lease's end."""
        self._stood: dict[int, int] = {}
        """The number of each client's newest request to stand."""
        self._ended: dict[int, float] = {}
        """When each client did that last, 0: the robot itself [s]."""
        self._latched = (GateMode.IDLE, "")
        self._scale = 1.0
        self._delay = math.nan
        self.readings: Readings | None = None
        self.seen: Seen | None = None
        self.turning = False
        """Whether `run` is at work."""
        self.decision: Decision | None = None
        self._record = record
        self._has_map = has_map
        self._senses = SensorWatchdog(
            keeper.model, patience(keeper.model, ways.period + ways.patience)
        )
        self._row = np.zeros((), dtype=ROW)
        self._number = 0
        self._due = -math.inf
        self._lost = False
        self._arrived = False
        self._odometry = -math.inf
        self._scan = -1
        self._asked = STANDING
        self._told = -math.inf
        self._garbage: Sweeper | None = None
        self._late = self._took = 0.0
        self._recorder = ""
        self._trouble: dict[str, str] = {}
        """With what works for the loop, by name."""
        self._driven_by = (0, "")
        self._kept: Told | None = None

    def run(self, until: Callable[[Loop], bool]) -> None:
        """Turn until `until` says so; it is asked after every period."""
        self._garbage = Sweeper()
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
            self._garbage.end()

    @property
    def dropped(self) -> int:
        """Messages the recorder had no room for."""
        return self._record.dropped

    @property
    def record_fault(self) -> str:
        """Why the recorder writes no more; empty while it does, or where there is none."""
        return self._recorder

    @property
    def recording(self) -> bool:
        """Whether there is a recorder that still writes."""
        return self._record.open and not self._recorder

    def record(self, message: object) -> None:
        """Something that is not the loop's own, to its recorder, if that has room for it."""
        self._record(message)

    def record_into(self, line: Line) -> None:
        """Another recorder from now on, or none; the one before is not closed."""
        self._record, self._recorder, self._kept = line, "", None
        self._trouble.pop("recorder", "")
        self.alarms.off("recorder")

    def note(self, what: Map | Polyline) -> None:
        """Into the record, that a drive can be shown again."""
        self._record(Shown(self.keeper.now(), what))

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
            self.mode = mode
            self._forget_dropout()
            self._event(f"mode {mode.name}")
            if mode == Mode.HOLD:
                self._end(who)
        return said

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
        """One turn: read, perceive, step, gate, send; then tell and record."""
        keeper = self.keeper
        began = keeper.now()
        late = began - self._due if self._due > -math.inf else 0.0
        readings = self.readings = keeper.read()
        now = keeper.now()  # after them: what a held-up loop reads is not from the future
        self._look(now, readings)
        self._notice()
        self._listen(now)
        decision = None
        seen = self.seen
        free = driving(keeper.gate.mode) and not self.problem and not self._pauses
        if free and seen is not None:
            decision = self._decide(now, seen)
        passed = self._propose(readings, decision)
        self.decision = decision
        self._late, self._took = late, keeper.now() - began
        self._watch(now)
        self._write(now, readings, passed)
        self._tell(now, passed)
        self._keep_time(now)

    def _look(self, now: float, readings: Readings) -> None:
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
        if seen.lost and self._has_map:
            self.alarms.on("lost", f"lost: {seen.reason}")
        else:
            self.alarms.off("lost")
        self.seen = seen
        self.driver.moved(seen.twist)

    def _listen(self, now: float) -> None:
        """What does the person want, and may the stick be believed?"""
        heard = self.operator.heard()
        self._driven_by = (heard.driver, heard.name)
        self._scale = allowed(heard, self._scale)
        self._heed_lease(heard)
        self._requests(heard)
        stopped = latched(self.keeper.gate.mode)
        self.person = renewed(self.person, heard, self.ways.manner, self.ways.period, stopped)
        self._believe(now, heard)
        self._delay = far(heard, self.person)

    def _believe(self, now: float, heard: OperatorInput) -> None:
        """Is the stick in use there, and the driver?"""
        if not driving(self.keeper.gate.mode):
            self._forget_dropout()
        stick = self.person.lost if self.keeper.gate.mode == GateMode.SHARED else ""
        quiet = silent(heard, self.ways.manner.stale) if self._led else ""
        if self.person.arming == Arming.ARMED:
            self.alarms.off("stick")
        if not quiet:
            self.alarms.off("driver")
        if not driving(self.keeper.gate.mode):
            return
        name = "stick" if stick else "driver"
        why = stick or quiet
        if why and self.ways.carry_on and (not stick or self.mode == Mode.SHARED):
            if self.alarms.on(name, f"the {name} is lost: {why}") or stick:
                self._event(f"{why}: the controller carries on alone", True)
            why = ""
        lost = f"the {name} is lost: {why}" if why else ""
        before = self._dropout
        self._dropout, then = followed(before, lost, heard, self.person, now)
        if then == Then.STOP:
            said = before.why or lost
            self.alarms.on("driver" if said.startswith("the driver") else "stick", said)
            self.keeper.stop(said)
            self.go_on("stick")
        elif then == Then.GO_ON:
            self.go_on("stick")
        elif self._dropout.why:
            waiting = math.isfinite(self._dropout.back)
            self.pause("stick", WAITING if waiting else self._dropout.why)

    def _forget_dropout(self) -> None:
        """What ends or chooses a mode wins: nothing of before is gone on with."""
        self._dropout = self._dropout.over
        self.go_on("stick")

    def _heed_lease(self, heard: OperatorInput) -> None:
        """A mode lives no longer than the lease in which it was chosen."""
        before, self.lease = self.lease, (heard.driver, heard.term)
        if before[1] == heard.term or not (self._led and driving(self.keeper.gate.mode)):
            return
        if heard.driver == 0 and not self.ways.carry_on:
            return  # the driver is lost: more than a hold
        self._event("the one who chose the mode drives no more: hold")
        self.choose(Mode.HOLD)

    def _requests(self, heard: OperatorInput) -> None:
        """Do or refuse each, and answer."""
        done: dict[int, int] = {}
        for line in self._lines.due(self.keeper.now()):
            self._event(line)
        asked_now = stops_first(heard.asked)
        if asked_now and asked_now[0].request.what == Ask.STOP:
            self._stop(asked_now[0].name)  # once a period, however many say so
        for asked in asked_now:
            count = done[asked.client] = done.get(asked.client, 0) + 1
            if count > _MOST_REQUESTS and asked.request.what != Ask.STOP:
                granted, reason = False, "too many requests: wait a moment and ask again"
            else:
                granted, reason = self._request(asked, heard.driver)
            self.operator.answer(asked.client, asked.request.number, granted, reason)

    def _request(self, asked: Asked, driver: int) -> tuple[bool, str]:
        what, value = asked.request.what, asked.request.value
        said = "the loop does not do that"
        if what == Ask.STOP:
            self._end(asked.client)
            self._stood[asked.client] = asked.request.number
            said = ""
        elif what == Ask.RESET:
            said = self._not_now(asked, driver) or self.problem or self.keeper.reset()
        elif what == Ask.ACKNOWLEDGE:
            said = "" if self.alarms.acknowledge(value) else "there is no such alarm"
        elif what == Ask.MODE:
            said = self._mode(asked, driver) if value in _MODES else "there is no such mode"
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

    def _mode(self, asked: Asked, driver: int) -> str:
        mode = Mode(asked.request.value)
        hold = mode == Mode.HOLD  # to stand is never too late
        said = self._not_now(asked, driver, hold) or self._choose(mode, asked.client)
        if not said:
            self._led = not hold
            if hold:
                self._stood[asked.client] = asked.request.number
        return said

    def _not_now(self, asked: Asked, driver: int, hold: bool = False) -> str:
        """Why a request may not lead to driving; empty: it may.

        Whoever asked must drive still, and must have asked after everything that ended a mode or
        forbade one; what he did himself counts by the order of his requests.
        """
        if asked.client != driver:
            return "you do not drive"
        now, who, number = self.keeper.now(), asked.client, asked.request.number
        made, own = now - asked.age, self._ended.get(who, -math.inf)
        others = (at for other, at in self._ended.items() if other != who)
        if not hold and now - own < _REMEMBERED and number < self._stood.get(who, 0):
            return "you told the robot to stand after that: ask again"
        if not hold and (math.isnan(made) or made <= max(others, default=-math.inf)):
            return "the robot was told to stand after you asked: ask again"
        return ""

    def _end(self, who: int) -> None:
        """No mode, and no request made before, leads on from here. who: client; 0: the robot."""
        now = self.keeper.now()
        self.ended += 1
        self._ended = {w: at for w, at in self._ended.items() if now - at < _REMEMBERED}
        self._stood = {w: number for w, number in self._stood.items() if w in self._ended}
        self._ended[who] = now

    def _notice(self) -> None:
        """What the gate latched by itself ends all modes; it is heeded before any request."""
        gate = self.keeper.gate
        state = (gate.mode, gate.reason) if latched(gate.mode) else (GateMode.IDLE, "")
        if state != self._latched:
            self._latched = state
            if latched(gate.mode):
                self._end(0)
        if not driving(gate.mode) and self.mode != Mode.HOLD:
            self.mode = Mode.HOLD

    def _decide(self, now: float, seen: Seen) -> Decision:
        around = self.driver.around(seen)
        self._bound(seen, around)
        stick = self.person.stick if self.keeper.gate.mode == GateMode.SHARED else CENTRED
        if self.mode == Mode.MANUAL:
            return self.driver.by_hand(now, seen.pose, stick, around, gently=False)
        if seen.lost or self.driver.pilot is None:
            return self.driver.by_hand(now, seen.pose, stick, around, gently=True)
        return self.driver.follow(now, seen.pose, stick, around)

    def _bound(self, seen: Seen, around: Surroundings) -> None:
        """How fast it may be asked to go: what the driver allows, his delay, and where the robot
        has lost its place, what it sees."""
        driver, self.cap = self.driver, FREE
        if self._delay > NOTICED or seen.lost:
            clear, settings = driver.clear(seen.pose, around, seen.blind), driver.settings
            caps = [cap(self._delay, clear, settings)]
            caps += [crawl(clear, self.driver.delay, settings)] if seen.lost else []
            self.cap = min(caps)
        usual = self._scale * driver.settings.gains.u_d if self._scale < 1.0 else math.inf
        driver.fastest = min(usual, self.cap.speed)

    def _propose(self, readings: Readings, decision: Decision | None) -> Passed:
        """To the gate; but with readings that are wrong nothing, and the watchdog counts."""
        asked = Twist(decision.safe_v, decision.safe_omega) if decision is not None else STANDING
        self._asked = asked
        gate = self.keeper.gate
        if self.problem or readings.odometry is None:
            self.driver.given(STANDING)
            return Passed(gate.out, gate.reason or self.problem)
        self._number += 1
        passed = self.keeper.propose(Proposal(self._number, readings.odometry.stamp, asked))
        self.driver.given(STANDING if latched(self.keeper.gate.mode) else passed.out)
        return passed

    def _watch(self, now: float) -> None:
        """Follow what the gate did by itself, and whether the recorder lives."""
        gate = self.keeper.gate
        self._notice()
        if latched(gate.mode):
            self.alarms.on("stopped", gate.reason)
        else:
            self.alarms.off("stopped")
        said = self._record.heard() or self._record.broken
        if said and said != self._recorder:
            self._recorder = str(said)
            self.alarms.off("recorder")
            self.alarms.on("recorder", self._recorder)
        elif not said and not self._recorder:
            self._heed("recorder", _MUTE_RECORDER if self._record.mute else "")
        late = _LATE_PLANNER if self.driver.planless and self.mode in _PLANNED else ""
        self._heed("planner", _NO_PLANNER if self.driver.stuck else late)
        if self.driver.arrived != self._arrived:
            self._arrived = self.driver.arrived
            if self._arrived:
                self._event("arrived: the route is done")

    def _heed(self, helper: str, trouble: str) -> None:
        """An alarm about what works for the loop, as long as there is trouble with it."""
        before = self._trouble.get(helper, "")
        if trouble == before:
            return
        self._trouble[helper] = trouble
        self.alarms.off(helper)
        if trouble:
            self.alarms.on(helper, trouble)
        self._event(trouble or f"over: {before}", bool(trouble))

    def _write(self, now: float, readings: Readings, passed: Passed) -> None:
        """To the recorder, as much as it has room for."""
        odometry, scan = readings.odometry, readings.scan
        if odometry is not None and odometry.stamp != self._odometry:
            self._odometry = odometry.stamp
            self._record(odometry)
        if scan is not None and scan.number != self._scan:
            self._scan = scan.number
            self._record(scan)
            if self.seen is not None:
                self.operator.show(*scan_parts(scan, self.perception.lidar, self.seen.pose))
                discs = Discs(scan.number, self._discs(self.seen))
                self.operator.show(discs)
                self._record(Shown(now, discs))
        nan = math.nan
        d, seen, gate, person = self.decision, self.seen, self.keeper.gate, self.person
        if seen is None:
            return
        known = {"nominal_v": 0.0, "nominal_omega": 0.0} if d is None else d._asdict()
        known |= {
            "t": now, "x": seen.pose.x, "y": seen.pose.y, "psi": seen.pose.psi,
            "sigma": sigma(seen.covariance), "share": seen.share, "lost": seen.lost,
            "measured_v": seen.twist.v, "measured_omega": seen.twist.omega,
            "e_p": self._e_p(), "progress": self._progress(),
            "stick_x": person.stick.x, "stick_psi": person.stick.psi, "stick_age": person.age,
            "arming": person.arming, "mode": gate.mode,
            "safe_v": self._asked.v, "safe_omega": self._asked.omega,
            "applied_v": passed.out.v, "applied_omega": passed.out.omega,
            "odometry_age": now - odometry.stamp if odometry else nan,
            "scan_age": now - scan.stamp - scan.duration if scan else nan,
            "late": self._late, "took": self._took, "overruns": self.timing.overruns,
            "refused": gate.refused, "dropped": self._record.dropped,
        }  # fmt: skip
        if d is not None:
            known["limiting_x"], known["limiting_y"] = limiting(d, seen)
        self._row[()] = values(known)
        self._record(self._row.tobytes())

    def _discs(self, seen: Seen) -> NDArray[np.float32]:
        """The nearest round things, in the map, as `core.types` has them, (n, 6)."""
        rows = self.driver.around(seen).discs
        far = np.hypot(rows[:, 0] - seen.pose.x, rows[:, 1] - seen.pose.y)
        return rows[np.argsort(far)[:_DISCS]].astype(np.float32)

    def _tell(self, now: float, passed: Passed) -> None:
        if now - self._told < 1.0 / _TOLD - 0.25 * self.ways.period or self.seen is None:
            return
        self._told = now
        gate, clear = self.keeper.gate, -math.inf
        if self.seen.blind:
            around = self.driver.around(self.seen)
            clear = self.driver.clear(self.seen.pose, around, self.seen.blind)
        said = Said(
            self.mode, gate.reason, self.person, self.seen, self._has_map, self.decision,
            passed.out, passed.reason or self.paused, self._e_p(), self._progress(),
            self.recording, self.timing.recent, self.timing.overruns,
            self.alarms.worst(), self.cap, clear,
        )  # fmt: skip
        told = status(said, predicted(self.seen.pose, passed.out))
        self.operator.tell(told)
        self._note(now, told)

    def _note(self, now: float, s: Status) -> None:
        """The words of a status to the recorder, where they are new."""
        told = Told(*self._driven_by, s.mode, s.stopped, s.why, s.speed_cap, s.cap_reason, s.alarms)
        if told != self._kept:
            self._kept = told
            self._record(Shown(now, told))

    def _keep_time(self, now: float) -> None:
        """When the next period is due. Missed ones are counted, never made up for in a burst."""
        end, period = self.keeper.now(), self.ways.period
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

    def _e_p(self) -> float:
        d, seen = self.decision, self.seen
        if d is None or seen is None:
            return math.nan
        dx, dy = d.x_d - seen.pose.x, d.y_d - seen.pose.y
        return math.sqrt(dx * dx + dy * dy + wrap(d.psi_d - seen.pose.psi) ** 2)

    def _progress(self) -> float:
        pilot = self.driver.pilot
        if pilot is None:
            return math.nan
        return pilot.state.row / max(len(pilot.planner.route.line) - 1, 1)

    def _event(self, text: str, serious: bool = False) -> None:
        self._record(Event(self.keeper.now(), "loop", text, serious))
