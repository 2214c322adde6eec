"""A robot behind its gate and monitors: every command to the wheels passes here."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from typing import Any

from cohelm.core.types import Pose, Twist
from cohelm.robot.gate import gate as gates
from cohelm.robot.gate.bounds import Bounds
from cohelm.robot.gate.gate import Gate, GateRules, Passed, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.record_pipe import Event, RecordLine
from cohelm.robot.keep.watch import monitors
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import UNRESTRICTED, Monitor, Restriction, strictest
from cohelm.robot.port import DrawnCamera, Health, Odometry, Readings, RobotPort, Traced

QUIET = 1.0
"""A refusal or limit is logged again once it has been absent for this long [s]."""
STANDS_V, STANDS_OMEGA = 0.02, 0.03
"""A robot with less measured speed than this stands [m/s, rad/s]."""
_FADES = 0.8  # of how long a call took, from one period to the next
_FARTHEST, _FASTEST = 1e6, 1e3
"""Bounds of plausible odometry: pose [m, rad] and twist [m/s, rad/s]."""
_NO_NUMBER = Odometry(math.nan, Pose(*3 * [math.nan]), Twist(math.nan, math.nan))


def _ignore(_: Event | str) -> None:
    """Nobody listens."""


def rules(model: RobotModel, period: float, watchdog: float = 0.1) -> GateRules:
    """The gate's rules for a robot, and for a loop with this period [s]."""
    limits = model.bounds()
    # odometry counts until the next is overdue by half: of a slow one nothing would ever pass
    seldom = 1.5 / model.odometry.rate_hz + period
    return GateRules(
        Bounds(*limits), age=max(0.1, 3.0 * period, watchdog, seldom),
        watchdog=max(watchdog, 2.0 * period), period=period, jitter=0.5 * period,
    )  # fmt: skip


class LocalGatedRobot:
    """A robot and its gate in this process. In simulated time its watchdog is as good as that of a
    separate process; in real time it can not outlive this process.

    Of a camera that is drawn there is no picture before `draw_at`."""

    def __init__(
        self, robot: RobotPort, rules: GateRules, recorder: Callable[[Event], None] | None = None,
        watched_by: tuple[Monitor, ...] | None = None,
        viewer: Callable[[Event], None] | None = None, calling: Callable[[str], None] = _ignore,
    ) -> None:  # fmt: skip
        """recorder, viewer: receive the gate's events. watched_by: by default `watch.monitors`.
        calling: told which call of the robot's driver begins, and with "" that it has ended."""
        self._robot, self._rules, self._calling = robot, rules, calling
        self._traced = robot if isinstance(robot, Traced) else None
        self._monitors = monitors(robot.model, rules) if watched_by is None else watched_by
        self._unsound = ""
        """Why there is no reset, by the robot's newest readings; empty: it reports no fault."""
        self._restriction = UNRESTRICTED
        """The monitors' restriction by the newest readings, for any proposal."""
        self.monitor_share = 1.0
        """Share of the last proposal that the monitors passed."""
        self._recorder, self._viewer = recorder or _ignore, viewer or _ignore
        self._line: RecordLine | None = None
        self._gate = Gate()
        self._latched_at = math.nan
        self._took = {"read": 0.0, "send": 0.0}
        """How long these calls of the robot's driver took of late [s]."""
        self._last_logged: dict[str, float] = {}
        """When each reason for changing a proposal last applied [s]."""
        self.draw_at(0.0)

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
        """Let time pass; the watchdog trips meanwhile if it is due."""
        deadline = gates.due(self._gate, self._rules)
        if deadline < until:
            self._robot.wait(deadline + 1e-6)
            self.tick()
        self._robot.wait(until)

    def read(self) -> Readings:
        """The newest of everything; a fault that the robot reports is latched."""
        begun = self._robot.now()
        readings = _bounded_odometry(self._called("read"))
        self._unsound = still(readings.health)
        if readings.health is not None and readings.health.faults:
            self.fault(f"the robot reports: {readings.health.faults[0]}")
        self._check_wait("read", begun)
        self._log_traceback()
        if self._monitors:
            now, applied = self._robot.now(), self._gate.applied
            stopped = latched(self._gate.mode)
            self._restriction = self._strictest(
                [monitor.observe(now, readings, applied, stopped) for monitor in self._monitors]
            )
        self._log_standstill(readings)
        return readings

    def draw_at(self, rate: float) -> None:
        """As in `DrawnCamera`, if the robot's camera is one; any other's pictures always come."""
        if isinstance(self._robot, DrawnCamera):
            self._robot.draw_at(rate)

    def propose(self, proposal: Proposal) -> Passed:
        """Apply the monitors' restrictions and the gate, then send."""
        now, twist = self._robot.now(), proposal.twist
        each = [self._restriction, *(one.restrict(now, twist) for one in self._monitors)]
        restriction, slowest = self._strictest(each), min(each, key=lambda one: one.limit)
        share = self.monitor_share = restriction.share
        if share < 1.0:
            proposal = proposal._replace(twist=Twist(share * twist.v, share * twist.omega))
        self._rules = self._rules._replace(slow=self._slow())
        gate, passed = gates.propose(self._gate, proposal, now, self._rules)
        if share < 1.0 and driving(gate.mode):
            passed = passed._replace(reason=restriction.reason)
        passed = passed._replace(limit=slowest.limit, limit_reason=slowest.limit_reason)
        return self._send(gate, passed)

    def tick(self) -> Passed:
        """Nothing was proposed: check the watchdog."""
        gate, passed = gates.tick(self._gate, self._robot.now(), self._rules)
        return self._send(gate, passed)

    def stop(self, reason: str) -> None:
        """Latched, and at once."""
        self._apply(gates.stop(self._gate, reason))

    def fault(self, reason: str) -> None:
        """Latched, and at once."""
        self._apply(gates.fault(self._gate, reason))

    def reset(self) -> str:
        """Clear a stop or fault, into IDLE; not while the robot reports a fault, which would latch
        again at once."""
        if self._unsound and latched(self._gate.mode):
            return self._unsound
        gate, refusal = gates.reset(self._gate, self._robot.now(), self._rules)
        self._apply(gate)
        return refusal

    def drive(self, mode: GateMode) -> str:
        """Set the gate's mode."""
        now = self._robot.now()
        gate, refusal = gates.drive(self._gate, mode, now, self._rules)
        self._apply(gate)
        return refusal

    def truth(self) -> Any:
        """Ground truth of a simulated robot; None for any other."""
        return getattr(self._robot, "truth", lambda: None)()

    def record_into(self, end: socket.socket | None) -> None:
        """Switch to another recorder; the gate's present state is logged first."""
        before, self._line = self._line, RecordLine(end)
        self._recorder = self._line
        self.log(f"{self._gate.mode.name} {self._gate.reason}".strip())
        if before is not None:
            before.close()

    def log(self, text: str, serious: bool = False) -> None:
        """Log an event to the recorder and the viewer."""
        self._publish(Event(self._robot.now(), "gate", text, serious))

    def _publish(self, event: Event) -> None:
        self._recorder(event)
        self._viewer(event)

    def close(self) -> None:
        """Stop and close the robot."""
        self._called("stop")
        self._robot.close()
        self._log_traceback()

    def _log_traceback(self) -> None:
        """Log where the robot's own code failed."""
        if self._traced is not None and (text := self._traced.traceback()):
            seen = self._gate.clock  # the robot's own may fail, too
            self._publish(Event(seen if math.isfinite(seen) else 0.0, "gate", text, True))

    def _strictest(self, restrictions: list[Restriction]) -> Restriction:
        """The strictest restriction; a fault is latched at once."""
        worst = strictest(restrictions)
        if worst.fault:
            self.fault(worst.reason)
        return worst

    def _apply(self, gate: Gate) -> None:
        if latched(gate.mode):  # before it is said, which may fail
            self._called("stop")
        self._set_gate(gate)

    def _send(self, gate: Gate, passed: Passed) -> Passed:
        refused = gate.refused > self._gate.refused
        self._apply(gate)
        if latched(gate.mode):
            return passed
        begun = self._robot.now()
        tried = self._called("send", passed.applied)
        self._check_wait("send", begun)
        if tried != passed.applied:
            why = passed.reason or "the robot does not do more"
            passed = passed._replace(applied=tried, reason=why)
        if passed.reason and driving(gate.mode):
            self._log_once(f"{'refused' if refused else 'limited'}: {passed.reason}")
        return passed

    def _called(self, call: str, *with_: Any) -> Any:
        """What a call of the robot's driver returns."""
        self._calling(call)
        try:
            return getattr(self._robot, call)(*with_)
        finally:
            self._calling("")

    def _check_wait(self, call: str, begun: float) -> None:
        """Say of a call of the robot that used up the watchdog's time that it did: the watchdog
        would know only that no command came. begun: when it was called [s]."""
        took = self._robot.now() - begun
        self._took[call] = max(took, _FADES * self._took[call])
        if driving(self._gate.mode) and took > self._rules.watchdog:
            why = f"{call} of the robot's driver took {took:.2f} s"
            self.fault(f"{gates.silence(self._rules)}: {why}")

    def _slow(self) -> str:
        """What makes the loop late, if it is."""
        call, took = max(self._took.items(), key=lambda one: one[1])
        if took < 0.5 * self._rules.period:
            return "this computer is too slow"
        return f"{call} of the robot's driver takes {1000.0 * took:.0f} ms"

    def _log_once(self, reason: str) -> None:
        """Log why a proposal was changed, once until the reason has been absent for `QUIET`."""
        now = self._robot.now()
        if not now - self._last_logged.get(reason, -math.inf) < QUIET:
            self.log(reason)
        self._last_logged[reason] = now

    def _set_gate(self, gate: Gate) -> None:
        before, self._gate = self._gate, gate
        if gate.mode != before.mode:
            now = self._robot.now()
            serious = latched(gate.mode)
            change = f"{before.mode.name} -> {gate.mode.name}"
            self.log(f"{change}: {gate.reason}" if serious else change, serious)
            self._latched_at = now if serious else math.nan

    def _log_standstill(self, readings: Readings) -> None:
        """After a latched stop, log once when the robot has come to a standstill."""
        odometry = readings.odometry
        if odometry is None or not odometry.stamp > self._latched_at:
            return
        if standing(odometry.twist):
            after = odometry.stamp - self._latched_at
            self._publish(Event(odometry.stamp, "gate", f"stands, {after:.2f} s after"))
            self._latched_at = math.nan


def still(health: Health | None) -> str:
    """Why there is no reset: what a robot reported stays. Empty: it reports no fault."""
    if health is None or not health.faults:
        return ""
    if health.failed is not None:
        return f"{health.failed.call} still fails: {health.failed.why}"
    return f"the robot reports: {health.faults[0]}"


def standing(twist: Twist) -> bool:
    """Whether a measured twist is that of a standing robot."""
    return abs(twist.v) < STANDS_V and abs(twist.omega) < STANDS_OMEGA


def _bounded_odometry(readings: Readings) -> Readings:
    """Odometry beyond the plausible bounds becomes NaN: its squares would overflow."""
    odometry = readings.odometry
    if odometry is None or (
        all(abs(x) <= _FARTHEST for x in odometry.pose)
        and all(abs(x) <= _FASTEST for x in odometry.twist)
    ):
        return readings
    return readings._replace(odometry=_NO_NUMBER._replace(stamp=odometry.stamp))
