"""The scans of a drive as mapping takes them: each at one instant, with the odometry there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.scan.deskew import sweep
from cohelm.perceive.scan.odometry_buffer import pose_at
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import Lidar

_FARTHEST = 20_000.0  # from one end of a drive's odometry to the other [m]


class Glimpse(NamedTuple):
    """One scan of a drive: stamp [s] and odometry pose of its last beam; points (m, 2) in the
    body frame then, and their beams (m,)."""

    stamp: float
    odometry: Pose
    points: Floats
    beams: Ints


def glimpses(lidar: Lidar, odometry: Sequence[Odometry], scans: Sequence[Scan]) -> list[Glimpse]:
    """The scans of a drive, each put to the instant of its last beam, with odometry there.

    Scans that end outside the time of the odometry are left out. CohelmError if none is left, or
    where the odometry says that the robot was farther off than any drive gets.
    """
    rows = np.array([[o.stamp, *o.pose, *o.twist] for o in odometry], dtype=np.float64)
    rows = rows[np.isfinite(rows).all(axis=1)].reshape(-1, 6)
    keep = np.concatenate(([True], np.diff(np.maximum.accumulate(rows[:, 0])) > 0))[: len(rows)]
    trail = rows[keep]
    if len(trail) > 1 and float(np.ptp(trail[:, 1:3], axis=0).max()) > _FARTHEST:
        far = float(np.ptp(trail[:, 1:3], axis=0).max())
        raise CohelmError(
            f"the odometry spans {far:.3g} m, and {_FARTHEST:g} m is the most that is mapped: "
            "it is damaged, or the drive is to be cut"
        )
    found: list[Glimpse] = []
    for scan in scans:
        end = scan.stamp + scan.duration
        if not len(trail) or not trail[0, 0] - 0.1 <= end <= trail[-1, 0] + 0.1:
            continue
        if len(scan.ranges) != len(lidar.beams):
            continue
        seen = sweep(lidar, scan.ranges, scan.stamp, scan.duration, trail)
        found.append(Glimpse(end, Pose(*pose_at(trail, end)), seen.points, seen.beams))
    if not found:
        raise CohelmError("no scan came while there was odometry: record both, on one clock")
    return found
