"""The port of stick devices: readings and force feedback."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple, Protocol

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Device, is_centred

_END = 0.98


class Button(IntEnum):
    """Functions of the first four buttons."""

    STOP = 0
    RESET = 1
    MODE = 2
    """Toggle between shared and automatic."""
    LEASE = 3
    """Take the lease, or give it back."""


class Reading(NamedTuple):
    """The present state of the stick."""

    stick: Stick
    """In [-1, 1], forward and left positive; centred, and meaningless, where not valid."""
    valid: bool
    """Whether it is present and works. A stick that is gone is not a centred stick."""
    why: str
    """Why it is not valid; empty where it is."""
    pressed: tuple[Button, ...]
    """Buttons that went down since the last reading."""


def gone(name: str, why: str) -> Reading:
    """The reading of a device of this name that does not work any more."""
    return Reading(CENTRED, False, f"{name}: {why}", ())


class Feel(NamedTuple):
    """Force feedback, as shares of the device's range."""

    spring: float
    """Stiffness of the spring to the centre, in [0, 1] (35)."""
    push: Stick
    """A push on the stick, in [-1, 1], forward and left positive."""


STUCK, STUCK_AT_THE_END = 3.0, 10.0
"""A hand on a deflected stick trembles: without any change for so long it is not held [s]; at the
end of its travel, where the converter saturates, for so long."""


def patience(stick: Stick) -> float:
    """For how long a deflection without any change is believed, where a device that is gone goes on
    giving its last one [s]."""
    if is_centred(stick):
        return math.inf
    return STUCK_AT_THE_END if max(abs(stick.x), abs(stick.psi)) >= _END else STUCK


NOTHING = Feel(0.0, CENTRED)


class StickDevice(Protocol):
    """The port. All calls come from one thread, and none of them waits or raises."""

    @property
    def name(self) -> str:
        """The device's own name."""
        ...

    @property
    def kind(self) -> Device:
        """Kind of device that is reported to the robot."""
        ...

    @property
    def force(self) -> bool:
        """Whether it can push; else it vibrates instead, or does nothing."""
        ...

    @property
    def repeats(self) -> bool:
        """Whether one that is gone may give its last reading for ever, as the receivers of gamepads
        do; not where each reading is an answer of the device itself."""
        ...

    def read(self) -> Reading:
        """The present state. A deflection is always finite and in [-1, 1]."""
        ...

    def feel(self, feel: Feel) -> None:
        """Apply this feedback until the next call; no effect on a device that is gone."""
        ...

    def close(self) -> None:
        """End all effects, and close the device. `read` returns invalid readings after this."""
        ...
