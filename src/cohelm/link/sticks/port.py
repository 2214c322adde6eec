"""The port of stick devices: readings and force feedback."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Protocol

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Device


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


class Feel(NamedTuple):
    """Force feedback, as shares of the device's range."""

    spring: float
    """Stiffness of the spring to the centre, in [0, 1] (35)."""
    push: Stick
    """A push on the stick, in [-1, 1], forward and left positive."""


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

    def read(self) -> Reading:
        """The present state. A deflection is always finite and in [-1, 1]."""
        ...

    def feel(self, feel: Feel) -> None:
        """Apply this feedback until the next call; no effect on a device that is gone."""
        ...

    def close(self) -> None:
        """End all effects, and close the device. `read` returns invalid readings after this."""
        ...
