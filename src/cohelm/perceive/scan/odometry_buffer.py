"""Buffer of odometry poses, to look up the pose at the time of a measurement."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import is_finite, wrap
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, speeds
from cohelm.robot.port import Odometry

KEPT = 512
"""Rows of a buffer: ten seconds at 50 Hz, one at 500."""
_AHEAD = 0.5  # largest extrapolation of a pose [s]
_ANEW = 1.0  # stamps that go back by at least this are of odometry that begins anew [s]
_TOP = 50.0  # no robot is faster [m/s, rad/s]
JUMP = 0.15
"""Tolerance of an odometry step beyond what the robot's speed explains [m, rad]."""

EMPTY: Floats = np.empty((0, 6))
"""An empty buffer; rows of stamp, x, y, psi, v, omega, in the order of time."""


def is_new(buffer: Floats, odometry: Odometry) -> bool:
    """Whether `extended` takes a reading."""
    if not all(map(math.isfinite, (odometry.stamp, *odometry.pose, *odometry.twist))):
        return False
    since = odometry.stamp - float(buffer[-1, 0]) if len(buffer) else math.inf
    return since > 0.0 or since <= -_ANEW


def top_speeds(limits: Limits) -> Twist:
    """The largest twist that odometry is believed to have [m/s, rad/s]."""
    return Twist(*(min(top, _TOP) for top in speeds(limits)))


def jump(before: Odometry, after: Odometry, fastest: Twist, tolerance: float = JUMP) -> str:
    """By how much odometry has jumped between two readings, as `0.50 m` or `57 deg`; empty: it has
    not. fastest: see `top_speeds`."""
    dt = after.stamp - before.stamp
    way = math.hypot(after.pose.x - before.pose.x, after.pose.y - before.pose.y)
    turn = abs(math.remainder(after.pose.psi - before.pose.psi, 2.0 * math.pi))
    if way > 1.5 * fastest.v * dt + tolerance:
        return f"{way:.2f} m"
    return f"{math.degrees(turn):.0f} deg" if turn > 1.5 * fastest.omega * dt + tolerance else ""


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


def too_old(buffer: Floats, stamp: float) -> bool:
    """Whether the buffer does not go back to a time any more: where the robot was then is not
    known."""
    return len(buffer) == KEPT and stamp < float(buffer[0, 0])


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


@jit
def usable(pose: Pose) -> bool:
    """Whether all numbers of a pose are finite."""
    return is_finite(pose.x + pose.y + pose.psi) and not math.isnan(pose.psi)
