"""The scans of a drive, deskewed, for mapping."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.perceive.scan.deskew import DeskewedScan, deskew
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import Lidar

_FARTHEST = 20_000.0  # extent of a drive's odometry [m]


def mapping_scans(
    lidar: Lidar, odometry: Sequence[Odometry], scans: Sequence[Scan]
) -> list[DeskewedScan]:
    """The scans of a drive, each deskewed to its last beam.

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
    found: list[DeskewedScan] = []
    for scan in scans:
        end = scan.stamp + scan.duration
        if not len(buffer) or not buffer[0, 0] - 0.1 <= end <= buffer[-1, 0] + 0.1:
            continue
        if len(scan.ranges) != len(lidar.beams):
            continue
        found.append(deskew(lidar, scan.ranges, scan.stamp, scan.duration, buffer))
    if not found:
        raise CohelmError("no scan came while there was odometry: record both, on one clock")
    return found
