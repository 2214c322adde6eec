"""Drives the excitation through the gate, and records commands and readings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cohelm.calibrate.excitation import Excitation, Segment, on_the_floor
from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Progress, Twist
from cohelm.robot.gate.gate import Proposal
from cohelm.robot.gate.modes import GateMode, latched
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import standing
from cohelm.robot.keep.process import GatedRobot
from cohelm.robot.port import Odometry

PERIOD = 0.02
"""Of the commands [s]."""
_STILL = Twist(0.0, 0.0)
_SETTLED = 0.3  # it has to stand for so long before it counts as resting [s]
_SCANS = 5  # a rest lasts until so many were measured in it
_PATIENCE = 10.0  # readings come, and motions end, within this [s]
_LEAST = 0.25  # of a motion, a robot that obeys makes at least this share
_USUAL = ("", "faster than the robot may be", "a change faster than the robot may make",
          "the robot does not do more")  # fmt: skip


@dataclass
class Rest:
    """The robot stands."""

    since: float
    """[s]"""
    until: float = math.inf
    scans: list[Floats] = field(default_factory=list[Floats])
    """Ranges (n,) of each [m]."""


@dataclass
class Ride:
    """What was driven, so far."""

    commands: list[tuple[float, float, float]] = field(
        default_factory=list[tuple[float, float, float]]
    )
    """When, v, omega: what went to the wheels [s, m/s, rad/s]."""
    odometry: list[Odometry] = field(default_factory=list[Odometry])
    segments: list[tuple[float, float, Segment]] = field(
        default_factory=list[tuple[float, float, Segment]]
    )
    """Begin, end (at rest again) [s], and what was meant."""
    rests: list[Rest] = field(default_factory=list[Rest])
    """One before each motion, and one after the last."""
    ended: str = ""
    """Why it is not whole; empty where it is."""

    def trail(self) -> Floats:
        """Odometry, (n, 4): stamp, x, y, heading."""
        return np.array([[o.stamp, *o.pose] for o in self.odometry]).reshape(-1, 4)


def ride(
    gated: GatedRobot, plan: Excitation, over: Callable[[], str] = lambda: "",
    progress: Progress = lambda _, __: None,
) -> Ride:  # fmt: skip
    """Drive all motions, or as many as can be. The robot stands at the end, whatever happens.

    over: why to end now, or nothing. progress: what is done, and how much of all. Raises
    CohelmError where nothing could be measured; else `Ride.ended` says why it is not whole.
    """
    rider, garbage = _Rider(gated, over), Sweeper()
    try:
        rider.begin(plan)
        for number, segment in enumerate(plan.segments):
            progress(
                "driving straight" if segment.twist.v else "turning", number / len(plan.segments)
            )
            rider.rest()
            garbage.sweep(gated.now())  # it stands: nothing is late by that
            rider.drive(segment)
        rider.rest()
    except _EndedError as ended:
        rider.made.ended = str(ended)
    finally:
        rider.stand()
        garbage.end()
    if not rider.made.segments:
        raise CohelmError(rider.made.ended)
    return rider.made


class _EndedError(Exception):
    """The ride can not go on."""


class _Rider:
    def __init__(self, gated: GatedRobot, over: Callable[[], str]) -> None:
        self.gated, self._over = gated, over
        self.made = Ride()
        self._sequence, self._number = 0, -1
        self._resting: Rest | None = None
        self._line = 0.0  # heading of the first straight [rad]

    def begin(self, plan: Excitation) -> None:
        """Wait until sensors deliver, nothing is in the way, and the gate lets the robot drive."""
        gated, began = self.gated, self.gated.now()
        while True:
            readings = gated.read()
            if readings.odometry is not None and readings.scan is not None:
                break
            if gated.now() - began > _PATIENCE:
                what = "odometry" if readings.odometry is None else "scan"
                raise _EndedError(f"no {what} came within {_PATIENCE:.0f} s: is its sensor on?")
            self._over_now()
            gated.wait(gated.now() + PERIOD)
        if obstruction := on_the_floor(gated.model, readings.scan, plan):
            raise _EndedError(obstruction)
        for _ in range(25):
            self._period(_STILL)
        self._go()

    def rest(self) -> None:
        """Stand, until enough scans were measured."""
        began, resting = self.gated.now(), math.nan
        rest: Rest | None = None
        lidar = self.gated.model.lidar
        longest = _PATIENCE + (0.0 if lidar is None else _SCANS / lidar.rate_hz)
        while rest is None or len(rest.scans) < _SCANS:
            odometry = self._period(_STILL)
            now = self.gated.now()
            if not standing(odometry.twist):
                resting = math.nan
            elif resting != resting:
                resting = odometry.stamp
            if rest is None and now - resting > _SETTLED:
                rest = self._resting = Rest(now)
            if now - began > longest:
                why = "it does not stop" if rest is None else "no new scan comes"
                raise _EndedError(f"{why}: measuring ends here")
        rest.until = self.gated.now()
        self.made.rests.append(rest)
        self._resting = None

    def drive(self, segment: Segment) -> None:
        """One motion, until the robot stands again."""
        gated = self.gated
        twist, hold = segment.twist, segment.hold
        before = self.made.odometry[-1].pose
        if segment.legs:  # half turns lead back to the line, whatever was turned too much before
            goal = math.pi if segment.legs % 2 and segment.twist.v == 0.0 else 0.0
            if twist.v == 0.0:
                away = _wrapped(goal + self._line - before.psi)
                angle = away if away * twist.omega > 0.0 else away + math.copysign(
                    2.0 * math.pi, twist.omega
                )  # fmt: skip
                hold = min(abs(angle / twist.omega), 1.3 * hold)
        elif twist.v:
            self._line = before.psi
        began = gated.now()
        while gated.now() < began + hold - 1e-6:
            self._period(twist)
        if segment.hard:
            gated.stop("measuring how it brakes")
            self.made.commands.append((gated.now(), 0.0, 0.0))
        resting = 0
        ended = gated.now()
        # a robot that brakes harder than its file states stands before the gate has braked to 0
        while resting < 5 or (segment.hard and gated.gate.applied != _STILL):
            odometry = self._period(_STILL, stopped=segment.hard)
            resting = resting + 1 if standing(odometry.twist) else 0
            if gated.now() - ended > _PATIENCE:
                raise _EndedError("the robot does not stop: measuring ends here")
        if segment.hard:
            if refused := gated.reset():
                raise _EndedError(f"the stop can not be reset: {refused}")
            self._go()
        after = self.made.odometry[-1].pose
        if twist.v:
            done = math.hypot(after.x - before.x, after.y - before.y) / (abs(twist.v) * hold)
        else:  # less than a whole turn
            turned = _wrapped(after.psi - before.psi)
            if abs(turned) > 2.0:
                turned = abs(turned)
            done = abs(turned) / (abs(twist.omega) * hold)
        if done < _LEAST:
            raise _EndedError(
                f"the robot made {done:.0%} of a commanded motion: is it switched on, "
                "released, and does it listen to these commands?"
            )
        self.made.segments.append((began, gated.now(), segment))

    def stand(self) -> None:
        """Brake, and wait until the odometry reports standstill, or for long enough."""
        gated = self.gated
        gated.stop(self.made.ended or "measured")
        until = gated.now() + 3.0
        while gated.now() < until:
            gated.wait(gated.now() + PERIOD)
            odometry = gated.read().odometry
            self._propose(_STILL, gated.now())
            if odometry is not None and standing(odometry.twist):
                break

    def _go(self) -> None:
        if refused := self.gated.drive(GateMode.AUTOMATIC):
            raise _EndedError(
                f"the gate does not let it drive: {self.gated.gate.reason or refused}"
            )

    def _period(self, twist: Twist, stopped: bool = False) -> Odometry:
        gated = self.gated
        gated.wait(gated.now() + PERIOD)
        readings = gated.read()
        odometry, scan = readings.odometry, readings.scan
        if odometry is None or scan is None:
            raise _EndedError("no readings: measuring ends here")
        if not self.made.odometry or odometry.stamp > self.made.odometry[-1].stamp:
            self.made.odometry.append(odometry)
        elif odometry.stamp < self.made.odometry[-1].stamp:
            raise _EndedError("the odometry's clock went back: measuring ends here")
        if scan.number != self._number:
            self._number = scan.number
            if self._resting is not None and scan.stamp >= self._resting.since:
                self._resting.scans.append(scan.ranges.copy())
        reason = self._propose(twist, odometry.stamp)
        gate = gated.gate
        if gate.mode == GateMode.FAULTED or (latched(gate.mode) and not stopped):
            raise _EndedError(f"the robot was stopped: {gate.reason}")
        if twist != _STILL and reason not in _USUAL:
            raise _EndedError(slowed(reason))
        self._over_now()
        return odometry

    def _propose(self, twist: Twist, stamp: float) -> str:
        gated = self.gated
        self._sequence += 1
        now = gated.now()
        passed = gated.propose(Proposal(self._sequence, stamp, twist))
        stopped = latched(gated.gate.mode)  # the robot brakes as hard as it can, not as the gate
        applied = _STILL if stopped else passed.applied
        self.made.commands.append((now, applied.v, applied.omega))
        return passed.reason

    def _over_now(self) -> None:
        if reason := self._over():
            raise _EndedError(reason)


def _wrapped(angle: float) -> float:
    """Within half a turn [rad]. Not compiled: while a robot drives, nothing may be loaded."""
    return math.remainder(angle, math.tau)


def slowed(reason: str) -> str:
    """That a ride ends where the gate or a monitor limits it, and what to do."""
    cure = "mend that, and measure again"
    if "mounted" in reason:
        cure = "give lidar.mount_yaw_deg in the robot's file to 2 degrees, and measure again"
    elif reason.startswith("collision monitor"):
        cure = "more free floor is needed"
    return f"the robot was slowed down ({reason}): {cure}"
