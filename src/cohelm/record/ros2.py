"""Standard ROS 2 messages of sensor data and motion, planar."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Pose as PoseMessage,
    geometry_msgs__msg__PoseStamped as PoseStamped,
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__Quaternion as Quaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Twist as TwistMessage,
    geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
    geometry_msgs__msg__Vector3 as Vector3,
    nav_msgs__msg__Odometry as OdometryMessage,
    nav_msgs__msg__Path as PathMessage,
    sensor_msgs__msg__LaserScan as LaserScan,
    std_msgs__msg__Header as Header,
)

from cohelm.core.types import Pose, Twist
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel


def header(stamp: int, frame: str) -> Header:
    """stamp: [ns]."""
    return Header(Time(*divmod(stamp, 1_000_000_000)), frame)


def pose(x: float, y: float, psi: float) -> PoseMessage:
    """[m, m, rad]"""
    half = psi / 2 if math.isfinite(psi) else math.nan  # sin and cos refuse infinity
    return PoseMessage(Point(x, y, 0.0), Quaternion(0.0, 0.0, math.sin(half), math.cos(half)))


def yaw(turned: Any) -> float:
    """Heading of a planar quaternion [rad]."""
    return 2.0 * math.atan2(turned.z, turned.w)


def twist(made: Twist) -> TwistMessage:
    """A twist in the body frame."""
    return TwistMessage(Vector3(float(made.v), 0.0, 0.0), Vector3(0.0, 0.0, float(made.omega)))


def transform(head: Header, child: str, at: Pose) -> TransformStamped:
    """The pose of the frame `child` in the header's frame."""
    where = Transform(Vector3(at.x, at.y, 0.0), pose(*at).orientation)
    return TransformStamped(head, child, where)


def odometry(head: Header, body: str, reading: Odometry) -> OdometryMessage:
    """Odometry without covariances."""
    known = PoseWithCovariance(pose(*reading.pose), np.zeros(36))
    driven = TwistWithCovariance(twist(reading.twist), np.zeros(36))
    return OdometryMessage(head, body, known, driven)


def laser_scan(head: Header, reading: Scan, lidar: LidarModel) -> LaserScan:
    """A scan of a planar LiDAR."""
    numbers, n = lidar.lidar(), len(reading.ranges)
    return LaserScan(
        header=head,
        angle_min=numbers.first,
        angle_max=numbers.first + numbers.step * (n - 1),
        angle_increment=numbers.step,
        time_increment=reading.duration / max(n - 1, 1),
        scan_time=1.0 / lidar.rate_hz,
        range_min=lidar.range_min_m,
        range_max=lidar.range_max_m,
        ranges=reading.ranges.astype(np.float32),
        intensities=np.empty(0, dtype=np.float32),
    )


def path(head: Header, line: NDArray[Any]) -> PathMessage:
    """line: (n, 3) poses, or (n, 2) points, which head along x."""
    rows = np.column_stack([line, np.zeros((len(line), 3 - line.shape[1]))])
    return PathMessage(head, [PoseStamped(head, pose(*row)) for row in rows.tolist()])
