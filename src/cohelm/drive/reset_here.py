"""Lets go of a latched stop where no station drives: asked for on a topic, or in the terminal.

By the page's rule: who asks must have asked after everything that stopped the robot, its readings
must be sound, and nothing moves by that. Asked once more it goes on in the mode of its beginning.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from cohelm.link.messages import Ask, Mode
from cohelm.loop.loop import Loop
from cohelm.robot.gate.modes import driving, latched

if TYPE_CHECKING:
    from cohelm.ros.joy import JoyOperator


class ResetHere:
    """Of one drive; `turn` is called between two periods and takes no time."""

    def __init__(self, mode: Mode, say: Callable[[str], None]) -> None:
        """mode: in which it began to drive. say: hears what became of it."""
        self._mode, self._say = mode, say
        self._asked: deque[tuple[str, float]] = deque(maxlen=1)

    def ask(self, name: str, stamp: float) -> None:
        """Somebody asks, from any thread; of several at once the newest counts. stamp: when, by
        this machine's monotonic clock [s]."""
        self._asked.append((name, stamp))

    def turn(self, loop: Loop, joy: JoyOperator | None = None) -> None:
        """Between two periods. joy: who steers, if it is one on a topic."""
        if self._asked:
            name, stamp = self._asked.popleft()
            self._say(f"{name}: {self._done(loop, name, time.monotonic() - stamp, joy)}")

    def _done(self, loop: Loop, name: str, age: float, joy: JoyOperator | None) -> str:
        """What became of it, in a sentence."""
        gate, supervisor, mode = loop.gated.gate.mode, loop.supervisor, self._mode
        goes_on = f"in {mode.name.lower()} mode"
        if latched(gate):
            refusal = supervisor.request_locally(name, Ask.RESET, age=age)
            if refusal:
                return f"not reset: {refusal}"
            more = "" if mode == Mode.HOLD else f"; once more goes on {goes_on}"
            return f"reset, and it stands{more}"
        if driving(gate):
            return "there is nothing to reset"
        if mode == Mode.HOLD:
            return "there is nothing to reset, and it was to hold"
        refusal = "" if joy is None else joy.problem()
        refusal = refusal or supervisor.request_locally(name, Ask.MODE, mode, age)
        return f"stands: {refusal}" if refusal else f"goes on {goes_on}"
