"""What a stick offers and takes, whatever it is made of."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Protocol

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Device


class Button(IntEnum):
    """What its first four buttons mean."""

    STOP = 0
    RESET = 1
    MODE = 2
    """Shared, automatic, and back."""
    LEASE = 3
    """Take it, or give it back."""


class Reading(NamedTuple):
    """How the stick stands now."""

    stick: Stick
    """In [-1, 1], forward and left positive; centred, and meaningless, where not valid."""
    valid: bool
    """It is there and works. A stick that has gone is not a stick that is centred."""
    why: str
    """Why it is not valid; empty where it is."""
    pressed: tuple[Button, ...]
    """Buttons that went down since the last reading."""


class Feel(NamedTuple):
    """What the person's hand is to feel, as shares of what the device can."""

    spring: float
    """Stiffness of the spring to the centre, in [0, 1] (35)."""
    push: Stick
    """A push on the stick, in [-1, 1], forward and left positive."""


NOTHING = Feel(0.0, CENTRED)


class StickDevice(Protocol):
    """The port. All calls come from one thread, and none of them waits or raises."""

    @property
    def name(self) -> str:
        """As the device calls itself."""
        ...

    @property
    def kind(self) -> Device:
        """What the robot is told it is."""
        ...

    @property
    def force(self) -> bool:
        """It can push; else it shakes where it would, or does nothing."""
        ...

    def read(self) -> Reading:
        """How it stands now. A deflection is in [-1, 1] and finite, always."""
        ...

    def feel(self, feel: Feel) -> None:
        """Make the person feel this until the next call; a device that is gone feels nothing."""
        ...

    def close(self) -> None:
        """End all effects, and let go. `read` says not valid after this."""
        ...
