"""Says who drives and in which mode: by requests, stick, lease, docking and what the gate did."""

from __future__ import annotations

import math

from cohelm.link.latency_speed_limit import Cap
from cohelm.link.messages import Arming, Ask, Mode, Request, Severity
from cohelm.link.operator_input import ClientRequest, OperatorInput, stops_first
from cohelm.link.rate import Coalesced
from cohelm.link.recorded_status import StatusWords
from cohelm.loop.alarms import ActiveAlarms
from cohelm.loop.authorization import Authorization
from cohelm.loop.docking import Docking, Ended
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.dropout import WAITING, Dropout, Then, followed
from cohelm.loop.latency_limit import allowed, far, silent
from cohelm.loop.operator import Operator
from cohelm.loop.stick_arming import ArmingParams, StickState, updated
from cohelm.perceive.pipeline import Seen
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.gated_robot import GatedRobot

_GATE = {
    Mode.HOLD: GateMode.IDLE, Mode.AUTOMATIC: GateMode.AUTOMATIC,
    Mode.SHARED: GateMode.SHARED, Mode.MANUAL: GateMode.SHARED,
}  # fmt: skip
PLANNED = (Mode.AUTOMATIC, Mode.SHARED)
"""Modes that follow a route, and so need plans."""
_MODES = frozenset(int(mode) for mode in Mode)
_HERE = -1
"""Who asks where no station drives; clients of the link have numbers from 1."""
_MOST_REQUESTS = 8
"""Done for one client in one period, as many as one command carries; a stop always."""


class Supervisor:
    """Of one loop. What it did not see to itself, a latched gate above all, it follows."""

    def __init__(
        self, gated: GatedRobot, driver: Driver, operator: Operator, docking: Docking,
        alarms: ActiveAlarms, log: DriveLog, arming: ArmingParams, period: float,
        carry_on: bool,
    ) -> None:  # fmt: skip
        """arming, period, carry_on: see `LoopParams`."""
        self.gated, self.driver, self.operator, self.docking = gated, driver, operator, docking
        self.alarms, self._log = alarms, log
        self._arming, self._period, self._carry_on = arming, period, carry_on
        self.mode = Mode.HOLD
        self.stick_state = StickState()
        self.lease = (0, 0)
        """Who drives, 0: nobody; and a count of the leases."""
        self.driven_by = (0, "")
        """The client, 0: nobody; and its name."""
        self.rights = Authorization()
        self.allowed_share = 1.0
        """Of the robot's speed, by the driver."""
        self.delay = math.nan
        """Of the driver's stick [s]."""
        self.problem = ""
        """What is wrong with the readings; empty: nothing."""
        self.seen: Seen | None = None
        self._operator_chose = False  # the mode: so he must go on being heard
        self._pauses: dict[str, str] = {}
        self._dropout = Dropout()
        self._lines = Coalesced()  # of requests: a flood fills no record
        self._latched = (GateMode.IDLE, "")

    def sensed(self, problem: str, seen: Seen) -> None:
        """What is wrong with this period's readings, and what they say."""
        self.problem, self.seen = problem, seen

    def take_input(self, now: float) -> None:
        """What does the person want, and may the stick be believed?"""
        received = self.operator.receive()
        self.driven_by = (received.driver, received.name)
        self.allowed_share = allowed(received, self.allowed_share)
        self._heed_lease(received)
        self._answer_requests(received)
        stopped = latched(self.gated.gate.mode)
        self.stick_state = updated(self.stick_state, received, self._arming, self._period, stopped)
        self._watch_operator(now, received)
        self.delay = far(received, self.stick_state)

    def choose(self, mode: Mode) -> str:
        """Who drives from now on; why not, or nothing. Not for what a person asks for: `_mode`."""
        return self._choose(mode, 0)

    def asked_here(self, name: str, what: Ask, value: int = 0, age: float = 0.0) -> str:
        """Do what somebody asks for where no station drives, by the rules for one who does; why
        not, or nothing. age: how long ago it was asked [s]."""
        asked = ClientRequest(_HERE, name, Request(1, what, value, 0.0), age)
        return self._request(asked, _HERE)[1]

    def _choose(self, mode: Mode, who: int) -> str:
        """who: the client that chooses; 0: the robot, or who started it."""
        if mode != Mode.HOLD and self.problem:
            return self.problem
        if mode in PLANNED and self.driver.pilot is None:
            return "there is no route to follow"
        refusal = self.gated.drive(_GATE[mode])
        if not refusal:
            self._over(Ended(f"mode {mode.name}"))
            self.mode = mode
            self._forget_dropout()
            self._log.event(f"mode {mode.name}")
            if mode == Mode.HOLD:
                self.rights.end(who, self.gated.now())
        return refusal

    def dock(self, number: int = 0, backwards: bool = False) -> str:
        """Dock, or backwards: undock, from now on; why not, or nothing. Not for what a person asks
        for: `_dock`. number: of the dock, from 1; 0: the one it is at."""
        if self.problem or self.seen is None:
            return self.problem or "the robot has seen nothing yet"
        if self._pauses:
            return f"not while the robot waits: {self.paused}"
        refusal = self.docking.refusal(number, self.seen, self.stick_state.stick, backwards)
        refusal = refusal or self.gated.drive(GateMode.AUTOMATIC)
        if not refusal:
            self._over(Ended("another was asked for"))
            self.mode = Mode.AUTOMATIC
            self._forget_dropout()
            self.docking.begin(self.gated.now(), number, self.seen, backwards)
            self._log.event(self.docking.doing)
        return refusal

    def _over(self, ended: Ended) -> None:
        """Docking or undocking, if one of them went on."""
        if self.docking.on:
            self._log.event(f"{self.docking.doing} ended: {ended.why}")
            self.docking.over(ended)

    def watch_docking(self, now: float, seen: Seen, held: str) -> None:
        """Whatever ends it ends in hold. held: what the guard holds the robot back for that nothing
        shows."""
        docking = self.docking
        if not docking.on:
            return
        applied = self.gated.gate.out
        paused = bool(self._pauses)
        ended = docking.ended(now, seen, applied, self.stick_state.stick, paused, held)
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
            self._log.event(f"stands: {why}")
        self._pauses[name] = why

    def go_on(self, name: str) -> None:
        """What that pause was for is over; where there is another one, the robot still stands."""
        if self._pauses.pop(name, ""):
            self._log.event(f"goes on: {name}")

    @property
    def paused(self) -> str:
        """Why it stands in a driving mode; empty: it does not."""
        return next(iter(self._pauses.values()), "")

    def words(self, refusal: str, cap: Cap) -> StatusWords:
        """What there is to say beside the period's numbers. refusal: why the gate did not pass what
        it was given."""
        why, stopped = refusal or self.paused, self.gated.gate.reason
        return StatusWords(*self.driven_by, self.mode, stopped, why, *cap, self.alarms.worst())

    @property
    def free(self) -> bool:
        """Whether it may drive now."""
        return driving(self.gated.gate.mode) and not self.problem and not self._pauses

    def _watch_operator(self, now: float, received: OperatorInput) -> None:
        """Is the stick in use there, and the driver?"""
        if not driving(self.gated.gate.mode):
            self._forget_dropout()
        stick = self.stick_state.lost if self.gated.gate.mode == GateMode.SHARED else ""
        quiet = silent(received, self._arming.silence) if self._operator_chose else ""
        if self.stick_state.arming == Arming.ARMED:
            self.alarms.off("stick")
        if not quiet:
            self.alarms.off("driver")
        if not driving(self.gated.gate.mode):
            return
        name = "stick" if stick else "driver"
        why = stick or quiet
        if why and self._carry_on and (not stick or self.mode == Mode.SHARED):
            if self.alarms.on(name, f"the {name} is lost: {why}") or stick:
                self._log.event(f"{why}: the controller carries on alone", True)
            why = ""
        lost = f"the {name} is lost: {why}" if why else ""
        before = self._dropout
        self._dropout, then = followed(before, lost, received, self.stick_state, now)
        if then == Then.STOP:
            lost = before.why or lost
            self.alarms.on("driver" if lost.startswith("the driver") else "stick", lost)
            self.gated.stop(lost)
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
        theirs = self._operator_chose and driving(self.gated.gate.mode)
        if before[1] == received.term or not theirs:
            return
        if received.driver == 0 and not self._carry_on:
            return  # the driver is lost: more than a hold
        self._log.event("the one who chose the mode drives no more: hold")
        self.choose(Mode.HOLD)

    def _answer_requests(self, received: OperatorInput) -> None:
        """Do or refuse each, and answer."""
        done: dict[int, int] = {}
        for line in self._lines.due(self.gated.now()):
            self._log.event(line)
        requests = stops_first(received.requests)
        if requests and requests[0].request.what == Ask.STOP:
            self._stop(requests[0].name)  # once a period, however many say so
        for requested in requests:
            count = done[requested.client] = done.get(requested.client, 0) + 1
            if count > _MOST_REQUESTS and requested.request.what != Ask.STOP:
                granted, reason = False, "too many requests: wait a moment and ask again"
            else:
                granted, reason = self._request(requested, received.driver)
            self.operator.answer(requested.client, requested.request.number, granted, reason)

    def _request(self, requested: ClientRequest, driver: int) -> tuple[bool, str]:
        what, value = requested.request.what, requested.request.value
        refusal = "the loop does not do that"
        if what == Ask.STOP:
            self.rights.end(requested.client, self.gated.now())
            self.rights.stand(requested)
            refusal = ""
        elif what == Ask.RESET:
            refusal = self._refusal(requested, driver) or self.problem or self.gated.reset()
        elif what == Ask.ACKNOWLEDGE:
            refusal = "" if self.alarms.acknowledge(value) else "there is no such alarm"
        elif what == Ask.MODE:
            refusal = self._mode(requested, driver) if value in _MODES else "there is no such mode"
        elif what in (Ask.DOCK, Ask.UNDOCK):
            refusal = self._dock(requested, driver)
        text = f"{requested.name} asks for {what.name} {value}: {refusal or 'done'}"
        for line in self._lines.add(self.gated.now(), text, text):
            self._log.event(line)
        return not refusal, refusal

    def _stop(self, name: str) -> None:
        before = self.gated.gate
        self.gated.stop(f"stop by {name}")
        gate = self.gated.gate
        if not latched(before.mode) and gate.mode == GateMode.STOPPED:
            self._latched = (gate.mode, gate.reason)  # this person's, not the robot's

    def _mode(self, requested: ClientRequest, driver: int) -> str:
        mode = Mode(requested.request.value)
        hold = mode == Mode.HOLD
        refusal = self._refusal(requested, driver, hold) or self._choose(mode, requested.client)
        if not refusal:
            self._operator_chose = not hold and requested.client != _HERE
            if hold:
                self.rights.stand(requested)
        return refusal

    def _dock(self, requested: ClientRequest, driver: int) -> str:
        backwards = requested.request.what == Ask.UNDOCK
        refusal = self._refusal(requested, driver) or self.dock(requested.request.value, backwards)
        if not refusal:
            self._operator_chose = True
        return refusal

    def _refusal(self, requested: ClientRequest, driver: int, hold: bool = False) -> str:
        return self.rights.refusal(requested, driver, self.gated.now(), hold)

    def follow_gate(self) -> None:
        """What the gate latched by itself ends all modes; it is heeded before any request."""
        gate = self.gated.gate
        state = (gate.mode, gate.reason) if latched(gate.mode) else (GateMode.IDLE, "")
        if state != self._latched:
            self._latched = state
            if latched(gate.mode):
                self.rights.end(0, self.gated.now())
        if not driving(gate.mode) and self.mode != Mode.HOLD:
            self._over(Ended(gate.reason))
            self.mode = Mode.HOLD
