"""The robot and its gate in a process of their own: it stops the robot when the loop can not.

The loop's process may be killed, hang, or be starved; this one notices within the watchdog's time,
brakes the robot, says why to the record, and lets the robot go only when it stands.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import select
import signal
import socket
import time
from collections.abc import Callable
from multiprocessing import reduction
from multiprocessing.connection import Connection
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.robot.gate import gate as gates
from cohelm.robot.gate.gate import Gate, Passed, Proposal, Rules
from cohelm.robot.gate.modes import Mode
from cohelm.robot.keep.kept import Kept, standing
from cohelm.robot.keep.lines import Line
from cohelm.robot.keep.priority import urgent
from cohelm.robot.keep.processes import bound, started
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Readings, Robot, Scan

_TICK = 0.02  # the gate is looked after this often when nothing comes [s]
_BRAKING = 5.0  # a robot that does not stand by then is let go all the same [s]
_START = 120.0  # a robot may take this long to be made, compiling included [s]
_ANSWER = 2.0  # the keeper answers within this, or is gone [s]
_WATCHDOGS = 10.0  # ... or within so many times the patience of the watchdog, if that is longer

Make = Callable[[], Robot]


class KeptElsewhere:
    """A `Keeper` whose robot lives in another process. In real time only."""

    def __init__(self, make: Make, rules: Rules, record: socket.socket | None = None) -> None:
        """make: makes the robot, over there; must be picklable. record: where events go.

        Raises CohelmError if the robot can not be made.
        """
        self._line, theirs = multiprocessing.Pipe()
        self._process = started("cohelm keeper", _serve, theirs, make, rules, record)
        theirs.close()
        self._scan: Scan | None = None
        self._frame: Frame | None = None
        self._gate = Gate()
        self._offset = 0.0
        self._within = max(_ANSWER, _WATCHDOGS * rules.watchdog)
        try:
            if not self._line.poll(_START):
                raise CohelmError(
                    f"the robot was not made within {_START:.0f} s: start it again; what has been "
                    "compiled by now is kept"
                )
            self._model: RobotModel = self._answer(0.0)
        except BaseException:
            self._process.kill()  # nothing has reached the wheels
            self._process.join()
            raise

    @property
    def pid(self) -> int:
        """Of the other process."""
        return self._process.pid or 0

    @property
    def model(self) -> RobotModel:
        """Of the robot."""
        return self._model

    @property
    def gate(self) -> Gate:
        """As of the last answer."""
        return self._gate

    def now(self) -> float:
        """The robot's clock, as of its last answer, moved on with this machine's."""
        return time.monotonic() + self._offset

    def wait(self, until: float) -> None:
        """Sleep."""
        left = until - self.now()
        while left > 0.0:
            time.sleep(left)
            left = until - self.now()

    def read(self) -> Readings:
        """The newest of everything; scans and frames travel once."""
        have = (self._scan.number if self._scan else -1, self._frame.number if self._frame else -1)
        readings: Readings = self._ask("read", have)
        self._scan = readings.scan or self._scan
        self._frame = readings.frame or self._frame
        return readings._replace(scan=self._scan, frame=self._frame)

    def propose(self, proposal: Proposal) -> Passed:
        """Through the gate to the wheels."""
        return self._ask("propose", proposal)

    def stop(self, reason: str) -> None:
        """Latched, and at once."""
        self._ask("stop", reason)

    def fault(self, reason: str) -> None:
        """Latched, and at once."""
        self._ask("fault", reason)

    def reset(self) -> str:
        """Let go, into IDLE."""
        return self._ask("reset", None)

    def drive(self, mode: Mode) -> str:
        """Choose who drives."""
        return self._ask("drive", mode)

    def truth(self) -> Any:
        """What only a simulated robot knows."""
        return self._ask("truth", None)

    def record_into(self, end: socket.socket | None) -> None:
        """The recorder's end goes over to the keeper's process, and is closed here."""
        try:
            self._line.send(("record", end is not None))
            if end is not None:
                reduction.send_handle(self._line, end.fileno(), self.pid)
                end.close()
        except OSError as error:
            raise _gone() from error
        self._answer(self._within)

    def close(self) -> None:
        """The robot is stopped there, and let go when it stands."""
        with contextlib.suppress(OSError, CohelmError):
            self._ask("close", None)
        with contextlib.suppress(OSError):
            self._line.close()
        self._process.join(_BRAKING + 2.0)

    def _ask(self, what: str, with_: Any) -> Any:
        try:
            self._line.send((what, with_))
        except OSError as error:
            raise _gone() from error
        return self._answer(self._within)

    def _answer(self, within: float) -> Any:
        try:
            if not self._line.poll(within):
                raise CohelmError("the process that keeps the robot does not answer")
            answer, self._gate, theirs, then = self._line.recv()
        except (EOFError, OSError) as error:
            raise _gone() from error
        self._offset = theirs - then
        if isinstance(answer, CohelmError):
            raise answer
        return answer


def _gone() -> CohelmError:
    return CohelmError("the process that keeps the robot is gone; the robot stops by itself")


def _serve(line: Connection, make: Make, rules: Rules, record: socket.socket | None) -> None:
    """The other process."""
    let_go = bound()  # nothing reaches the wheels before the loop knows of the robot
    try:
        robot = make()
        kept = Kept(robot, rules, Line(record))
        kept.read()
    except CohelmError as error:
        line.send((error, Gate(), 0.0, 0.0))
        return
    urgent()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # told to all, it is the loop's to handle
    let_go()
    try:
        line.send((kept.model, kept.gate, kept.now(), time.monotonic()))
        _attend(line, kept, robot, rules)
    except (EOFError, OSError):
        kept.fault("the loop's process is gone")
    except BaseException as error:
        kept.fault(f"the keeper failed: {error!r}")
        kept.say(f"the keeper failed: {error!r}", True)
        _bring_to_stand(kept)
        raise
    _bring_to_stand(kept)
    kept.close()


def _attend(line: Connection, kept: Kept, robot: Robot, rules: Rules) -> None:
    """Answer the loop; look after the gate when it says nothing."""
    poll = select.poll()
    poll.register(line.fileno(), select.POLLIN | select.POLLHUP)
    while True:
        bark = gates.due(kept.gate, rules) - kept.now()
        wait = min(max(bark, 0.0) + 0.0005, _TICK)
        if not poll.poll(1000.0 * wait):
            kept.tick()
            kept.read()
            continue
        what, with_ = line.recv()
        answer: Any = None
        if what == "read":
            answer = _news(kept.read(), *with_)
        elif what == "propose":
            answer = kept.propose(with_)
        elif what == "stop":
            kept.stop(with_)
        elif what == "fault":
            kept.fault(with_)
        elif what == "reset":
            answer = kept.reset()
        elif what == "record":
            end = socket.socket(fileno=reduction.recv_handle(line)) if with_ else None
            kept.record_into(end)
        elif what == "drive":
            answer = kept.drive(with_)
        elif what == "close":
            line.send((None, kept.gate, kept.now(), time.monotonic()))
            return
        elif what == "truth":
            answer = getattr(robot, "truth", lambda: None)()
        line.send((answer, kept.gate, kept.now(), time.monotonic()))


def _news(readings: Readings, scan: int, frame: int) -> Readings:
    """The readings without the scan and the frame that the loop has already."""
    if readings.scan is not None and readings.scan.number == scan:
        readings = readings._replace(scan=None)
    if readings.frame is not None and readings.frame.number == frame:
        readings = readings._replace(frame=None)
    return readings


def _bring_to_stand(kept: Kept) -> None:
    """Brake until the robot stands, then say so."""
    if not kept.gate.reason:
        kept.stop("the loop has ended")
    end = kept.now() + _BRAKING
    while kept.now() < end:
        kept.tick()
        kept.wait(kept.now() + _TICK)
        odometry = kept.read().odometry
        if odometry is not None and standing(odometry.twist) and end - kept.now() < _BRAKING - 0.2:
            return
