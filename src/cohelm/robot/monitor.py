"""Monitors: they watch the robot in the gate process, and may slow or stop it.

A monitor sees the raw readings, not what the loop made of them. It never adds motion: it passes a
share of the proposed twist, or faults the gate, with a reason.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from cohelm.core.types import Twist
from cohelm.robot.port import Readings


class Restriction(NamedTuple):
    """How a monitor restricts a motion."""

    share: float = 1.0
    """Share of the proposed twist that may pass, in [0, 1]: same arc, lower speed."""
    reason: str = ""
    """Why it is restricted; empty where it is not."""
    fault: bool = False
    """Whether the gate latches a fault."""
    limit: float = math.inf
    """The speed limit that is in force, whether the motion is slower or not [m/s]..."""
    limit_reason: str = ""
    """... and its reason."""


UNRESTRICTED = Restriction()


class Monitor(Protocol):
    """One monitor. All calls come from one thread, take no time and raise nothing."""

    def observe(
        self, now: float, readings: Readings, applied: Twist, stopped: bool = False
    ) -> Restriction:
        """Called at every reading; the restriction holds for every twist until the next one.

        now: the robot's clock [s]. applied: the twist sent to the wheels last. stopped: they were
        sent a stop instead, and may brake harder than `applied` falls.
        """
        ...

    def restrict(self, now: float, twist: Twist) -> Restriction:
        """The restriction of a twist that is about to be sent."""
        ...


def strictest(restrictions: list[Restriction]) -> Restriction:
    """The strictest of several: a fault before all, else the least share."""
    return min(restrictions, key=lambda r: (not r.fault, r.share), default=UNRESTRICTED)
