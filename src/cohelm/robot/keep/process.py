"""The robot and its gate in a process of their own: the loop's side of it.

Loop and gate process speak over a `control` line that nobody waits at; scans and frames go by
`shared_memory`. What the other process does is in `serve`.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.robot.gate.gate import Gate, GateRules, Passed, Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.control import control
from cohelm.robot.keep.processes import left_alone, started
from cohelm.robot.keep.serve import BRAKING, Begun, serve
from cohelm.robot.keep.shared_memory import SharedMemory
from cohelm.robot.keep.wire import gate_of, packed_proposal, passed_of, readings_of
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Readings, RobotPort, Scan

_START = 600.0  # a robot may take this long to be made, compiling included [s]
_ANSWER = 2.0  # the gate process answers within this, or is gone [s]
_WATCHDOGS = 10.0  # ... or within so many times the patience of the watchdog, if that is longer

Make = Callable[[], RobotPort]


class RemoteGatedRobot:
    """A `GatedRobot` whose robot lives in another process. In real time only."""

    def __init__(
        self, make: Make, rules: GateRules, record: socket.socket | None = None,
        live: socket.socket | None = None,
    ) -> None:  # fmt: skip
        """make: makes the robot, over there; must be picklable. record, live: where events go.

        Raises CohelmError if the robot can not be made.
        """
        self._line, theirs = control()
        self._process = started("cohelm gate", serve, theirs, make, rules, record, live)
        theirs.close()
        self._scan: Scan | None = None
        self._further: dict[str, Scan] = {}
        self._frame: Frame | None = None
        self._gate = Gate()
        self._number = 0
        self._offset = 0.0
        self._within = max(_ANSWER, _WATCHDOGS * rules.watchdog)
        try:
            begun, handle = self._begun()
        except BaseException:
            self._process.kill()  # nothing has reached the wheels
            self._process.join()
            raise
        self._model = begun.model
        self._memory = SharedMemory(handle, begun.scans, begun.frame)

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
        have = (
            self._scan.number if self._scan else -1,
            {name: scan.number for name, scan in self._further.items()},
            self._frame.number if self._frame else -1,
        )
        readings = self._memory.take(readings_of(self._ask("read", have)))
        self._scan = readings.scan or self._scan
        self._further |= {scan.sensor: scan for scan in readings.further}
        self._frame = readings.frame or self._frame
        further = tuple(self._further.values())
        return readings._replace(scan=self._scan, frame=self._frame, further=further)

    def propose(self, proposal: Proposal) -> Passed:
        """Through the gate to the wheels."""
        return passed_of(self._ask("propose", packed_proposal(proposal)))

    def stop(self, reason: str) -> None:
        """Latched, and at once."""
        self._ask("stop", reason)

    def fault(self, reason: str) -> None:
        """Latched, and at once."""
        self._ask("fault", reason)

    def reset(self) -> str:
        """Let go, into IDLE."""
        return self._ask("reset", None)

    def drive(self, mode: GateMode) -> str:
        """Choose who drives."""
        return self._ask("drive", mode)

    def truth(self) -> Any:
        """What only a simulated robot knows."""
        return self._ask("truth", None)

    def record_into(self, end: socket.socket | None) -> None:
        """The recorder's end goes over to the gate process, and is closed here."""
        self._ask("record", None, None if end is None else end.fileno())
        if end is not None:
            end.close()

    def close(self) -> None:
        """The robot is stopped there, and let go when it stands."""
        with contextlib.suppress(OSError, CohelmError):
            self._ask("close", None)
        with contextlib.suppress(OSError):
            self._line.close()
        self._process.join(BRAKING + 2.0)
        if self._process.is_alive():  # it brings the robot to stand as soon as it can
            left_alone(self._process)

    def _ask(self, what: str, with_: Any, handle: int | None = None) -> Any:
        self._number += 1
        try:
            said = self._line.say((self._number, what, with_), handle)
        except OSError as error:
            raise _gone() from error
        if not said:
            raise _silent()
        return self._answer(self._within)

    def _answer(self, within: float) -> Any:
        """The answer to the last request; late ones to those before are of no use any more."""
        end = time.monotonic() + within
        number = -1
        answer: Any = None
        try:
            while number != self._number:
                if not self._line.wait(end - time.monotonic()):
                    raise _silent()
                (number, answer, gate, theirs, then), _ = self._line.hear()
                self._offset = theirs - then
                if gate is not None:
                    self._gate = gate_of(gate)
        except (EOFError, OSError) as error:
            raise _gone() from error
        if isinstance(answer, CohelmError):
            raise answer
        return answer

    def _begun(self) -> tuple[Begun, int]:
        """What the gate process says once it has made the robot."""
        try:
            if not self._line.wait(_START):
                raise CohelmError(
                    f"the robot was not made within {_START:.0f} s: start it again; what has been "
                    "compiled by now is kept"
                )
            begun, handle = self._line.hear()
        except (EOFError, OSError) as error:
            raise _gone() from error
        if isinstance(begun, CohelmError):
            raise begun
        if not isinstance(begun, Begun) or handle is None:
            raise _gone()
        self._gate, self._offset = begun.gate, begun.now - begun.then
        return begun, handle


def _gone() -> CohelmError:
    return CohelmError("the process that keeps the robot is gone; the robot stops by itself")


def _silent() -> CohelmError:
    return CohelmError(
        "the process that keeps the robot does not answer; the robot stops by itself"
    )
