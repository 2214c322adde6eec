"""The gate process: it stops the robot when the loop can not.

The loop's process may be killed, hang, or starve; this one notices within the watchdog's time,
brakes the robot, logs why, and closes the robot only when it stands. It never waits for the loop:
an answer that does not fit into the socket is dropped, and the watchdog goes on.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.robot.gate import gate as gates
from cohelm.robot.gate.gate import Gate, GateRules
from cohelm.robot.keep.control_line import Control
from cohelm.robot.keep.garbage import Sweeper
from cohelm.robot.keep.gated_robot import LocalGatedRobot, standing
from cohelm.robot.keep.priority import raise_priority, raise_thread_priorities
from cohelm.robot.keep.processes import end_group, end_with_parent, lead_group
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.keep.shared_memory import SharedMemory, shared
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings, RobotPort

BRAKING = 5.0
"""A robot that does not stand by then is closed all the same [s]."""
CLOSING = 2.0
"""The process ends so long after its robot has stopped, whatever the driver is still doing; and so
long after the loop has, where the driver hangs in the middle of a call [s]."""
_TICK = 0.02  # the gate is updated this often when nothing comes [s]
_LINGERS = (
    "the robot's driver does not end (its close or another call hangs, or it has a thread that is "
    "no daemon): the gate process ends all the same"
)
_SWITCH = 5e-4  # thread switch interval: bounds the wait for another thread of this process [s]


class Begun(NamedTuple):
    """The gate process's first message. With it comes the handle of the memory for scans and
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
    lead_group()
    release = end_with_parent()  # nothing reaches the wheels before the loop knows of the robot
    try:
        robot = make()
        memory = shared(robot.model)
        gated = LocalGatedRobot(
            robot, rules, RecordLine(record), viewer=RecordLine(live), calling=memory.calling
        )
        gated.read()
    except CohelmError as error:
        line.send(error)
        return
    raise_priority()
    raise_thread_priorities()
    sys.setswitchinterval(_SWITCH)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # sent to all; the loop handles it
    release()
    heard = _ends_with(line)
    try:
        begun = Begun(
            gated.model, gated.gate, gated.now(), time.monotonic(), memory.scans, memory.frame
        )
        line.send(begun, memory.handle)
        os.close(memory.handle)
        _serve_requests(line, gated, memory, rules)
    except (EOFError, OSError):
        gated.fault("the loop's process has ended")
    except BaseException as error:
        gated.fault(f"the gate process failed: {error!r}")
        gated.log(f"the gate process failed: {error!r}", True)
        heard.set()
        _bring_to_stand(gated)
        _end_within(CLOSING)
        raise
    heard.set()
    _bring_to_stand(gated)
    _end_within(CLOSING)
    gated.close()
    end_group()


def _serve_requests(
    line: Control, gated: LocalGatedRobot, memory: SharedMemory, rules: GateRules
) -> None:
    """Answer the loop's requests, and update the gate whether or not there are any."""
    garbage, sent = Sweeper(), gated.gate
    while True:
        deadline = gates.due(gated.gate, rules)
        if line.wait(min(max(deadline - gated.now(), 0.0) + 0.0005, _TICK)):
            (number, what, with_), handle = line.receive()
            answer = _answer(gated, memory, what, with_, handle)
            sent = _send_answer(line, number, answer, gated, sent)
            if what == "close":
                return
            if gated.now() > deadline:  # requests without proposals do not feed the watchdog
                gated.tick()
            if what == "propose":  # no further request before the next period
                garbage.sweep(time.monotonic())
        else:
            gated.tick()
            gated.read()


def _answer(
    gated: LocalGatedRobot, memory: SharedMemory, what: str, with_: tuple[Any, ...],
    handle: int | None,
) -> Any:  # fmt: skip
    if what == "read":
        return memory.put(_unsent(gated.read(), *with_))
    if what == "record_into":
        return gated.record_into(None if handle is None else socket.socket(fileno=handle))
    return None if what == "close" else getattr(gated, what)(*with_)


def _send_answer(
    line: Control, number: int, answer: Any, gated: LocalGatedRobot, sent: Gate
) -> Gate:
    """Send an answer, with the gate's state where it has changed; returns the state that the loop
    has now. Where there is no room the loop does not read, and the watchdog handles that."""
    gate = gated.gate
    news = None if gate is sent else gate
    try:
        taken = line.send((number, answer, news, gated.now(), time.monotonic()))
    except ValueError as error:
        taken = line.send((number, CohelmError(str(error)), news, gated.now(), time.monotonic()))
    return gate if taken else sent


def _unsent(readings: Readings, scan: int, further: dict[str, int], frame: int) -> Readings:
    """The readings without the scans and the frame that the loop has, by their numbers."""
    if readings.scan is not None and readings.scan.number == scan:
        readings = readings._replace(scan=None)
    if readings.further:
        new = (one for one in readings.further if further.get(one.sensor) != one.number)
        readings = readings._replace(further=tuple(new))
    if readings.frame is not None and readings.frame.number == frame:
        readings = readings._replace(frame=None)
    return readings


def _bring_to_stand(gated: LocalGatedRobot) -> None:
    """Brake until the robot stands."""
    _end_within(BRAKING + CLOSING)
    if not gated.gate.reason:
        gated.stop("the loop has ended")
    end = gated.now() + BRAKING
    while gated.now() < end:
        gated.tick()
        gated.wait(gated.now() + _TICK)
        odometry = gated.read().odometry
        if odometry is not None and standing(odometry.twist) and end - gated.now() < BRAKING - 0.2:
            return


def _end_within(within: float) -> None:
    """End this process, even if the driver's `close` hangs or a thread of it goes on: it would keep
    the hardware, and hear no signal but SIGKILL."""

    def end() -> None:
        time.sleep(within)
        _end()

    threading.Thread(target=end, name="end", daemon=True).start()


def _ends_with(line: Control) -> threading.Event:
    """End this process when the loop's end of the line is closed and that is not heard, since the
    driver hangs: nobody else would. The event says that it was heard."""
    heard = threading.Event()

    def watch() -> None:
        line.closed()
        # in parts: a machine that stands still meanwhile uses up one of them
        if not any(heard.wait(CLOSING / 4) for _ in range(4)):
            _end()

    threading.Thread(target=watch, name="loop's end", daemon=True).start()
    return heard


def _end() -> None:
    with contextlib.suppress(Exception):  # the driver may have closed it
        print(_LINGERS, file=sys.stderr, flush=True)
    end_group()
    os._exit(1)
