"""The messages between loop and gate process in every period, as plain tuples of numbers.

Unpickling a class looks up its name every time; at a hundred messages a second that would be most
of the work.
"""

from __future__ import annotations

from typing import Any

from cohelm.core.types import Pose, Twist
from cohelm.robot.gate.gate import Gate, Passed, Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.port import Health, Odometry, Readings


def packed_gate(gate: Gate) -> tuple[Any, ...]:
    """A gate's state as a tuple."""
    return (int(gate.mode), gate.reason, *gate.out, *gate[3:])


def gate_of(packed: tuple[Any, ...]) -> Gate:
    """Inverse of `packed_gate`."""
    mode, reason, v, omega, *rest = packed
    return Gate(GateMode(mode), reason, Twist(v, omega), *rest)


def packed_proposal(proposal: Proposal) -> tuple[Any, ...]:
    """A proposal as a tuple."""
    return (proposal.sequence, proposal.stamp, *proposal.twist)


def proposal_of(packed: tuple[Any, ...]) -> Proposal:
    """Inverse of `packed_proposal`."""
    sequence, stamp, v, omega = packed
    return Proposal(sequence, stamp, Twist(v, omega))


def packed_passed(passed: Passed) -> tuple[Any, ...]:
    """The result of a proposal as a tuple."""
    return (*passed.out, passed.reason)


def passed_of(packed: tuple[Any, ...]) -> Passed:
    """Inverse of `packed_passed`."""
    v, omega, reason = packed
    return Passed(Twist(v, omega), reason)


def packed_readings(readings: Readings) -> tuple[Any, ...]:
    """Readings as a tuple; scans, frames and contacts, which are rarer, as they are."""
    odometry, scan, frame, health, *rest = readings
    moved = None if odometry is None else (odometry.stamp, *odometry.pose, *odometry.twist)
    return (moved, None if health is None else tuple(health), scan, frame, *rest)


def readings_of(packed: tuple[Any, ...]) -> Readings:
    """Inverse of `packed_readings`."""
    moved, health, scan, frame, *rest = packed
    odometry = None
    if moved is not None:
        stamp, x, y, psi, v, omega = moved
        odometry = Odometry(stamp, Pose(x, y, psi), Twist(v, omega))
    return Readings(odometry, scan, frame, None if health is None else Health(*health), *rest)
