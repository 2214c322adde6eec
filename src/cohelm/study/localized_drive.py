"""Localizes a recorded drive on a map, as the robot would have been, and compares the two."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose, Progress
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.pipeline import Perception
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel

_WRONG = 0.3  # an error that counts as wrong [m]
_START = 0.05  # standard deviation of the first pose [m]
_SAME = 1e-6  # times no farther apart are one [s]


@dataclass(frozen=True)
class LocalizedDrive:
    """How a drive went on the map, against the trajectory that the map was made from."""

    scans: int
    lost_share: float
    wrong_and_sure_share: float
    """More than 0.3 m off, and not lost."""
    rms_m: float | None
    """Of the scans at which it was not lost; None: it always was."""
    most_m: float | None


def localized_drive(
    lidar: LidarModel, odometry: list[Odometry], scans: list[Scan], known: LocalizationMap,
    trajectory: Floats, progress: Progress,
) -> LocalizedDrive:  # fmt: skip
    """A drive again, from its first pose on the map on.

    trajectory: (n, 4), t [s], x, y, heading of the body on the map; other drives may be in it too.
    Raises CohelmError where no scan is of its times.
    """
    ends = [scan.stamp + scan.duration for scan in scans]
    times = trajectory[:, 0]
    of_this = (times >= min(ends, default=math.inf) - _SAME) & (
        times <= max(ends, default=0.0) + _SAME
    )
    trajectory = trajectory[of_this]
    if not len(trajectory):
        raise CohelmError("no scan is of the times of the trajectory: map the record again")
    first, last = float(trajectory[0, 0]), float(trajectory[-1, 0])
    perception = Perception(lidar.lidar(), known)
    perception.place(Pose(*(float(value) for value in trajectory[0, 1:])), _START)
    scans = sorted(scans, key=lambda scan: scan.stamp)
    odometry = sorted(odometry, key=lambda one: one.stamp)
    poses: list[Floats] = []
    lost: list[bool] = []
    k = 0
    for number, scan in enumerate(scans):
        end = scan.stamp + scan.duration
        while k < len(odometry) and odometry[k].stamp <= end + _SAME:
            if odometry[k].stamp >= first - 1.0:
                perception.receive(odometry[k].stamp, Readings(odometry=odometry[k]))
            k += 1
        if not first - _SAME <= end <= last + _SAME:
            continue
        perception.receive(end, Readings(scan=scan))
        seen = perception.seen(end)
        poses.append(np.array([end, seen.pose.x, seen.pose.y]))
        lost.append(bool(seen.lost))
        if number % 20 == 0:
            progress(f"localizing scan {number + 1}", number / len(scans))
    found = np.array(poses)
    true = [np.interp(found[:, 0], trajectory[:, 0], trajectory[:, i]) for i in (1, 2)]
    off = np.hypot(found[:, 1] - true[0], found[:, 2] - true[1])
    sure = ~np.array(lost)
    return LocalizedDrive(
        len(off), float((~sure).mean()), float((sure & (off > _WRONG)).mean()),
        float(np.sqrt(np.mean(off[sure] ** 2))) if sure.any() else None,
        float(off[sure].max()) if sure.any() else None,
    )  # fmt: skip
