"""What loop and gate process tell each other in every period, as plain tuples of numbers.

A class goes over the control line by its name, which is looked up for each one that comes: of what
travels a hundred times a second that is most of the work.
"""

from __future__ import annotations

from typing import Any

from cohelm.core.types import Pose, Twist
from cohelm.robot.gate.gate import Gate, Passed, Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.port import Health, Odometry, Readings


def packed_gate(gate: Gate) -> tuple[Any, ...]:
    """A gate's state."""
    return (int(gate.mode), gate.reason, *gate.out, *gate[3:])


def gate_of(told: tuple[Any, ...]) -> Gate:
    """What `packed_gate` was given."""
    mode, reason, v, omega, *rest = told
    return Gate(GateMode(mode), reason, Twist(v, omega), *rest)


def packed_proposal(proposal: Proposal) -> tuple[Any, ...]:
    """A proposal."""
    return (proposal.sequence, proposal.stamp, *proposal.twist)


def proposal_of(told: tuple[Any, ...]) -> Proposal:
    """What `packed_proposal` was given."""
    sequence, stamp, v, omega = told
    return Proposal(sequence, stamp, Twist(v, omega))


def packed_passed(passed: Passed) -> tuple[Any, ...]:
    """What became of a proposal."""
    return (*passed.out, passed.reason)


def passed_of(told: tuple[Any, ...]) -> Passed:
    """What `packed_passed` was given."""
    v, omega, reason = told
    return Passed(Twist(v, omega), reason)


def packed_readings(readings: Readings) -> tuple[Any, ...]:
    """Readings; scans, frames and contacts, which come more seldom, as they are."""
    odometry, scan, frame, health, *rest = readings
    moved = None if odometry is None else (odometry.stamp, *odometry.pose, *odometry.twist)
    return (moved, None if health is None else tuple(health), scan, frame, *rest)


def readings_of(told: tuple[Any, ...]) -> Readings:
    """What `packed_readings` was given."""
    moved, health, scan, frame, *rest = told
    odometry = None
    if moved is not None:
        stamp, x, y, psi, v, omega = moved
        odometry = Odometry(stamp, Pose(x, y, psi), Twist(v, omega))
    return Readings(odometry, scan, frame, None if health is None else Health(*health), *rest)
