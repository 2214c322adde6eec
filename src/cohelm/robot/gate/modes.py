"""The gate's modes. docs/gate.md has the state diagram."""

from __future__ import annotations

from enum import IntEnum


class GateMode(IntEnum):
    """Only AUTOMATIC and SHARED let the wheels turn."""

    IDLE = 0
    """Stands, until a driving mode is chosen."""
    AUTOMATIC = 1
    """The controller drives."""
    SHARED = 2
    """A person drives, alone or with the controller."""
    STOPPED = 3
    """Stopped, by a person or a rule. Latched."""
    FAULTED = 4
    """Something is broken or late. Latched."""


def driving(mode: GateMode) -> bool:
    """Whether the wheels may turn."""
    return mode in (GateMode.AUTOMATIC, GateMode.SHARED)


def latched(mode: GateMode) -> bool:
    """Whether only a deliberate reset leads out of it."""
    return mode in (GateMode.STOPPED, GateMode.FAULTED)
