"""Brunner's force sticks (CLS-E, CLS-P), through CLS2Sim on the network.

The device has no spring of its own there: it holds the last force it received, so the spring is
computed here, 100 times a second, from the last known position. Its documentation does not specify
the sign and unit of a force, nor what becomes of the last force when no new one follows. So the
largest force has no default, `trial.py` finds the signs, and `force_watchdog.py` removes the force
when this process dies or hangs.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit

from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Device
from cohelm.link.sticks.cls2sim import PORT, Cls2SimLine, Forces, StickPositions, unit
from cohelm.link.sticks.force import NO_FORCE, ForceRules, Swings, changed, wanted
from cohelm.link.sticks.force_watchdog import ForceWatchdog
from cohelm.link.sticks.port import NOTHING, Feel, Reading, gone
from cohelm.link.udp import resolved

SCHEME = "brunner://"
_STRONGEST = 10_000
_PATIENCE = 2.0  # for the first answer [s]
_POLL = 0.02  # period of requests while no force is due [s]
_SHORTEST = 0.002  # shortest time between two positions for a rate [s]
_SMOOTHING = 0.02  # of the rate [s]
_LAST = 3  # requests without force at the end, as one may be lost
_APART = 0.005  # [s]


class BrunnerParams(NamedTuple):
    """Address of CLS2Sim, and what its documentation leaves open."""

    host: str
    port: int
    force: tuple[float, float]
    """Number for the whole force, elevator and aileron, in CLS2Sim's own unit; negative where a
    positive number pushes towards position 0."""
    forward: int
    """Position of the elevator when the stick is fully forward, 0 or 1."""
    left: int
    """Position of the aileron when it is fully to the left, 0 or 1."""
    damping: float
    """Share of the full force against a full deflection a second [s]."""
    silence: float
    """After this time without an answer the stick is gone [s]."""


def parameters(text: str, pushes: bool = True) -> BrunnerParams:
    """Parse `brunner://HOST[:PORT]?force=N,N&...`. CohelmError for anything else.

    pushes: whether the force is required.
    """
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port or PORT
        given = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    except ValueError:
        host, port, given = None, 0, []
        parts = urlsplit("")
    if not host or parts.path.strip("/") or parts.username is not None or parts.fragment:
        raise CohelmError(f"{text!r} is no force stick, as in brunner://10.0.0.5?force=300")
    options: dict[str, str] = {}
    for key, value in given:
        if key not in OPTIONS:
            hint = did_you_mean(key, OPTIONS)
            raise CohelmError(f"{text}: no option {key!r}: it knows {', '.join(OPTIONS)}{hint}")
        if key in options:
            raise CohelmError(f"{text}: {key} is given twice")
        options[key] = value
    if "force" not in options:
        if pushes:
            raise CohelmError(
                f"{text}: how hard it may push is not given, and has no default: `cohelm stick "
                f"--trial {SCHEME}{host}` finds out which way it pushes; force=0 leaves it limp"
            )
        options["force"] = "0"
    force = options["force"].split(",")
    if len(force) > 2:
        raise CohelmError(f"{text}: force: one number, or two (elevator, aileron)")
    numbers = [_number(text, "force", one, -_STRONGEST, _STRONGEST) for one in force]
    return BrunnerParams(
        host, port, (numbers[0], numbers[-1]), _end(text, options, "forward"),
        _end(text, options, "left"),
        _number(text, "damping", options.get("damping", str(ForceRules().damping)), 0.0, 1.0),
        _number(text, "silence_ms", options.get("silence_ms", "250"), 50.0, 1000.0) / 1e3,
    )  # fmt: skip


class BrunnerStick:
    """One stick, from the first answer to closing.

    It blocks on CLS2Sim when it is opened, closed, or was not read for longer than `silence`: for
    at most two seconds, 50 ms, and `silence`.
    """

    kind = Device.FORCE_STICK
    repeats = False

    def __init__(
        self, params: BrunnerParams, line: Cls2SimLine | None = None,
        watchdog: ForceWatchdog | None = None,
        clock: Callable[[], float] = time.monotonic, wait: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        """clock: steady [s]. Raises CohelmError where nothing answers within two seconds."""
        self.name = f"Brunner stick at {params.host}"
        self.force = any(params.force)
        self._params, self._clock, self._wait = params, clock, wait
        rules = ForceRules(damping=params.damping)
        self._rules = rules._replace(
            fresh=min(rules.fresh, 0.4 * params.silence), gone=min(rules.gone, params.silence)
        )
        self._line = line or Cls2SimLine(params.host, params.port, params.silence)
        self._why = ""
        self._stick, self._rate = CENTRED, CENTRED
        self._swings = Swings()
        self._feel, self._now = NOTHING, NO_FORCE
        self._seen = self._requested = self._unanswered = clock()
        self._answered = True
        if not self._await(_PATIENCE):
            self._line.close()
            raise CohelmError(f"{self.name}: {self._silent()}")
        self._watchdog = watchdog or ForceWatchdog(numeric(params.host, params.port), params.port)

    def read(self) -> Reading:
        """The present state."""
        if not self._why:
            now = self._clock()
            self._look(now)
            if not self._why and now - self._requested >= _POLL:
                self._ask(now)
        if self._why:
            return gone(self.name, self._why)
        return Reading(self._stick, True, "", ())

    def feel(self, feel: Feel) -> None:
        """Compute and send the force, from the last known position."""
        self._feel = feel
        if not self._why:
            now = self._clock()
            self._look(now)
            if not self._why:
                self._ask(now)

    def close(self) -> None:
        """Remove the force, and close. Takes 10 ms: one request may be lost."""
        if self._why != "it is closed":
            self._let_go("it is closed")
            for _ in range(_LAST - 1):
                self._wait(_APART)
                self._line.ask(Forces(0, 0), self._clock())
            self._line.close()
            self._watchdog.close()

    def _await(self, patience: float) -> bool:
        """Send requests without force until an answer arrives; forgets the previous position."""
        self._now = NO_FORCE
        self._line.answers(self._clock())
        end = self._clock() + patience
        while self._clock() < end:
            self._line.ask(Forces(0, 0), self._clock())
            self._wait(_POLL)
            now = self._clock()
            if answers := self._line.answers(now):
                self._take(answers[-1], now)
                self._rate, self._answered = CENTRED, True
                self._requested = now
                return True
        return False

    def _look(self, now: float) -> None:
        """Take the answers received; detect that the stick is gone."""
        silence = self._params.silence
        if now - self._requested > silence:  # this process sent no request
            if not self._await(silence):
                self._let_go(self._silent())
            return
        if answers := self._line.answers(now):
            self._take(answers[-1], now)
            self._answered = True
        if self._swings.too_many(self._stick, now):
            self._let_go(
                "it swings by itself: give it less force, more damping or a faster network"
            )
        elif not self._answered and now - self._unanswered > silence:
            self._let_go(self._silent())

    def _take(self, answer: StickPositions, now: float) -> None:
        forward, left = self._params.forward, self._params.left
        stick = Stick(_share(answer.elevator, forward), _share(answer.aileron, left))
        seen = now - answer.age
        dt = seen - self._seen
        if dt >= _SHORTEST:
            share = dt / (dt + _SMOOTHING)
            x, psi = (stick.x - self._stick.x) / dt, (stick.psi - self._stick.psi) / dt
            self._rate = Stick(
                self._rate.x + share * (x - self._rate.x),
                self._rate.psi + share * (psi - self._rate.psi),
            )
        self._stick, self._seen = stick, max(self._seen, seen)

    def _ask(self, now: float) -> None:
        """Send the force that is due now, and request the position."""
        target = wanted(self._stick, self._rate, self._feel, self._rules.damping)
        self._now = changed(self._now, target, now - self._seen, now - self._requested, self._rules)
        if self._answered:  # the first request since the last answer
            self._answered, self._unanswered = False, now
        self._requested = now
        elevator, aileron = self._params.force
        self._line.ask(
            Forces(
                unit(self._now.share.x * _sign(self._params.forward), elevator),
                unit(self._now.share.psi * _sign(self._params.left), aileron),
            ),
            now,
        )
        if not self._watchdog.beat():
            self._let_go("the process that would remove its force has ended: start it again")

    def _let_go(self, why: str) -> None:
        self._why, self._now = why, NO_FORCE
        for _ in range(_LAST):
            self._line.ask(Forces(0, 0), self._clock())

    def _silent(self) -> str:
        if self._line.refused:
            return (
                f"{self._line.refused} answers that are none of low-level control: is "
                "'Low level control' ('External control') checked in CLS2Sim?"
            )
        return "CLS2Sim does not answer: is it running there, with its remote control over UDP on?"


def _share(position: float, end: int) -> float:
    """Deflection from a position in [0, 1]. end: the position of +1."""
    return _sign(end) * (2.0 * position - 1.0)


def _sign(end: int) -> float:
    return 2.0 * end - 1.0


def numeric(host: str, port: int) -> str:
    """The address of a host. CohelmError where it has none."""
    return resolved(host, port, socket.SOCK_DGRAM)[1][0]


OPTIONS = ("force", "forward", "left", "damping", "silence_ms")


def _number(text: str, key: str, value: str, least: float, most: float) -> float:
    try:
        number = float(value)
    except ValueError:
        number = least - 1.0
    if not least <= number <= most:
        raise CohelmError(f"{text}: {key}: must be in {least:g} ... {most:g}, got {value!r}")
    return number


def _end(text: str, options: dict[str, str], key: str) -> int:
    value = options.get(key, "1")
    if value not in ("0", "1"):
        raise CohelmError(f"{text}: {key}: must be 0 or 1, got {value!r}")
    return int(value)
