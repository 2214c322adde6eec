"""Whom the robot listens to, and what may change that. docs/gate.md has the drawing."""

from __future__ import annotations

from enum import IntEnum


class GateMode(IntEnum):
    """Only AUTOMATIC and SHARED let the wheels turn."""

    IDLE = 0
    """Stands, and waits for somebody to choose."""
    AUTOMATIC = 1
    """The controller drives."""
    SHARED = 2
    """A person drives, alone or with the controller."""
    STOPPED = 3
    """Somebody, or a rule, said stop. Latched."""
    FAULTED = 4
    """Something is broken or late. Latched."""


def driving(mode: GateMode) -> bool:
    """Whether the wheels may turn."""
    return mode in (GateMode.AUTOMATIC, GateMode.SHARED)


def latched(mode: GateMode) -> bool:
    """Whether only a deliberate reset leads out of it."""
    return mode in (GateMode.STOPPED, GateMode.FAULTED)
