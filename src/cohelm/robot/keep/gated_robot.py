"""A robot behind its gate: nothing reaches the wheels but through here."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from typing import Any, Protocol

from cohelm.core.types import Pose, Twist
from cohelm.robot.gate import gate as gates
from cohelm.robot.gate.bounds import Bounds
from cohelm.robot.gate.gate import Gate, GateRules, Passed, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.record_pipe import Event, RecordLine
from cohelm.robot.keep.watch import monitors
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import UNRESTRICTED, Monitor, Restriction, strictest
from cohelm.robot.port import Odometry, Readings, RobotPort

QUIET = 1.0
"""A refusal or limit is told again when it has been away for so long [s]."""
STANDS_V, STANDS_OMEGA = 0.02, 0.03
"""A robot whose odometry says less than this stands [m/s, rad/s]."""
_FARTHEST, _FASTEST = 1e6, 1e3
"""No wheels measure a pose farther from where they began [m, rad], nor more speed [m/s, rad/s]."""
_NO_NUMBER = Odometry(math.nan, Pose(*3 * [math.nan]), Twist(math.nan, math.nan))


class GatedRobot(Protocol):
    """What the loop is given instead of a robot. One thread; only `wait` takes time."""

    @property
    def model(self) -> RobotModel:
        """Of the robot."""
        ...

    @property
    def gate(self) -> Gate:
        """As of the last call."""
        ...

    def now(self) -> float:
        """The robot's clock [s]."""
        ...

    def wait(self, until: float) -> None:
        """Let time pass."""
        ...

    def read(self) -> Readings:
        """The newest of everything."""
        ...

    def propose(self, proposal: Proposal) -> Passed:
        """Ask for a twist; what the robot will really try, and why it differs."""
        ...

    def stop(self, reason: str) -> None:
        """Latched."""
        ...

    def fault(self, reason: str) -> None:
        """Latched."""
        ...

    def reset(self) -> str:
        """Let go of a stop or fault; why not, or nothing."""
        ...

    def drive(self, mode: GateMode) -> str:
        """Choose who drives; why not, or nothing."""
        ...

    def record_into(self, end: socket.socket | None) -> None:
        """Tell another recorder from now on what the gate does, or none. The end is the
        gate process's, which closes it when the next one comes."""
        ...

    def close(self) -> None:
        """Stop the robot and let it go."""
        ...


def rules(model: RobotModel, period: float, watchdog: float = 0.1) -> GateRules:
    """The gate's rules for a robot, and for a loop with this period [s]."""
    limits = model.bounds()
    return GateRules(
        Bounds(*limits), age=max(0.1, 3.0 * period, watchdog), watchdog=max(watchdog, 2.0 * period),
        period=period, jitter=0.5 * period,
    )  # fmt: skip


class LocalGatedRobot:
    """A robot and its gate in this process. In simulated time its watchdog is as good as one in
    a process of its own; in real time it can not outlive this process."""

    def __init__(
        self, robot: RobotPort, rules: GateRules, told: Callable[[Event], None] | None = None,
        watched_by: tuple[Monitor, ...] | None = None, shown: Callable[[Event], None] | None = None,
    ) -> None:  # fmt: skip
        """watched_by: by default `watch.monitors`, all there are. shown: told what happens as the
        recorder is, whichever that is."""
        self._robot, self._rules = robot, rules
        self._monitors = monitors(robot.model, rules) if watched_by is None else watched_by
        self._fault = ""
        """Of the robot, by its newest readings."""
        self._restriction = UNRESTRICTED
        """Of the newest readings, whatever is proposed."""
        self.let_through = 1.0
        """Share of the last proposal that the monitors let through."""
        self._told, self._shown = told or _nobody, shown or _nobody
        self._line: RecordLine | None = None
        self._gate = Gate()
        self._latched_at = math.nan
        self._why: dict[str, float] = {}
        """When each reason to change what was proposed was last there [s]."""

    @property
    def model(self) -> RobotModel:
        """Of the robot."""
        return self._robot.model

    @property
    def gate(self) -> Gate:
        """As of now."""
        return self._gate

    def now(self) -> float:
        """The robot's clock."""
        return self._robot.now()

    def wait(self, until: float) -> None:
        """Let time pass; the watchdog barks meanwhile."""
        bark = gates.due(self._gate, self._rules)
        if bark < until:
            self._robot.wait(bark + 1e-6)
            self.tick()
        self._robot.wait(until)

    def read(self) -> Readings:
        """The newest of everything; a robot that has a fault does not drive."""
        readings = _sane(self._robot.read())
        faults = () if readings.health is None else readings.health.faults
        self._fault = f"the robot says: {faults[0]}" if faults else ""
        if self._fault:
            self.fault(self._fault)
        if self._monitors:
            now, applied = self._robot.now(), self._gate.out
            stopped = latched(self._gate.mode)
            self._restriction = self._heeded(
                [monitor.observe(now, readings, applied, stopped) for monitor in self._monitors]
            )
        self._stands(readings)
        return readings

    def propose(self, proposal: Proposal) -> Passed:
        """Past the monitors and through the gate to the wheels."""
        now, twist = self._robot.now(), proposal.twist
        restriction = self._heeded(
            [self._restriction, *(monitor.restrict(now, twist) for monitor in self._monitors)]
        )
        share = self.let_through = restriction.share
        if share < 1.0:
            proposal = proposal._replace(twist=Twist(share * twist.v, share * twist.omega))
        gate, passed = gates.propose(self._gate, proposal, now, self._rules)
        if share < 1.0 and driving(gate.mode):
            passed = passed._replace(reason=restriction.reason)
        return self._out(gate, passed)

    def tick(self) -> Passed:
        """Nothing was proposed: the watchdog looks."""
        gate, passed = gates.tick(self._gate, self._robot.now(), self._rules)
        return self._out(gate, passed)

    def stop(self, reason: str) -> None:
        """Latched, and at once."""
        self._now(gates.stop(self._gate, reason))

    def fault(self, reason: str) -> None:
        """Latched, and at once."""
        self._now(gates.fault(self._gate, reason))

    def reset(self) -> str:
        """Let go, into IDLE; not while the robot has a fault, which would latch again at once."""
        if self._fault and latched(self._gate.mode):
            return self._fault
        gate, said = gates.reset(self._gate, self._robot.now(), self._rules)
        self._now(gate)
        return said

    def drive(self, mode: GateMode) -> str:
        """Choose who drives."""
        gate, said = gates.drive(self._gate, mode, self._robot.now(), self._rules)
        self._now(gate)
        return said

    def truth(self) -> Any:
        """What only a simulated robot knows; None of any other."""
        return getattr(self._robot, "truth", lambda: None)()

    def record_into(self, end: socket.socket | None) -> None:
        """Another recorder, which is told first how things stand."""
        before, self._line = self._line, RecordLine(end)
        self._told = self._line
        self.say(f"{self._gate.mode.name} {self._gate.reason}".strip())
        if before is not None:
            before.close()

    def say(self, text: str, serious: bool = False) -> None:
        """To the recorder, and who looks on."""
        self._tell(Event(self._robot.now(), "gate", text, serious))

    def _tell(self, event: Event) -> None:
        self._told(event)
        self._shown(event)

    def close(self) -> None:
        """Stop the robot and let it go."""
        self._robot.stop()
        self._robot.close()

    def _heeded(self, restrictions: list[Restriction]) -> Restriction:
        """The strictest; a fault is latched at once."""
        worst = strictest(restrictions)
        if worst.fault:
            self.fault(worst.reason)
        return worst

    def _now(self, gate: Gate) -> None:
        self._changed(gate)
        if latched(gate.mode):
            self._robot.stop()

    def _out(self, gate: Gate, passed: Passed) -> Passed:
        refused = gate.refused > self._gate.refused
        self._changed(gate)
        if latched(gate.mode):
            self._robot.stop()
            return passed
        tried = self._robot.send(passed.out)
        if tried != passed.out:
            passed = Passed(tried, passed.reason or "the robot does not do more")
        if passed.reason and driving(gate.mode):
            self._note(f"{'refused' if refused else 'limited'}: {passed.reason}")
        return passed

    def _note(self, said: str) -> None:
        """Tell why a proposal did not pass as it was: once, until that was away for a while."""
        now = self._robot.now()
        if not now - self._why.get(said, -math.inf) < QUIET:
            self.say(said)
        self._why[said] = now

    def _changed(self, gate: Gate) -> None:
        before, self._gate = self._gate, gate
        if gate.mode != before.mode:
            now = self._robot.now()
            serious = latched(gate.mode)
            said = f"{before.mode.name} -> {gate.mode.name}"
            self.say(f"{said}: {gate.reason}" if serious else said, serious)
            self._latched_at = now if serious else math.nan

    def _stands(self, readings: Readings) -> None:
        """After a latched stop: say once when the robot has come to stand."""
        odometry = readings.odometry
        if odometry is None or not odometry.stamp > self._latched_at:
            return
        v, omega = odometry.twist
        if abs(v) < STANDS_V and abs(omega) < STANDS_OMEGA:
            after = odometry.stamp - self._latched_at
            self._tell(Event(odometry.stamp, "gate", f"stands, {after:.2f} s after"))
            self._latched_at = math.nan


def _nobody(_: Event) -> None:
    """Nobody listens."""


def standing(twist: Twist) -> bool:
    """Whether a measured twist is that of a robot that stands."""
    return abs(twist.v) < STANDS_V and abs(twist.omega) < STANDS_OMEGA


def _sane(readings: Readings) -> Readings:
    """Odometry that no wheels can have measured is no number, to all who read it: its squares
    would be none."""
    odometry = readings.odometry
    if odometry is None or (
        all(abs(x) <= _FARTHEST for x in odometry.pose)
        and all(abs(x) <= _FASTEST for x in odometry.twist)
    ):
        return readings
    return readings._replace(odometry=_NO_NUMBER._replace(stamp=odometry.stamp))
