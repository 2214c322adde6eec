"""Decides the mode and who drives, by requests, stick, lease, docking and the gate's state."""

from __future__ import annotations

import math

from cohelm.core.types import CENTRED
from cohelm.link.messages import Arming, Mode, Request, RequestKind
from cohelm.link.operator import ClientRequest, Operator, OperatorInput, stops_first
from cohelm.link.rate import Coalesced
from cohelm.link.recorded_status import StatusWords
from cohelm.loop.alarms import ActiveAlarms
from cohelm.loop.authorization import Authorization
from cohelm.loop.docking import Docking, Ended
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.speed_caps import Cap
from cohelm.loop.stick import (
    WAITING,
    ArmingParams,
    Dropout,
    DropoutAction,
    Loss,
    StickState,
    stepped,
    updated,
)
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.step import Decision
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.process import GatedRobot

_GATE = {
    Mode.HOLD: GateMode.IDLE, Mode.AUTOMATIC: GateMode.AUTOMATIC,
    Mode.SHARED: GateMode.SHARED, Mode.MANUAL: GateMode.SHARED,
}  # fmt: skip
PLANNED = (Mode.AUTOMATIC, Mode.SHARED)
"""Modes that follow a route where there is one, and so need plans."""
NO_ROUTE = (
    "there is no route: draw one with Edit route on the page, or name a site that has one with "
    "--scenario"
)
_CHECKING = "the route is being checked on the map"
_MODES = frozenset(int(mode) for mode in Mode)
_LOCAL = -1
"""The client number of local requests; clients of the link have numbers from 1."""
_MAX_REQUESTS = 8
"""Executed for one client in one period, as many as one command carries; stops always."""


class Supervisor:
    """The supervisor of one loop. It follows what the gate latches by itself."""

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
        self._by_stick = False  # whether the mode of the last period steered by it
        self.rights = Authorization()
        self.problem = ""
        """What is wrong with this period's readings; empty: nothing..."""
        self.unsound = ""
        """... why there is no reset by the fault that they report; empty: they report none..."""
        self.seen: Seen | None = None
        """... and what perception makes of them."""
        self.awaits_route = False
        """Whether it may wait in automatic mode for its first route."""
        self.checking_route = False
        """Whether its first route is still being checked on the map..."""
        self.unreachable = ""
        """... and why the goal of its route can not be reached; empty: nothing of that is known."""
        self._operator_chose = False  # the mode, so commands must keep coming
        self._pauses: dict[str, str] = {}
        self._dropout = Dropout()
        self._lines = Coalesced()  # of requests: a flood does not fill the log
        self._latched = (GateMode.IDLE, "")

    def take_input(self, now: float) -> None:
        """Take the operator's command and requests; update lease, stick and dropout."""
        received = self.operator.receive()
        self._follow_lease(received)
        self._answer_requests(received)
        mode = self.gated.gate.mode
        before, self._by_stick = self._by_stick, mode == GateMode.SHARED
        anew = not driving(mode) or (self._by_stick and not before)
        self.stick_state = updated(self.stick_state, received, self._arming, self._period, anew)
        self._watch_operator(now)

    @property
    def lease(self) -> tuple[int, int]:
        """The driver's client number, 0: none; and the count of leases."""
        received = self.stick_state.received
        return received.driver, received.term

    def request_locally(self, name: str, what: RequestKind, age: float, value: int = 0) -> str:
        """A request made at the robot where no station drives, by the same rules; returns why not,
        or "". age: how long ago it was made [s]."""
        request = ClientRequest(_LOCAL, name, Request(1, what, value, 0.0), age)
        return self._request(request, _LOCAL)[1]

    def choose(self, mode: Mode, who: int = 0) -> str:
        """Set the mode; returns why not, or "". A person's request is checked in `_mode`. who: the
        client that chooses; 0: the robot, or the one who started it."""
        if mode != Mode.HOLD and self.problem:
            return self.problem
        if mode == Mode.AUTOMATIC and self.driver.pilot is None and not self.awaits_route:
            return NO_ROUTE
        if mode == Mode.AUTOMATIC and self.unreachable:
            return self.unreachable
        refusal = self.gated.drive(_GATE[mode])
        if not refusal:
            self._end_docking(Ended(f"mode {mode.name}"))
            self.mode = mode
            self._forget_dropout()
            self._log.event(f"mode {mode.name}")
            if mode == Mode.HOLD:
                self.rights.revoke(who, self.gated.now())
        return refusal

    def dock(self, number: int = 0, backwards: bool = False) -> str:
        """Start docking, or backwards: undocking; returns why not, or "". A person's
        request is checked in `_dock`. number: of the dock, from 1; 0: the one it is at."""
        if self.problem or self.seen is None:
            return self.problem or "no sensor readings yet"
        if self._pauses:
            return f"paused: {self.paused}"
        refusal = self.docking.refusal(number, self.seen, self.stick_state.deflection, backwards)
        refusal = refusal or self.gated.drive(GateMode.AUTOMATIC)
        if not refusal:
            self._end_docking(Ended("replaced by another request"))
            self.mode = Mode.AUTOMATIC
            self._forget_dropout()
            self.docking.begin(self.gated.now(), number, self.seen, backwards)
            self._log.event(self.docking.activity)
        return refusal

    def _end_docking(self, ended: Ended) -> None:
        """End docking or undocking, if one is active."""
        if self.docking.on:
            self._log.event(f"{self.docking.activity} ended: {ended.why}")
            self.docking.finish(ended)

    def watch_docking(self, now: float, seen: Seen, held: str) -> None:
        """End docking in hold when it is over. held: why the guard holds the robot back for
        nothing visible; empty: it does not."""
        docking = self.docking
        if not docking.on:
            return
        applied = self.gated.gate.applied
        paused = bool(self._pauses)
        ended = docking.ended(now, seen, applied, self.stick_state.stick, paused, held)
        if ended is None:
            return
        if not ended.arrived:
            self.alarms.over_already("dock", f"{docking.activity}: {ended.why}")
        self._end_docking(ended)
        self.choose(Mode.HOLD)

    def pause(self, name: str, why: str) -> None:
        """Brake and stand in the present mode until `resume(name)`. No mode is stored, so what ends
        the mode meanwhile (hold, stop, fault, another choice) is never undone."""
        if name not in self._pauses:
            self._log.event(f"stands: {why}")
        self._pauses[name] = why

    def resume(self, name: str) -> None:
        """End that pause; while there is another one, the robot still stands."""
        if self._pauses.pop(name, ""):
            self._log.event(f"continues: {name}")

    @property
    def paused(self) -> str:
        """Why it is paused in a driving mode; empty: it is not."""
        return next(iter(self._pauses.values()), "")

    @property
    def unfollowed(self) -> str:
        """Why the route is not followed; empty: it is, or there is none."""
        return self.unreachable or (_CHECKING if self.checking_route else "")

    def status_words(self, refusal: str, cap: Cap) -> StatusWords:
        """The texts of a status. refusal: why the gate changed the command."""
        why, stopped = refusal or self.paused, self.gated.gate.reason
        if self.mode in PLANNED and not self.docking.on:
            why = why or self.unfollowed
        driver = self.stick_state.received
        return StatusWords(
            driver.driver, driver.name, self.mode, stopped, why, *cap, self.alarms.worst()
        )

    @property
    def may_drive(self) -> bool:
        """Whether it may drive now."""
        return driving(self.gated.gate.mode) and not self.problem and not self._pauses

    def decide(self, now: float, seen: Seen) -> Decision:
        """The driver's decision in the present mode."""
        driver, docking = self.driver, self.docking
        if docking.on:
            return driver.follow_course(docking.pilot, now, seen, docking.backwards)
        by_stick = self.gated.gate.mode == GateMode.SHARED
        stick = self.stick_state.stick if by_stick else CENTRED
        if self.mode == Mode.MANUAL:
            return driver.by_hand(now, seen, stick, gently=False)
        if seen.lost or driver.pilot is None or self.unfollowed:
            return driver.by_hand(now, seen, stick, gently=True)
        return driver.follow(now, seen, stick)

    def _watch_operator(self, now: float) -> None:
        """Detect a lost stick or driver; pause, resume, stop or carry on alone."""
        if not driving(self.gated.gate.mode):
            self._forget_dropout()
        stick = self.stick_state.lost if self.gated.gate.mode == GateMode.SHARED else ""
        quiet = self.stick_state.driver_lost if self._operator_chose else ""
        if self.stick_state.arming == Arming.ARMED:
            self.alarms.off("stick")
        if not quiet:
            self.alarms.off("driver")
        if not driving(self.gated.gate.mode):
            return
        lost = Loss("stick", stick) if stick else Loss("driver", quiet) if quiet else None
        if lost and self._carry_on and (not stick or self.mode == Mode.SHARED):
            if self.alarms.on(lost.what, lost.text) or stick:
                self._log.event(f"{lost.why}: the controller continues alone", True)
            lost = None
        before = self._dropout
        self._dropout, action = stepped(before, lost, self.stick_state, now)
        lost = before.lost or lost
        if action == DropoutAction.STOP:
            assert lost is not None  # or there would be nothing to stop for
            self.alarms.on(lost.what, lost.text)
            self.gated.stop(lost.text)
            self._pauses.pop("stick", "")  # it does not resume
        elif action == DropoutAction.GO_ON:
            self.resume("stick")
        elif self._dropout.lost:
            waiting = math.isfinite(self._dropout.back)
            self.pause("stick", WAITING if waiting else self._dropout.lost.text)

    def _forget_dropout(self) -> None:
        """A mode was ended or chosen: an earlier dropout no longer counts."""
        self._dropout = self._dropout.cleared
        self.resume("stick")

    def _follow_lease(self, received: OperatorInput) -> None:
        """A mode ends with the lease in which it was chosen."""
        operators = self._operator_chose and driving(self.gated.gate.mode)
        if self.stick_state.received.term == received.term or not operators:
            return
        if received.driver == 0 and not self._carry_on:
            return  # the driver is lost: more than a hold
        self._log.event("the driver who chose the mode has changed: hold")
        self.choose(Mode.HOLD)

    def _answer_requests(self, received: OperatorInput) -> None:
        """Execute or refuse each request, and answer it."""
        done: dict[int, int] = {}
        for line in self._lines.due(self.gated.now()):
            self._log.event(line)
        requests = stops_first(received.requests)
        if requests and requests[0].request.what == RequestKind.STOP:
            self._stop(requests[0].name)  # once a period, however many there are
        for requested in requests:
            count = done[requested.client] = done.get(requested.client, 0) + 1
            if count > _MAX_REQUESTS and requested.request.what != RequestKind.STOP:
                granted, reason = False, "too many requests: wait a moment and try again"
            else:
                granted, reason = self._request(requested, received.driver)
            self.operator.answer(requested.client, requested.request.number, granted, reason)

    def _request(self, requested: ClientRequest, driver: int) -> tuple[bool, str]:
        what, value = requested.request.what, requested.request.value
        refusal = "the loop does not do that"
        if what == RequestKind.STOP:
            self.rights.revoke(requested.client, self.gated.now())
            self.rights.record_hold(requested)
            refusal = ""
        elif what == RequestKind.RESET:
            refusal = self._refusal(requested, driver) or self._broken() or self.gated.reset()
            if not refusal:
                self._latched = (GateMode.IDLE, "")  # a stop that follows is another one
        elif what == RequestKind.ACKNOWLEDGE:
            refusal = "" if self.alarms.acknowledge(value) else "there is no such alarm"
        elif what == RequestKind.MODE:
            refusal = self._mode(requested, driver) if value in _MODES else "there is no such mode"
        elif what == RequestKind.RECORD:
            own = requested.client == driver
            refusal = self.operator.record(value != 0) if own else "you are not the driver"
        elif what in (RequestKind.DOCK, RequestKind.UNDOCK):
            refusal = self._dock(requested, driver)
        text = f"{requested.name} requests {what.name} {value}: {refusal or 'done'}"
        for line in self._lines.add(self.gated.now(), text, text):
            self._log.event(line)
        return not refusal, refusal

    def _broken(self) -> str:
        """What is wrong with the robot: what it reports is the cause of readings that are old."""
        return self.unsound or self.problem

    def _stop(self, name: str) -> None:
        before = self.gated.gate
        self.gated.stop(f"stop by {name}")
        gate = self.gated.gate
        if not latched(before.mode) and gate.mode == GateMode.STOPPED:
            self._latched = (gate.mode, gate.reason)  # by a person, not by the robot

    def _mode(self, requested: ClientRequest, driver: int) -> str:
        mode = Mode(requested.request.value)
        hold = mode == Mode.HOLD
        refusal = self._refusal(requested, driver, hold) or self.choose(mode, requested.client)
        if not refusal:
            self._operator_chose = not hold and requested.client != _LOCAL
            if hold:
                self.rights.record_hold(requested)
        return refusal

    def _dock(self, requested: ClientRequest, driver: int) -> str:
        backwards = requested.request.what == RequestKind.UNDOCK
        refusal = self._refusal(requested, driver) or self.dock(requested.request.value, backwards)
        if not refusal:
            self._operator_chose = True
        return refusal

    def _refusal(self, requested: ClientRequest, driver: int, hold: bool = False) -> str:
        return self.rights.refusal(requested, driver, self.gated.now(), hold)

    def follow_gate(self) -> None:
        """A stop or fault that the gate latched ends the mode, before any request is executed."""
        gate = self.gated.gate
        state = (gate.mode, gate.reason) if latched(gate.mode) else (GateMode.IDLE, "")
        if state != self._latched:
            self._latched = state
            if latched(gate.mode):
                self.rights.revoke(0, self.gated.now())
        if not driving(gate.mode) and self.mode != Mode.HOLD:
            self._end_docking(Ended(gate.reason))
            self.mode = Mode.HOLD
