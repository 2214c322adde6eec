"""Which motions are needed to measure a robot, and how much free floor they take.

Straights and turns on the spot only: one wheel speed in each, so that what is seen has one cause.
A ring of small turns shows where the LiDAR is mounted; fast straights and half turns, ended by the
gate's ramp and by `stop` in turn, show delay, lag, acceleration and braking.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.frames import placed
from cohelm.core.types import Floats, Twist
from cohelm.robot.limits import ramps, speeds
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Scan

PLATEAU = 0.6
"""A speed is held for so long, to see that it is reached [s]."""
_MARGIN = 0.3  # left free around what is driven [m]
_LATE = 0.3  # a robot may take so long to obey [s]
_DEFAULT_SPEED, _DEFAULT_TURN = 0.5, 1.0  # where a model gives no limit [m/s, rad/s]
_RING = 8  # small turns in a circle
_LEGS = 8
_SLOWEST = 0.1  # a floor for less measures nothing [m/s]


class Segment(NamedTuple):
    """One motion from rest to rest."""

    twist: Twist
    """The commanded twist; one of the two is 0."""
    hold: float
    """For so long [s]; twist times hold is where it goes."""
    hard: bool
    """Whether it ends by a stop, and not by the gate's ramp."""
    legs: int = 0
    """Straights driven before: a half turn after an odd number of them leads back."""


class Excitation(NamedTuple):
    """All motions, in their order, and what they need."""

    segments: tuple[Segment, ...]
    speed: float
    """Of the fastest straight [m/s]."""
    turn: float
    """Of the fastest turn [rad/s]."""
    length: float
    """Free floor ahead of the body's origin [m]."""
    radius: float
    """Free floor around it at both ends [m]."""
    seconds: float
    """What it takes, about [s]."""


def excitation(model: RobotModel, floor: float = 4.0) -> Excitation:
    """The motions for a robot, as fast as its model and `floor` [m] ahead of it allow.

    The floor is reckoned with half of the braking that the model assumes: that is what is to be
    measured. Raises CohelmError where the floor is too short for anything.
    """
    limits = model.bounds()
    fastest, turning = speeds(limits)
    rising, spinning = ramps(limits)
    room = floor - model.reach - _MARGIN
    late = _LATE + model.delay_s + PLATEAU
    # room = v late + v²/2a up + v²/a down
    half = 1.5 / rising
    fits = room / late if half == 0.0 else (math.sqrt(late**2 + 4.0 * half * room) - late) / (
        2.0 * half
    ) if room > 0.0 else 0.0  # fmt: skip
    speed = min(fastest if fastest < math.inf else _DEFAULT_SPEED, fits)
    if not speed >= _SLOWEST:
        raise CohelmError(
            f"{floor:g} m of free floor are too few for {model.name}: it needs at least "
            f"{_needed(model, _SLOWEST, rising):.1f} m ahead"
        )
    turn = turning if turning < math.inf else _DEFAULT_TURN
    # a half turn: pi = w²/alpha + w plateau
    turn = min(turn, (math.sqrt(0.16 + 4.0 * math.pi / spinning) - 0.4) * spinning / 2.0
               if spinning < math.inf else turn)  # fmt: skip
    segments: list[Segment] = []
    ring = 2.0 * math.pi / _RING
    small = min(turn, 0.5 * math.sqrt(ring * spinning) if spinning < math.inf else turn)
    for side in (1.0, -1.0):
        segments += [Segment(Twist(0.0, side * small), ring / small, False)] * _RING
    way = speed * PLATEAU + speed * speed / rising
    for leg in range(_LEGS):
        share = 1.0 if leg % 2 == 0 else 0.6
        hard = leg % 4 < 2
        segments.append(Segment(Twist(share * speed, 0.0), way / (share * speed), hard, leg))
        side = 1.0 if leg % 4 in (0, 3) else -1.0
        segments.append(Segment(Twist(0.0, side * turn), math.pi / turn, leg % 4 < 2, leg + 1))
    return Excitation(
        tuple(segments), speed, turn, _needed(model, speed, rising), model.reach + _MARGIN,
        sum(s.hold + 1.6 for s in segments) + 3.0,
    )  # fmt: skip


def _needed(model: RobotModel, speed: float, rising: float) -> float:
    late = _LATE + model.delay_s + PLATEAU
    return speed * late + 1.5 * speed * speed / rising + model.reach + _MARGIN


def on_the_floor(model: RobotModel, scan: Scan, plan: Excitation) -> str:
    """What a scan shows within the free floor, a sentence; empty where there is nothing."""
    if model.lidar is None:
        return ""
    lidar = model.lidar.lidar()
    points = placed(scan_points(scan.ranges, lidar.beams), lidar.mount)
    r = np.hypot(points[:, 0], points[:, 1])
    inside = (r > 0.0) & (r < plan.radius)
    inside |= (points[:, 0] > 0) & (points[:, 0] < plan.length) & (abs(points[:, 1]) < plan.radius)
    if not inside.any():
        return ""
    nearest = points[inside][r[inside].argmin()]
    return (
        f"there is something {nearest[0]:.2f} m ahead and {abs(nearest[1]):.2f} m to the "
        f"{'left' if nearest[1] >= 0 else 'right'}, within the free floor: {plan.length:.1f} m "
        f"ahead and {plan.radius:.1f} m to either side are needed; clear it, or give --floor"
    )


def scan_points(ranges: Floats, beams: Floats) -> Floats:
    """Returns of a scan, (m, 2) [m], in the LiDAR's frame."""
    seen = np.isfinite(ranges)
    return ranges[seen, None] * beams[seen]
