"""Buffer of odometry poses, to place what was measured a moment ago."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import is_finite, wrap
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.kinematics import arc
from cohelm.robot.port import Odometry

KEPT = 512
"""Rows of a trail: ten seconds at 50 Hz, one at 500."""
_AHEAD = 0.5  # a pose is not foreseen farther than this [s]

EMPTY: Floats = np.empty((0, 6))
"""A trail with nothing on it; rows of stamp, x, y, psi, v, omega, in the order of time."""


def extended(trail: Floats, odometry: Odometry) -> Floats:
    """The trail with a reading more, as a new array; one that is not newer, or is NaN, adds none.

    A clock that jumped back by more than a second starts a new trail.
    """
    row = (odometry.stamp, *odometry.pose, *odometry.twist)
    if not all(map(math.isfinite, row)):
        return trail
    if len(trail) and odometry.stamp <= trail[-1, 0]:
        return trail if trail[-1, 0] - odometry.stamp < 1.0 else np.array([row])
    kept = trail[-(KEPT - 1) :]
    longer = np.empty((len(kept) + 1, len(row)))
    longer[:-1], longer[-1] = kept, row
    return longer


@jit
def pose_at(trail: Floats, t: float) -> Pose:
    """The odometry pose at a time: between two readings, or foreseen from the last one.

    Before the first reading it is that one's. A trail has at least one row.
    """
    last = len(trail) - 1
    if t >= trail[last, 0]:
        ahead = min(t - trail[last, 0], _AHEAD)
        pose = Pose(trail[last, 1], trail[last, 2], trail[last, 3])
        return arc(pose, Twist(trail[last, 4], trail[last, 5]), ahead)
    if t <= trail[0, 0]:
        return Pose(trail[0, 1], trail[0, 2], trail[0, 3])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if trail[middle, 0] <= t:
            low = middle
        else:
            high = middle
    share = (t - trail[low, 0]) / (trail[high, 0] - trail[low, 0])
    turn = wrap(trail[high, 3] - trail[low, 3])
    return Pose(
        trail[low, 1] + share * (trail[high, 1] - trail[low, 1]),
        trail[low, 2] + share * (trail[high, 2] - trail[low, 2]),
        wrap(trail[low, 3] + share * turn),
    )


@jit
def usable(pose: Pose) -> bool:
    """Whether all numbers of a pose are finite."""
    return is_finite(pose.x + pose.y + pose.psi) and not math.isnan(pose.psi)
