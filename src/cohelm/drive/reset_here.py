"""Resets a latched stop where no station drives, requested on a topic or in the terminal.

The page's rules hold: the request must be newer than everything that stopped the robot, its
readings must be valid, and nothing moves by it. A second request resumes the mode of the start.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from cohelm.link.messages import Mode, RequestKind
from cohelm.loop.loop import Loop
from cohelm.robot.gate.modes import driving, latched

if TYPE_CHECKING:
    from cohelm.ros.joy import JoyOperator


class ResetHere:
    """Resets of one drive; `turn` is called between two periods and takes no time."""

    def __init__(self, mode: Mode, say: Callable[[str], None]) -> None:
        """mode: in which the drive began. say: shows the result of each request."""
        self._mode, self._say = mode, say
        self._requested: deque[tuple[str, float]] = deque(maxlen=1)

    def ask(self, name: str, stamp: float) -> None:
        """Request a reset, from any thread; of several at once the newest counts. stamp: when, by
        this machine's monotonic clock [s]."""
        self._requested.append((name, stamp))

    def turn(self, loop: Loop, joy: JoyOperator | None = None) -> None:
        """Between two periods. joy: the operator, if that steers by a topic."""
        if self._requested:
            name, stamp = self._requested.popleft()
            self._say(f"{name}: {self._result(loop, name, time.monotonic() - stamp, joy)}")

    def _result(self, loop: Loop, name: str, age: float, joy: JoyOperator | None) -> str:
        """The result of a request, in a sentence."""
        gate, supervisor, mode = loop.gated.gate.mode, loop.supervisor, self._mode
        goes_on = f"in {mode.name.lower()} mode"
        if latched(gate):
            refusal = supervisor.request_locally(name, RequestKind.RESET, age)
            if refusal:
                return f"not reset: {refusal}"
            more = "" if mode == Mode.HOLD else f"; once more continues {goes_on}"
            return f"reset; the robot stands{more}"
        if driving(gate):
            return "there is nothing to reset"
        if mode == Mode.HOLD:
            return "there is nothing to reset, and the drive began in hold"
        refusal = "" if joy is None else joy.problem()
        refusal = refusal or supervisor.request_locally(name, RequestKind.MODE, age, mode)
        return f"stands: {refusal}" if refusal else f"continues {goes_on}"
