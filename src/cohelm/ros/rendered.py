"""Depth images of what a planar scan has shown: walls where it returned, floor and ceiling before.

For a simulated robot whose LiDAR is described as a depth camera.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__CameraInfo as CameraInfo,
    sensor_msgs__msg__Image as Image,
    sensor_msgs__msg__RegionOfInterest as RegionOfInterest,
)

from cohelm.core.types import Floats
from cohelm.robot.sensors import LidarModel
from cohelm.ros.depth import Intrinsics

_OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""x, y, z, w: of a camera that looks along the body's x, level (REP-103)."""
_STEEPEST = 45
"""It looks down by no more [deg]."""
_NEARER = 0.8
"""It sees the floor from this share of the described distance: the first cell takes some pixels."""
_CEILING = 2.6
"""Of all rooms, above the floor [m]: without it what looks up measures nothing at all."""
_WIDEST = 120.0
"""A pinhole camera sees no more [deg]."""


def camera_of(lidar: LidarModel) -> Intrinsics:
    """One as fine as its beams, 4 to 3."""
    width = max(lidar.beams, 8)
    half = math.radians(0.5 * min(lidar.field_of_view_deg, _WIDEST))
    height, middle = 3 * width // 4, 0.5 * (width - 1)
    f = middle / math.tan(half)
    return Intrinsics(width, height, f, f, middle, 0.5 * (height - 1))


def tilt(lidar: LidarModel, height: float) -> float:
    """The camera's tilt downwards: as far as its corners see the floor from where it is described,
    level where it is not [rad]. height: of the lens above the floor [m]."""
    if lidar.floor is None:
        return 0.0
    camera = camera_of(lidar)
    x, y = camera.cx / camera.fx, camera.cy / camera.fy
    for degrees in range(_STEEPEST):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        if height * math.hypot(c - s * y, x) <= _NEARER * lidar.floor.from_m * (s + c * y):
            return math.radians(degrees)
    return math.radians(_STEEPEST)


def optical(down: float) -> tuple[float, float, float, float]:
    """x, y, z, w: of a camera that looks along the body's x, and down by an angle [rad]."""
    x, y, z, w = _OPTICAL
    c, s = math.cos(0.5 * down), math.sin(0.5 * down)
    return c * x + s * z, c * y + s * w, c * z - s * x, c * w - s * y


def info(camera: Intrinsics, header: Any) -> Any:
    """Its `sensor_msgs/msg/CameraInfo`."""
    k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1.0])
    p = np.insert(k, [3, 6, 9], 0.0)
    none = RegionOfInterest(0, 0, 0, 0, False)
    return CameraInfo(
        header, camera.height, camera.width, "plumb_bob", np.zeros(5), k, np.eye(3).ravel(), p, 0,
        0, none,
    )  # fmt: skip


def image(ranges: Floats, lidar: LidarModel, height: float, header: Any) -> Any:
    """Its `sensor_msgs/msg/Image`, 16UC1: walls up to the ceiling. height: of the lens [m]."""
    camera, numbers = camera_of(lidar), lidar.lidar()
    bearing, along, fall = _rays(camera, tilt(lidar, height))
    beam = np.rint((bearing - numbers.first) / numbers.step).astype(np.int64)
    seen = np.nan_to_num(ranges[np.clip(beam, 0, len(ranges) - 1)], neginf=0.0, nan=0.0)
    wall = seen / along
    with np.errstate(divide="ignore"):
        flat = np.maximum(height / fall, (height - _CEILING) / fall)
    depth = np.minimum(wall, flat)
    depth[~(depth < 65.0)] = 0.0
    data = np.rint(1000.0 * depth).astype("<u2")
    return Image(
        header, camera.height, camera.width, "16UC1", 0, 2 * camera.width,
        data.view(np.uint8).ravel(),
    )  # fmt: skip


@functools.lru_cache(4)
def _rays(camera: Intrinsics, down: float) -> tuple[Floats, Floats, Floats]:
    """(height, width) each, of a camera that looks down by an angle [rad]: where a pixel looks
    [rad], and how far along the floor, and how deep, its point moves with a metre of depth."""
    x: Floats = (np.arange(camera.width, dtype=np.float64) - camera.cx) / camera.fx
    y: Floats = (np.arange(camera.height, dtype=np.float64)[:, None] - camera.cy) / camera.fy
    ahead: Floats = math.cos(down) - math.sin(down) * y
    fall: Floats = np.broadcast_to(math.sin(down) + math.cos(down) * y, (len(y), len(x)))
    return np.arctan2(-x, ahead), np.hypot(x, ahead), fall
