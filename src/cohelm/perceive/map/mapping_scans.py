"""The scans of a drive for mapping: deskewed, with the odometry pose of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.scan.deskew import deskew
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import Lidar

_FARTHEST = 20_000.0  # extent of a drive's odometry [m]


class MappingScan(NamedTuple):
    """One scan of a drive: stamp [s] and odometry pose of its last beam; points (m, 2) in the
    body frame then, and their beams (m,)."""

    stamp: float
    odometry: Pose
    points: Floats
    beams: Ints


def mapping_scans(
    lidar: Lidar, odometry: Sequence[Odometry], scans: Sequence[Scan]
) -> list[MappingScan]:
    """The scans of a drive, each deskewed to its last beam, with the odometry pose there.

    Scans that end outside the time of the odometry are left out. CohelmError if none is left, or
    if the odometry extends farther than any drive.
    """
    rows = np.array([[o.stamp, *o.pose, *o.twist] for o in odometry], dtype=np.float64)
    rows = rows.reshape(-1, 6)
    rows = rows[np.isfinite(rows).all(axis=1)]
    keep = np.concatenate(([True], np.diff(np.maximum.accumulate(rows[:, 0])) > 0))[: len(rows)]
    buffer = rows[keep]
    if len(buffer) > 1 and float(np.ptp(buffer[:, 1:3], axis=0).max()) > _FARTHEST:
        far = float(np.ptp(buffer[:, 1:3], axis=0).max())
        raise CohelmError(
            f"the odometry spans {far:.3g} m, and {_FARTHEST:g} m is the most that is mapped: "
            "it is damaged, or the drive is to be cut"
        )
    found: list[MappingScan] = []
    for scan in scans:
        end = scan.stamp + scan.duration
        if not len(buffer) or not buffer[0, 0] - 0.1 <= end <= buffer[-1, 0] + 0.1:
            continue
        if len(scan.ranges) != len(lidar.beams):
            continue
        seen = deskew(lidar, scan.ranges, scan.stamp, scan.duration, buffer)
        found.append(MappingScan(end, seen.pose, seen.points, seen.beams))
    if not found:
        raise CohelmError("no scan came while there was odometry: record both, on one clock")
    return found
