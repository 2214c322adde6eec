"""Finds the signs of a Brunner stick's positions and forces, which are not documented.

A spring with the wrong sign pushes the stick to its end, and the robot with it. So each axis is
pushed alone, both ways, with a rising force, until it moves a little.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

from cohelm.core.errors import CohelmError
from cohelm.link.sticks.brunner_stick import SCHEME, numeric, parameters
from cohelm.link.sticks.cls2sim import PORT, Cls2SimLine, Forces
from cohelm.link.sticks.force_watchdog import ForceWatchdog
from cohelm.link.udp import bracketed

_PERIOD = 0.01  # [s]
_SILENCE = 1.0  # [s]
_PATIENCE = 60.0  # longest wait for the operator [s]
_AWAY, _HELD = 0.3, 0.5  # distance from the middle, and how long it is held [s]
_MIDDLE, _STILL, _REST = 0.1, 0.01, 1.0  # distance from the middle, motion at rest, and time [s]
_RISE = 100.0  # [unit/s]
_MOVED = 0.03
_AMPLE = 4.0  # full force over the force that moves it


def run(
    text: str, strongest: float, say: Callable[[str], None],
    line: Cls2SimLine | None = None, watchdog: ForceWatchdog | None = None,
    clock: Callable[[], float] = time.monotonic, wait: Callable[[float], None] = time.sleep,
) -> str:  # fmt: skip
    """Guide the operator through the trial; returns the argument of --device.

    strongest: largest force, in CLS2Sim's unit. Raises CohelmError where it fails.
    """
    params = parameters(text, pushes=False)
    address = (numeric(params.host, params.port), params.port) if line is None else ("", 0)
    line = line or Cls2SimLine(*address, 0.5)
    watchdog = watchdog or ForceWatchdog(*address)
    trial = _Trial(line, watchdog, say, clock, wait)
    try:
        forward = trial.end(0, "forward")
        left = trial.end(1, "to the left")
        say("bring it to the middle, and take your hand away; if it falls over, hold it loosely")
        elevator = trial.push(0, strongest)
        aileron = trial.push(1, strongest)
    finally:
        for _ in range(3):
            line.ask(Forces(0, 0), clock())
            wait(0.005)
        line.close()
        watchdog.close()
    ample = min(max(map(abs, (elevator, aileron))) * _AMPLE, 10_000.0)
    force = [round(math.copysign(math.ceil(ample / 10.0) * 10.0, n)) for n in (elevator, aileron)]
    host = bracketed(params.host)
    port = "" if params.port == PORT else f":{params.port}"
    return f"{SCHEME}{host}{port}?force={force[0]},{force[1]}&forward={forward}&left={left}"


class _Trial:
    def __init__(
        self, line: Cls2SimLine, watchdog: ForceWatchdog, say: Callable[[str], None],
        clock: Callable[[], float], wait: Callable[[float], None],
    ) -> None:  # fmt: skip
        self._line, self._watchdog, self._say = line, watchdog, say
        self._clock, self._wait = clock, wait
        self._answered = clock()

    def end(self, axis: int, where: str) -> int:
        """The end at which the axis is held, 0 or 1; the other axis may be missing."""
        self._say("hold the stick in the middle")  # from there it falls to no end by itself
        self._middle()
        self._say(f"hold it fully {where}")
        since, last = math.inf, -1
        for now, at in self._positions(lambda: Forces(0, 0), _PATIENCE):
            away = abs(at[axis] - 0.5) > _AWAY and abs(at[axis] - 0.5) > abs(at[1 - axis] - 0.5)
            end = int(at[axis] > 0.5) if away else -1
            if end != last:
                since, last = now, end
            if end >= 0 and now - since >= _HELD:
                return end
        raise CohelmError(
            f"the {_NAMES[axis]} was not moved: is that axis there, and is it the one that moves?"
        )

    def _middle(self) -> None:
        since = math.inf
        for now, at in self._positions(lambda: Forces(0, 0), _PATIENCE):
            since = min(since, now) if max(abs(a - 0.5) for a in at) <= _MIDDLE else math.inf
            if now - since >= _HELD:
                return
        raise CohelmError("the stick was not held in the middle of its travel")

    def push(self, axis: int, strongest: float) -> float:
        """The force that moves the axis; negative if a positive number moves it towards 0."""
        up = self._moved(axis, 1, strongest)
        down = self._moved(axis, -1, strongest)
        if up * down > 0.0:
            raise CohelmError(
                f"the {_NAMES[axis]} moved the same way, whichever way it was pushed: it falls "
                f"over, or a hand moved it; hold it loosely and begin again"
            )
        return math.copysign(max(abs(up), abs(down)), up)

    def _moved(self, axis: int, way: int, strongest: float) -> float:
        """The force at which it moved; negative if it moved towards 0."""
        start = self._rest()
        self._say(f"pushing the {_NAMES[axis]}, softly at first")
        begun = self._clock()

        def force() -> Forces:
            number = way * round(min((self._clock() - begun) * _RISE, strongest))
            return Forces(number, 0) if axis == 0 else Forces(0, number)

        for _, at in self._positions(force, strongest / _RISE + 1.0):
            if abs(at[axis] - start[axis]) >= _MOVED:
                number = max(1.0, abs(force()[axis]))
                self._line.ask(Forces(0, 0), self._clock())
                return math.copysign(number, at[axis] - start[axis])
        raise CohelmError(
            f"the {_NAMES[axis]} did not move, pushed with {strongest:g}: is it checked as active "
            f"in CLS2Sim, and is the stick ready? --strongest allows more"
        )

    def _rest(self) -> tuple[float, float]:
        """The position, once it is at rest near the middle."""
        since, first = self._clock(), (9.0, 9.0)
        for now, at in self._positions(lambda: Forces(0, 0), _PATIENCE):
            still = max(abs(a - b) for a, b in zip(at, first, strict=True)) < _STILL
            if not still or max(abs(a - 0.5) for a in at) > _MIDDLE:
                since, first = now, at
            elif now - since >= _REST:
                return at
        raise CohelmError("the stick did not come to rest in the middle: hold it there loosely")

    def _positions(
        self, force: Callable[[], Forces], patience: float
    ) -> Iterator[tuple[float, tuple[float, float]]]:
        end = self._clock() + patience
        self._answered = self._clock()
        while self._clock() < end:
            self._line.ask(force(), self._clock())
            if not self._watchdog.beat():
                raise CohelmError("the process that would remove its force has ended")
            self._wait(_PERIOD)
            now = self._clock()
            if answers := self._line.answers(now):
                self._answered = now
                yield now, (answers[-1].elevator, answers[-1].aileron)
            elif now - self._answered > _SILENCE:
                raise CohelmError("CLS2Sim does not answer: see docs/sticks.md for what to set")


_NAMES = ("elevator (fore-aft)", "aileron (left-right)")
