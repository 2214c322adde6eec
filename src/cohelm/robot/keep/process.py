"""The loop's side of the gate process, which holds robot and gate.

Both exchange small messages over a non-blocking `control` line; scans and frames go by
`shared_memory`. The other side is in `serve`.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.robot.clock import sleep_until
from cohelm.robot.gate.gate import Gate, GateRules, Passed, Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.control_line import control
from cohelm.robot.keep.gated_robot import LocalGatedRobot
from cohelm.robot.keep.processes import (
    detach,
    end_group,
    how_ended,
    resume,
    start_process,
    stopped,
)
from cohelm.robot.keep.serve import BRAKING, CLOSING, Begun, serve
from cohelm.robot.keep.shared_memory import SharedMemory
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Readings, RobotPort, Scan

_START = 600.0  # time for making the robot, compiling included [s]
_ANSWER = 2.0  # time for an answer; then the gate process counts as gone [s]
_LAST = 1.0  # time between its last word and its end [s]
_ALONE = "the robot must stop by its own time-out: look at it"
_WATCHDOGS = 10.0  # ... or this many times the watchdog's time, if that is longer

Make = Callable[[], RobotPort]


class RemoteGatedRobot:
    """A `LocalGatedRobot` in another process, as the loop has it. In real time only; of the calls
    only `wait` takes time."""

    def __init__(
        self, make: Make, rules: GateRules, record: socket.socket | None = None,
        live: socket.socket | None = None,
    ) -> None:  # fmt: skip
        """make: makes the robot in the other process; must be picklable; `driver` names what by.
        record, live: event sinks.

        Raises CohelmError if the robot can not be made.
        """
        self._line, theirs = control()
        self._process = start_process("cohelm gate", serve, theirs, make, rules, record, live)
        theirs.close()
        self._scan: Scan | None = None
        self._further: dict[str, Scan] = {}
        self._frame: Frame | None = None
        self._gate = Gate()
        self._number = 0
        self._offset = 0.0
        self._within = max(_ANSWER, _WATCHDOGS * rules.watchdog)
        try:
            begun, handle = self._begun(getattr(make, "driver", "the robot"))
        except BaseException:
            self._process.kill()  # nothing has reached the wheels
            self._process.join()
            end_group(self.pid)
            self._line.close()
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
        """The robot's clock, extrapolated from the last answer with this machine's."""
        return time.monotonic() + self._offset

    def wait(self, until: float) -> None:
        """Sleep."""
        sleep_until(until, self.now)

    def read(self) -> Readings:
        """The newest of everything; each scan and frame is transferred once."""
        have = (
            self._scan.number if self._scan else -1,
            {name: scan.number for name, scan in self._further.items()},
            self._frame.number if self._frame else -1,
        )
        readings = self._memory.take(self._ask("read", *have))
        self._scan = readings.scan or self._scan
        self._further |= {scan.sensor: scan for scan in readings.further}
        self._frame = readings.frame or self._frame
        further = tuple(self._further.values())
        return readings._replace(scan=self._scan, frame=self._frame, further=further)

    def draw_at(self, rate: float) -> None:
        """As `LocalGatedRobot.draw_at`."""
        self._ask("draw_at", rate)

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
        """Clear a stop or fault, into IDLE."""
        return self._ask("reset")

    def drive(self, mode: GateMode) -> str:
        """Set the gate's mode."""
        return self._ask("drive", mode)

    def truth(self) -> Any:
        """Ground truth of a simulated robot; None for any other."""
        return self._ask("truth")

    def record_into(self, end: socket.socket | None) -> None:
        """The recorder's end is passed to the gate process, and closed here."""
        self._ask("record_into", handle=None if end is None else end.fileno())
        if end is not None:
            end.close()

    def close(self) -> None:
        """Stop the robot; the gate process closes it once it stands."""
        resume(self._process)
        with contextlib.suppress(OSError, CohelmError):
            self._ask("close")
        with contextlib.suppress(OSError):
            self._line.close()
        self._process.join(BRAKING + CLOSING + 1.0)
        if self._process.is_alive():  # it brings the robot to stand as soon as it can
            detach(self._process)
        else:
            end_group(self.pid)

    def _ask(self, what: str, *with_: Any, handle: int | None = None) -> Any:
        """Have a method of `LocalGatedRobot` called there; what it returns."""
        self._number += 1
        try:
            taken = self._line.send((self._number, what, with_), handle)
        except OSError as error:
            raise self._gone() from error
        if not taken:
            raise self._silent()
        return self._answer(self._within)

    def _answer(self, within: float) -> Any:
        """The answer to the last request; late answers to earlier ones are discarded."""
        end = time.monotonic() + within
        number = -1
        answer: Any = None
        try:
            while number != self._number:
                if not self._line.wait(end - time.monotonic()):
                    raise self._silent()
                (number, answer, gate, theirs, then), _ = self._line.receive()
                self._offset = theirs - then
                if gate is not None:
                    self._gate = gate
        except (EOFError, OSError) as error:
            raise self._gone() from error
        if isinstance(answer, CohelmError):
            raise answer
        return answer

    def _silent(self) -> CohelmError:
        if stopped(self._process):
            return CohelmError(
                "the gate process does not answer: it was stopped (SIGSTOP), and is continued now "
                "to stop the robot"
            )
        call = self._memory.called
        why = f"{call} of the robot's driver waits" if call else "this computer is too slow"
        return CohelmError(f"the gate process does not answer: {why}; {_ALONE}")

    def _gone(self, then: str = f"; {_ALONE}") -> CohelmError:
        how = how_ended(self._process, _LAST)
        return CohelmError(f"the gate process has ended{how and f' ({how})'}{then}")

    def _begun(self, driver: str) -> tuple[Begun, int]:
        """The gate process's first message, once it has made the robot."""
        try:
            if not self._line.wait(_START):
                raise CohelmError(
                    f"the robot was not made within {_START:.0f} s: start it again; what has been "
                    "compiled by now is kept"
                )
            begun, handle = self._line.receive()
        except (EOFError, OSError) as error:
            alone = f" while it made {driver}: run that alone, with python -X faulthandler"
            raise self._gone(alone) from error
        if isinstance(begun, CohelmError):
            raise begun
        if not isinstance(begun, Begun) or handle is None:
            raise self._gone()
        self._gate, self._offset = begun.gate, begun.now - begun.then
        return begun, handle


GatedRobot = LocalGatedRobot | RemoteGatedRobot
"""The robot as the loop has it: one thread calls it, and only `wait` takes time."""
