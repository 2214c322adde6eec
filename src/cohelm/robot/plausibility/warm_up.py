"""Compiles all compiled functions of the monitor, before the gate process is in use."""

from __future__ import annotations

from functools import cache

import numpy as np

from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.plausibility.content import Content
from cohelm.robot.plausibility.match import match
from cohelm.robot.plausibility.sight import sighted
from cohelm.robot.plausibility.trail import Trail, extended
from cohelm.robot.plausibility.view import farther, vanished
from cohelm.robot.plausibility.wheels import commanded, consistent
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel


@cache
def warm_up() -> None:
    """Run every compiled function, on three scans of a small room that seems to grow."""
    model = LidarModel(
        beams=181, field_of_view_deg=180.0, range_min_m=0.05, range_max_m=10.0, rate_hz=10.0,
        noise_m=0.01,
    )  # fmt: skip
    lidar, content, trail = model.lidar(), Content(model), Trail(5)
    for k in range(20):
        extended(trail, Odometry(0.05 * k, Pose(0.01 * k, 0.0, 0.01 * k), Twist(0.2, 0.2)))
    consistent(trail)
    commanded(trail.rows, 0.0)
    room: Floats = 2.0 / np.abs(lidar.beams).max(axis=1)
    scans = [Scan(0.1 * k, k, (1.0 + 0.2 * k) * room, 0.05) for k in range(3)]
    for scan in scans:
        content.look(scan)
    a, b, c = (sighted(lidar, scan.ranges, scan.stamp, scan.duration, trail) for scan in scans)
    vanished(a, b, lidar, 0.0)
    farther(b, c, lidar)
    for least in (0.0, 1e-9):
        match(a, b, lidar, least)
