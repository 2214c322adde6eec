"""What watches the robot beside the gate, in the gate process, and may slow or stop it.

A monitor sees what the robot itself reads, not what the loop made of it. It never adds motion: it
allows a share of what is proposed, or faults the gate, and says why.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from cohelm.core.types import Twist
from cohelm.robot.port import Readings


class Restriction(NamedTuple):
    """What a monitor has against a motion."""

    share: float = 1.0
    """Of the proposed twist, so much may pass, in [0, 1]: the arc stays, the speed falls."""
    reason: str = ""
    """Why less than all may; empty where nothing is restricted."""
    fault: bool = False
    """Whether the gate latches a fault."""


UNRESTRICTED = Restriction()


class Monitor(Protocol):
    """One watch. All calls come from one thread, take no time and raise nothing."""

    def observe(
        self, now: float, readings: Readings, applied: Twist, stopped: bool = False
    ) -> Restriction:
        """At every reading. now: the robot's clock [s]. applied: what the wheels were sent last.
        stopped: they were sent a stop instead, and may brake harder than `applied` falls.

        What is restricted here holds for every twist until the next reading.
        """
        ...

    def restrict(self, now: float, twist: Twist) -> Restriction:
        """Of a twist that is about to be sent."""
        ...


def strictest(restrictions: list[Restriction]) -> Restriction:
    """Of several: a fault before all, else the least share."""
    return min(restrictions, key=lambda r: (not r.fault, r.share), default=UNRESTRICTED)
