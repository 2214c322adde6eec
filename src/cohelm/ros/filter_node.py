"""The safety filter as a ROS 2 node: any controller's commands in, safe ones out to the base.

Two layers, in two processes. Here perception and `pilot.SafetyFilter` shape each command; in the
gate process, which alone holds the base, gate and monitors watch the raw scan and refuse. When
this process dies, that one brakes the base.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.verdict import Verdict
from cohelm.loop.sensor_watchdog import SensorWatchdog, timeouts
from cohelm.loop.speed_caps import UNSEEN, backed_slowly
from cohelm.perceive.pipeline import Perception, Seen, warm_up
from cohelm.pilot.reshaping import Shape
from cohelm.pilot.safety_filter import FilterResult, SafetyFilter
from cohelm.robot.gate.gate import Gate, GateRules, Passed, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import rules, standing
from cohelm.robot.keep.process import GatedRobot
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings
from cohelm.ros.clock import SimulatedClock
from cohelm.ros.commands import Commands, Nominal
from cohelm.ros.found import Found
from cohelm.ros.pacing import Pacing
from cohelm.ros.port import Transport
from cohelm.ros.report import Report, Row
from cohelm.ros.reset import ResetRequest, resets

WATCHDOG = 0.2
"""Without a sound proposal for so long the gate process brakes the base [s]."""
FRESH = 0.015
"""Readings older than this are read again before a command is filtered with them [s]: more than
`LEAD` and the spare time of the longest period."""
LEAD = 0.006
"""So long before a command is expected they are taken in [s]: as a rule a scan takes less."""
WARM = 0.5
"""So long the node works while it lets nothing move [s]."""
SHAPED = 0.01
"""A command that is changed by less counts as unchanged [m/s]."""
_WARN_EVERY = 30.0
"""Between two warnings of several controllers [s]."""
_STILL = Twist(0.0, 0.0)
_NOWHERE = Pose(math.nan, math.nan, math.nan)


class FilterParams(NamedTuple):
    """How the node works."""

    period: float
    """The longest control period [s]."""
    timeout: float = 0.5
    """A command counts for so long [s]."""


def gate_rules(model: RobotModel, period: float) -> GateRules:
    """The gate's, for readings as seldom as this robot's."""
    may = timeouts(model, period)
    made = rules(model, period, WATCHDOG)
    return made._replace(age=max(made.age, may.odometry))


class FilterNode:
    """One robot's filter. `run` until it is over."""

    def __init__(
        self, transport: Transport, gated: GatedRobot, found: Found, params: FilterParams,
        log: Callable[[str], None] = lambda _: None,
    ) -> None:  # fmt: skip
        """transport: for commands and reports; the gate process has one of its own for the robot.
        log: receives each new reason."""
        model = found.model
        self._gated, self._params, self._every = gated, params, found.command_period
        self._perception = Perception(model)
        self._filter = SafetyFilter(model, params.period)
        self._limits = model.bounds()
        self._watchdog = SensorWatchdog(model, timeouts(model, params.period))
        self._transport = transport
        clock = SimulatedClock.on(transport) if found.simulated else None
        ticks = found.odom_clock if clock is None else clock
        self._commands = Commands(transport, found.topics.command, params.timeout, ticks)
        self._report = Report(transport, found, log, clock)
        self._shape = Shape(model.outline, self._reshape)
        self._resets = ResetRequest()
        resets(transport, self._report.topic("reset"), self._resets.request, self._report.note)
        self._readings = Readings()
        self._looked = self._period_start = -math.inf
        """When the readings were taken in, and when the last period began [s]."""
        self._number = 0
        self._topic, self._warned = found.topics.command, -math.inf
        self.may_drive = False
        """Whether a command may let the base move; `run` allows it."""

    def warm_up(self) -> None:
        """Everything once, standing: what has to be compiled is not when a command waits for it."""
        warm_up(self._gated.model, False)
        end = time.monotonic() + WARM
        while time.monotonic() < end:
            self.step()
            time.sleep(self._params.period)

    def run(self, over: Callable[[], bool]) -> None:
        """Runs until `over` returns true; the gate process is left to be closed."""
        self.may_drive, garbage = True, Sweeper()
        pacing = Pacing(self._params.period, time.monotonic(), self._every)
        try:
            while not over():
                while (left := pacing.earliest() - time.monotonic()) > 0.0:
                    time.sleep(left)
                came = self._commands.wait(pacing.expected() - LEAD - time.monotonic())
                if not came:
                    self._look()
                    came = self._commands.wait(pacing.latest() - time.monotonic())
                pacing.begin(time.monotonic(), came)
                self.step()
                if pacing.expected() - time.monotonic() > 0.5 * self._params.period:
                    garbage.sweep(time.monotonic())
        finally:
            garbage.end()

    def step(self) -> Row:
        """One control period: the newest command, through filter and gate, to the base."""
        start = time.monotonic()
        gated = self._gated
        nominal = self._commands.now(start)
        self._warn_of_several(start)
        after, self._period_start = start - self._period_start, start
        if start - self._looked > FRESH:
            self._look()
        readings, now = self._readings, gated.now()
        fault = self._watchdog.problem(now, readings)
        fault = fault and (self._transport.lost() or fault)
        seen = self._perception.seen(now)
        self._shape.take(readings.outline)
        self._report.outline = self._shape.outline
        slowly = backed_slowly(nominal.twist, seen.assumed_gap, self._limits)
        result = self._filter(
            _NOWHERE if fault or readings.scan is None else seen.odometry, seen.twist,
            slowly, seen.obstacles, after if math.isfinite(after) else None,
        )  # fmt: skip
        stamp = now
        if not fault and readings.odometry is not None:
            stamp = readings.odometry.stamp
        safe = _STILL if fault else result.twist
        self._drive(nominal, fault)
        passed = gated.propose(Proposal(self._number, stamp, safe))
        self._number += 1
        if math.isfinite(passed.applied.v) and math.isfinite(passed.applied.omega):
            self._filter.sent(passed.applied)
        stands = passed.applied == _STILL and standing(seen.twist)
        reshaping = self._shape.settle(result.verdict, stands)
        gate = gated.gate
        kind, text = _reason(nominal, fault, result, passed, gate, self._report.topic("reset"))
        if kind in ("", "shaped") and slowly is not nominal.twist:
            kind, text = "shaped", UNSEEN
        if reshaping and kind in ("brakes", "monitor"):
            kind = "footprint"
            text = f"{text}: outline change: both outlines apply until the new one fits"
        row = Row(
            kind, text, nominal.twist, safe, passed.applied, result.verdict, result.change,
            result.clearance, latched(gate.mode), _place(result, seen), *_ages(now, readings),
            time.monotonic() - start,
        )  # fmt: skip
        self._report.take(row)
        return row

    def _warn_of_several(self, now: float) -> None:
        """Two controllers are no fault: each command is made safe. But nobody means such a
        drive."""
        if self._commands.contested(now) and now - self._warned > _WARN_EVERY:
            self._warned = now
            self._report.note(
                f"commands on {self._topic} come from several nodes in turn, and the newest "
                "counts: stop one of them, or choose between them with twist_mux"
            )

    def _reshape(self, outline: Floats) -> None:
        self._filter.reshape(outline)
        self._perception.reshape(outline)

    def _look(self) -> None:
        """Take in what the sensors have seen since: between two commands, so that none waits."""
        self._looked = time.monotonic()
        self._readings = self._gated.read()
        self._perception.receive(self._gated.now(), self._readings)

    def _drive(self, nominal: Nominal, fault: str) -> None:
        """Enables the base as soon as a controller is there and nothing is wrong."""
        gate = self._gated.gate
        refusal = self._resets.due(gate, time.monotonic())
        if refusal is not None:
            refusal = refusal or self._gated.reset()
            self._report.note(f"not reset: {refusal}" if refusal else "reset")
        elif gate.mode == GateMode.IDLE and nominal.fresh and not fault and self.may_drive:
            self._gated.drive(GateMode.AUTOMATIC)


def _place(result: FilterResult, seen: Seen) -> tuple[float, float] | None:
    """Of what holds the robot back, in the frame of the odometry."""
    limiting = result.limiting
    if limiting is None:
        return None
    obstacles = seen.obstacles
    rows = obstacles.discs if limiting.kind == "disc" else obstacles.points
    x, y = rows[limiting.row, :2]
    return float(x), float(y)


def _reason(
    nominal: Nominal, fault: str, result: FilterResult, passed: Passed, gate: Gate, reset: str
) -> tuple[str, str]:
    """Why the base does not get what the controller requested: a kind, and a sentence; both empty
    where it does. reset: the topic."""
    if latched(gate.mode):
        return "gate", f"{gate.reason}: fix it, then publish std_msgs/msg/Empty once on {reset}"
    if fault:
        return "readings", f"stopped: {fault}"
    if nominal.reason:
        return "command", nominal.reason
    if result.verdict == Verdict.INVALID:
        return "command", "the command, or what perception knows, is not a number"
    if driving(gate.mode) and passed.reason.startswith(("collision monitor", "contact monitor")):
        return "monitor", passed.reason
    if result.verdict in (Verdict.BRAKING, Verdict.STANDING):
        return "brakes", f"brakes for an obstacle {_metres(result.clearance)} off"
    if result.limiting is not None and result.change > SHAPED:
        return "shaped", f"limited by an obstacle {_metres(result.clearance)} off"
    if driving(gate.mode) and passed.reason:
        return "limits", passed.reason
    return "", ""


def _metres(clearance: float) -> str:
    return f"{clearance:.2f} m" if math.isfinite(clearance) else "far"


def _ages(now: float, readings: Readings) -> tuple[float, float]:
    """Of odometry and scan [s]; infinite where there is none."""
    odometry, scan = readings.odometry, readings.scan
    return (
        math.inf if odometry is None else now - odometry.stamp,
        math.inf if scan is None else now - scan.stamp - scan.duration,
    )
