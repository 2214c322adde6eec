"""A topic (std_msgs/msg/Empty) on which a reset is requested, once."""

from __future__ import annotations

import math
from collections.abc import Callable

from cohelm.robot.gate.gate import Gate
from cohelm.robot.gate.modes import latched
from cohelm.ros.port import End, Qos, Received, Transport

EMPTY = "std_msgs/msg/Empty"
ONCE = Qos(reliable=True, depth=1)
APART = 2.0
"""A message so soon after another one is not a deliberate request [s]."""


def resets(
    transport: Transport, topic: str, reset: Callable[[float], None], log: Callable[[str], None]
) -> End:
    """Subscribes; what is returned ends that. reset: called with the arrival by this machine's
    monotonic clock [s]. log: receives why a message does not count."""
    last, logged = -math.inf, -math.inf

    def on_message(received: Received) -> None:
        nonlocal last, logged
        stamp, before = received.stamp, last
        last = stamp
        if stamp - before > APART:
            if received.message is not None:  # nor bytes that are none
                reset(stamp)
        elif stamp - logged > 10.0 * APART:
            logged = stamp
            log(f"{topic} is published continuously: publish it once (ros2 topic pub --once)")

    return transport.subscribe(topic, EMPTY, ONCE, on_message)


class ResetRequest:
    """The newest request to reset one gate. It counts once, and only for a stop that was known when
    it came: one from before would release what nobody has seen yet."""

    def __init__(self) -> None:
        self._requested = math.nan
        self._why, self._since = "", -math.inf
        """Of the stop or fault that is latched, and since when that is known [s]."""

    def request(self, stamp: float) -> None:
        """From any thread. stamp: when it came, by this machine's monotonic clock [s]."""
        self._requested = stamp

    def due(self, gate: Gate, now: float) -> str | None:
        """Whether to reset now: None: no; why not, or "". now: by the same clock [s]."""
        why = f"{gate.mode.name}: {gate.reason}" if latched(gate.mode) else ""
        if why != self._why:
            self._why, self._since = why, now
        requested, self._requested = self._requested, math.nan
        if math.isnan(requested) or not why:
            return None
        if requested > self._since:
            return ""
        return f"it came before the stop: {gate.reason}"
