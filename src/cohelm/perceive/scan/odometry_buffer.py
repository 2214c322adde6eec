"""Buffer of odometry poses, to look up the pose at the time of a measurement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.achievable import braking_time
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, speeds
from cohelm.robot.port import Odometry, Scan

KEPT = 512
"""Rows of a buffer: ten seconds at 50 Hz, one at 500."""
_AHEAD = 0.5  # largest extrapolation of a pose [s]
_ANEW = 1.0  # stamps that go back by at least this are of odometry that begins anew [s]
_TOP = 50.0  # no robot is faster [m/s, rad/s]
_JUMP = 0.15  # tolerance of an odometry step beyond what the robot's speed explains [m, rad]
GAP = 0.25
"""After so long without odometry the gate brakes [s]: it passes nothing by readings that are older,
and its watchdog runs out."""

EMPTY: Floats = np.empty((0, 6))
"""An empty buffer; rows of stamp, x, y, psi, v, omega, in the order of time."""


def is_new(buffer: Floats, odometry: Odometry) -> bool:
    """Whether `extended` takes a reading."""
    if not all(map(math.isfinite, (odometry.stamp, *odometry.pose, *odometry.twist))):
        return False
    since = odometry.stamp - float(buffer[-1, 0]) if len(buffer) else math.inf
    return since > 0.0 or since <= -_ANEW


class Fastest(NamedTuple):
    """How fast a robot is believed to be."""

    top: Twist
    """The largest twist that odometry is believed to have [m/s, rad/s]."""
    stopping: float
    """From a command to stand until it does, from there [s]."""


ANY_SPEED = Fastest(Twist(math.inf, math.inf), 0.0)
"""Of a robot of which nothing is known."""


def fastest(limits: Limits, delay: float) -> Fastest:
    """Of a robot. delay: from a command to the wheels [s]."""
    top = Twist(*(min(top, _TOP) for top in speeds(limits)))
    return Fastest(top, delay + braking_time(top, limits))


def jump(before: Odometry, after: Odometry, most: Fastest) -> str:
    """By how much odometry has jumped between two readings, as `0.50 m` or `57 deg`; empty: it has
    not. Where it was silent for a while and then begins at exactly its origin, it has."""
    dt = after.stamp - before.stamp
    way = math.hypot(after.pose.x - before.pose.x, after.pose.y - before.pose.y)
    turn = abs(math.remainder(after.pose.psi - before.pose.psi, 2.0 * math.pi))
    anew = dt > GAP and after.pose.x == after.pose.y == 0.0 and way > 0.0
    far, angle = (
        1.5 * _farthest(abs(one), abs(other), top, most.stopping, dt) + _JUMP
        for one, other, top in zip(before.twist, after.twist, most.top, strict=True)
    )
    if way > far or anew:
        return f"{way:.2f} m"
    return f"{math.degrees(turn):.0f} deg" if turn > angle else ""


def _farthest(before: float, after: float, top: float, stopping: float, dt: float) -> float:
    """How far a robot moves at most between two readings with these speeds. After a gap without
    odometry it was stopped, unless it still moved at its end."""
    if dt <= GAP or math.isinf(top):
        return top * max(dt, 0.0)
    gained = top * min(GAP / max(stopping, 1e-9), 1.0)
    began, held = min(max(before, after) + gained, top), min(before, after)
    return min(began * (GAP + 0.5 * stopping) + held * (dt - GAP), top * dt)


def extended(buffer: Floats, odometry: Odometry) -> Floats:
    """The buffer with one more reading, as a new array; one that is not newer, or is NaN, is
    ignored.

    A clock that jumped back by more than a second starts a new buffer.
    """
    if not is_new(buffer, odometry):
        return buffer
    row = (odometry.stamp, *odometry.pose, *odometry.twist)
    kept = buffer[-(KEPT - 1) :]
    if len(buffer) and odometry.stamp <= buffer[-1, 0]:
        kept = EMPTY
    extended_buffer = np.empty((len(kept) + 1, len(row)))
    extended_buffer[:-1], extended_buffer[-1] = kept, row
    return extended_buffer


def is_placeable(buffer: Floats, scan: Scan, beams: int) -> bool:
    """Whether a scan has so many beams, and it is known where the robot was at its last one: the
    buffer goes back to it, and odometry has not been silent for longer than a pose is predicted."""
    end = scan.stamp + scan.duration
    old = len(buffer) == KEPT and end < float(buffer[0, 0])
    known = math.isfinite(end) and not old and end <= float(buffer[-1, 0]) + _AHEAD
    return known and len(scan.ranges) == beams


@jit
def pose_at(buffer: Floats, t: float) -> Pose:
    """The odometry pose at a time: interpolated, or predicted from the last reading.

    Before the first reading it is that one's. The buffer has at least one row.
    """
    last = len(buffer) - 1
    if t >= buffer[last, 0]:
        duration = min(t - buffer[last, 0], _AHEAD)
        pose = Pose(buffer[last, 1], buffer[last, 2], buffer[last, 3])
        return arc(pose, Twist(buffer[last, 4], buffer[last, 5]), duration)
    if t <= buffer[0, 0]:
        return Pose(buffer[0, 1], buffer[0, 2], buffer[0, 3])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if buffer[middle, 0] <= t:
            low = middle
        else:
            high = middle
    share = (t - buffer[low, 0]) / (buffer[high, 0] - buffer[low, 0])
    turn = wrap(buffer[high, 3] - buffer[low, 3])
    return Pose(
        buffer[low, 1] + share * (buffer[high, 1] - buffer[low, 1]),
        buffer[low, 2] + share * (buffer[high, 2] - buffer[low, 2]),
        wrap(buffer[low, 3] + share * turn),
    )
