"""The gate's process: it stops the robot when the loop can not.

The loop's process may be killed, hang, or be starved; this one notices within the watchdog's time,
brakes the robot, says why to the record, and lets the robot go only when it stands. It never waits
for the loop: an answer that the loop does not take is left out, and that is silence too.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.robot.gate import gate as gates
from cohelm.robot.gate.gate import Gate, GateRules
from cohelm.robot.keep.control import Control
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import LocalGatedRobot, standing
from cohelm.robot.keep.priority import urgent, with_its_threads
from cohelm.robot.keep.processes import bound
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.keep.shared_memory import SharedMemory, shared
from cohelm.robot.keep.wire import packed_gate, packed_passed, packed_readings, proposal_of
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings, RobotPort

BRAKING = 5.0
"""A robot that does not stand by then is let go all the same [s]."""
_TICK = 0.02  # the gate is looked after this often when nothing comes [s]
_SWITCH = 5e-4  # so long may another thread of this process keep the gate process waiting [s]


class Begun(NamedTuple):
    """What the gate process says first. With it comes the handle of the memory for scans and
    frames."""

    model: RobotModel
    gate: Gate
    now: float
    """The robot's clock [s]..."""
    then: float
    """... and this machine's monotonic one at that time [s]."""
    scans: dict[str, int]
    """Room for a scan of each LiDAR [byte]."""
    frame: int
    """Room for a frame [byte]."""


def serve(
    line: Control, make: Callable[[], RobotPort], rules: GateRules, record: socket.socket | None,
    live: socket.socket | None = None,
) -> None:  # fmt: skip
    """The other process, from its beginning to its end."""
    let_go = bound()  # nothing reaches the wheels before the loop knows of the robot
    try:
        kept = LocalGatedRobot(make(), rules, RecordLine(record), shown=RecordLine(live))
        memory = shared(kept.model)
        kept.read()
    except CohelmError as error:
        line.say(error)
        return
    urgent()
    with_its_threads()
    sys.setswitchinterval(_SWITCH)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # told to all, it is the loop's to handle
    let_go()
    try:
        begun = Begun(
            kept.model, kept.gate, kept.now(), time.monotonic(), memory.scans, memory.frame
        )
        line.say(begun, memory.handle)
        os.close(memory.handle)
        _attend(line, kept, memory, rules)
    except (EOFError, OSError):
        kept.fault("the loop's process is gone")
    except BaseException as error:
        kept.fault(f"the gate process failed: {error!r}")
        kept.say(f"the gate process failed: {error!r}", True)
        _bring_to_stand(kept)
        raise
    _bring_to_stand(kept)
    kept.close()


def _attend(line: Control, kept: LocalGatedRobot, memory: SharedMemory, rules: GateRules) -> None:
    """Answer the loop; look after the gate whether or not it says anything."""
    garbage, told = Sweeper(), kept.gate
    while True:
        bark = gates.due(kept.gate, rules)
        if line.wait(min(max(bark - kept.now(), 0.0) + 0.0005, _TICK)):
            (number, what, with_), handle = line.hear()
            answer = _answered(kept, memory, what, with_, handle)
            told = _say(line, number, answer, kept, told)
            if what == "close":
                return
            if kept.now() > bark:  # a loop that only asks is no loop that drives
                kept.tick()
            if what == "propose":  # nothing more is asked before the next period
                garbage.sweep(time.monotonic())
        else:
            kept.tick()
            kept.read()


def _answered(
    kept: LocalGatedRobot, memory: SharedMemory, what: str, with_: Any, handle: int | None
) -> Any:
    if what == "read":
        return packed_readings(memory.put(_news(kept.read(), *with_)))
    if what == "propose":
        return packed_passed(kept.propose(proposal_of(with_)))
    if what == "stop":
        return kept.stop(with_)
    if what == "fault":
        return kept.fault(with_)
    if what == "reset":
        return kept.reset()
    if what == "record":
        return kept.record_into(None if handle is None else socket.socket(fileno=handle))
    if what == "drive":
        return kept.drive(with_)
    return kept.truth() if what == "truth" else None


def _say(line: Control, number: int, answer: Any, kept: LocalGatedRobot, told: Gate) -> Gate:
    """The gate as the loop knows it by now, from which it is told what is new. Where there is no
    room the loop does not listen, and the watchdog deals with it."""
    gate = kept.gate
    news = None if gate is told else packed_gate(gate)
    try:
        said = line.say((number, answer, news, kept.now(), time.monotonic()))
    except ValueError as error:
        said = line.say((number, CohelmError(str(error)), news, kept.now(), time.monotonic()))
    return gate if said else told


def _news(readings: Readings, scan: int, further: dict[str, int], frame: int) -> Readings:
    """The readings without the scans and the frame that the loop has already, by their numbers."""
    if readings.scan is not None and readings.scan.number == scan:
        readings = readings._replace(scan=None)
    if readings.further:
        new = (one for one in readings.further if further.get(one.sensor) != one.number)
        readings = readings._replace(further=tuple(new))
    if readings.frame is not None and readings.frame.number == frame:
        readings = readings._replace(frame=None)
    return readings


def _bring_to_stand(kept: LocalGatedRobot) -> None:
    """Brake until the robot stands, then say so."""
    if not kept.gate.reason:
        kept.stop("the loop has ended")
    end = kept.now() + BRAKING
    while kept.now() < end:
        kept.tick()
        kept.wait(kept.now() + _TICK)
        odometry = kept.read().odometry
        if odometry is not None and standing(odometry.twist) and end - kept.now() < BRAKING - 0.2:
            return
