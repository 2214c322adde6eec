"""A joystick on a topic (sensor_msgs/msg/Joy) as the operator's stick, with the parameters of
teleop_twist_joy."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Command, Device
from cohelm.link.operator import NullOperator, OperatorInput, is_current
from cohelm.link.sticks.port import patience
from cohelm.ros import mismatch
from cohelm.ros.clock import Lateness, seconds
from cohelm.ros.port import SENSOR, Received, Transport

JOY = "sensor_msgs/msg/Joy"
_WAITS = 2.0
"""For the first message, before its absence is reported [s]."""
_MOST = 1.01
"""Axes go from -1 to 1."""
_NAMES = {
    "axis_linear.x": "linear", "axis_angular.yaw": "angular", "enable_button": "enable",
    "require_enable_button": "required", "hold_to_run": "hold_to_run",
}  # fmt: skip


class JoyParams(NamedTuple):
    """Which axes and buttons count: by default those that teleop_twist_joy takes."""

    linear: int = 5
    """The axis for fore-aft, forward positive."""
    angular: int = 2
    """The axis for left-right, left positive."""
    enable: int = 5
    """The button..."""
    required: bool = True
    """... without which the stick counts as centred."""
    hold_to_run: bool = False
    """Whether the robot stands in every mode while that is not held."""


def joy_params(pairs: Sequence[str]) -> JoyParams:
    """From `axis_linear.x=1` and the like. CohelmError for what is none of them."""
    made = JoyParams()
    for pair in pairs:
        key, _, value = pair.partition("=")
        if key not in _NAMES:
            meant = did_you_mean(key, _NAMES) or f"; there are {', '.join(_NAMES)}"
            raise CohelmError(f"--joy-param {pair!r}: there is no parameter {key!r}{meant}")
        name, low = _NAMES[key], value.strip().lower()
        if isinstance(getattr(made, name), bool):
            if low not in ("true", "false"):
                raise CohelmError(f"--joy-param {pair!r}: give true or false")
            made = made._replace(**{name: low == "true"})
        elif low.isdecimal():
            made = made._replace(**{name: int(low)})
        else:
            raise CohelmError(f"--joy-param {pair!r}: give the number of an axis or button, from 0")
    return made


class JoyOperator(NullOperator):
    """A joystick on a topic as operator. It chooses no mode and requests nothing else: it only
    steers."""

    def __init__(
        self, transport: Transport, topic: str, params: JoyParams,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """clock: by which messages are stamped [s]."""
        self.topic, self.params, self._clock = topic, params, clock
        self._lock = threading.Lock()
        self._came = self._changed = -math.inf
        """When the newest message came, and when one differed from that before [s]."""
        self._sender, self._lateness, self._late = "", Lateness(), 0.0
        """Of the newest message: how late it came, compared with the fastest of its sender [s]."""
        self._damage = ""
        """What was wrong with the bytes that came last."""
        self._newest: tuple[tuple[float, ...], tuple[int, ...]] = ((), ())
        """Axes and buttons."""
        self._transport = transport
        self._end = transport.subscribe(topic, JOY, SENSOR, self._on_joy)

    def watches(self, clock: Callable[[], float]) -> None:
        """It goes by the wall's time."""

    def nothing_received(self) -> str:
        """Why no message has been received, in a sentence, after a while of waiting; empty: one
        has."""
        end = time.monotonic() + _WAITS
        while time.monotonic() < end:
            if self._came > -math.inf:
                return ""
            time.sleep(0.02)
        return mismatch.nothing_received(
            self.topic, JOY, SENSOR, "--joy", self._transport.endpoints()
        )

    def receive(self) -> OperatorInput:
        """The stick, as it is now."""
        reading, why = self._read(), self.problem()
        stick = CENTRED if isinstance(reading, str) else reading
        command = Command(stick, not isinstance(reading, str), True, Device.GAMEPAD)
        age = self._age()
        if not math.isfinite(age):
            return OperatorInput(1, self.topic, None, math.nan, 0.0, (), why=why)
        return OperatorInput(1, self.topic, command, age, 0.0, (), why=why)

    def problem(self) -> str:
        """Why there is no stick, in a sentence; empty: there is one."""
        age, silent = self._age(), self._clock() - self._came
        if not is_current(age):
            if self._damage:
                return f"{self.topic}: what comes can not be read ({self._damage})"
            if is_current(silent):
                return f"{self.topic}: comes {age:.1f} s late, by its stamps"
            return f"{self.topic}: " + (
                f"silent for {silent:.1f} s" if math.isfinite(silent) else "nothing is received"
            )
        reading = self._read()
        return f"{self.topic}: {reading}" if isinstance(reading, str) else ""

    def held(self) -> bool:
        """Whether there is a stick, and its button is held."""
        with self._lock:
            buttons = self._newest[1]
        return not self.problem() and bool(buttons[self.params.enable])

    def close(self) -> None:
        """Receive no more."""
        self._end()

    def _age(self) -> float:
        """Of the newest message, since it was stamped, as far as that can be known [s]."""
        with self._lock:
            return self._clock() - self._came + self._late

    def _read(self) -> Stick | str:
        """Its deflection, or why there is none."""
        with self._lock:
            (axes, buttons), changed = self._newest, self._changed
        params = self.params
        if max(params.linear, params.angular) >= len(axes):
            key, value = max(("axis_linear.x", params.linear), ("axis_angular.yaw", params.angular),
                             key=lambda pair: pair[1])  # fmt: skip
            return f"it has {len(axes)} axes, and {key} is {value}: choose it with --joy-param"
        needed = params.required or params.hold_to_run
        if needed and params.enable >= len(buttons):
            return (
                f"it has {len(buttons)} buttons, and enable_button is {params.enable}: choose it "
                "with --joy-param"
            )
        x, psi = axes[params.linear], axes[params.angular]
        if not (abs(x) <= _MOST and abs(psi) <= _MOST):  # nor for NaN
            return f"its axes are {x:g} and {psi:g}, and go from -1 to 1: fix its driver"
        if needed and not buttons[params.enable]:
            return CENTRED
        most = patience(Stick(x, psi))
        if self._clock() - changed > most:
            return f"it is deflected, and nothing of it has changed for {most:g} s"
        return Stick(min(max(x, -1.0), 1.0), min(max(psi, -1.0), 1.0))

    def _on_joy(self, received: Received) -> None:
        message: Any = received.message
        self._damage = received.damage if message is None else ""
        if message is None:
            return
        newest = (
            tuple(float(value) for value in message.axes),
            tuple(int(value) for value in message.buttons),
        )
        with self._lock:
            self._came = self._clock()
            if received.sender != self._sender:
                self._sender, self._lateness = received.sender, Lateness()
            self._late = self._lateness.update(seconds(message.header.stamp), self._came)
            if repr(newest) != repr(self._newest):  # NaN is equal to itself so
                self._newest, self._changed = newest, self._came
