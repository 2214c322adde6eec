"""The commands of a controller as they come, and how long the newest of them counts."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import NamedTuple

from cohelm.core.types import Twist
from cohelm.ros.clock import Ticks, seconds
from cohelm.ros.mismatch import STAMPED, TWIST
from cohelm.ros.port import SENSOR, Received, Transport

AHEAD = 0.1
"""A command may be stamped so far in the future [s]: controllers stamp when they like."""
_SWITCHES, _WITHIN = 3, 2.0
"""So many changes of the sender within so long [s] are no controller that replaces another."""
_STILL = Twist(0.0, 0.0)


class Nominal(NamedTuple):
    """What the controller wants now."""

    twist: Twist
    reason: str
    """Why it is a stop, if the controller did not request one; empty otherwise."""
    fresh: bool
    """Whether a controller is there at all."""


class Commands:
    """Of one topic, as Twist or TwistStamped, whichever comes."""

    def __init__(self, transport: Transport, topic: str, timeout: float, clock: Ticks) -> None:
        """timeout: so long after it came, or its stamp, a command counts [s]. clock: of its
        sender."""
        self._topic, self._timeout, self._clock = topic, timeout, clock
        self._arrived = threading.Condition()
        self._count = self._taken = 0
        self._twist: Twist | None = None
        self._came = -math.inf
        self._error = ""
        self.sideways = False
        """Whether a command had a sideways speed, which no differential drive can do."""
        self._sender = ""
        self._switches: deque[float] = deque(maxlen=_SWITCHES)
        """When another sender than before commanded [s]."""
        for kind in (TWIST, STAMPED):
            transport.subscribe(topic, kind, SENSOR, self._on_command)

    @property
    def count(self) -> int:
        """How many have come."""
        return self._count

    def wait(self, seconds: float) -> bool:
        """Waits for a command that `now` has not taken yet, at most so long [s]; whether one
        came."""
        with self._arrived:
            return self._arrived.wait_for(lambda: self._count > self._taken, max(seconds, 0.0))

    def now(self, monotonic: float) -> Nominal:
        """What counts at a time of this machine's monotonic clock [s]."""
        with self._arrived:
            self._taken = self._count
            twist, came, error = self._twist, self._came, self._error
        if not self._count:
            return Nominal(_STILL, f"no command on {self._topic} yet", False)
        age = monotonic - came
        if age > self._timeout:
            return Nominal(_STILL, f"no command on {self._topic} for {age:.1f} s", False)
        if error or twist is None:
            return Nominal(_STILL, error, True)
        return Nominal(twist, "", True)

    def contested(self, monotonic: float) -> bool:
        """Whether several nodes command in turn now, as far as the transport tells senders."""
        with self._arrived:
            switches = tuple(self._switches)
        return len(switches) == _SWITCHES and monotonic - switches[0] < _WITHIN

    def _on_command(self, received: Received) -> None:
        message = received.message
        error, twist = received.damage, None
        if message is not None:
            stamp = 0.0
            if hasattr(message, "header"):
                stamp, message = seconds(message.header.stamp), message.twist
            error = self._late(stamp)
            twist = Twist(float(message.linear.x), float(message.angular.z))
            if not (math.isfinite(twist.v) and math.isfinite(twist.omega)):
                error = error or "the command is not a number"
            self.sideways = self.sideways or message.linear.y != 0.0
        with self._arrived:
            if self._count and received.sender != self._sender:
                self._switches.append(received.stamp)
            self._sender = received.sender
            self._count += 1
            self._twist, self._came, self._error = twist, received.stamp, error
            self._arrived.notify_all()

    def _late(self, stamp: float) -> str:
        """What is wrong with a stamp; 0 is none at all, and the time it came counts."""
        if stamp == 0.0:
            return ""
        age = self._clock.age(stamp)
        if age > self._timeout:
            return f"the command is stamped {age:.1f} s ago"
        if age < -AHEAD:
            return f"the command is stamped {-age:.1f} s in the future: its sender's clock is wrong"
        return ""
