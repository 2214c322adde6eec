"""Reads drives from ROS 1 and ROS 2 bags of any robot, whatever their topics are called."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from cohelm.core.errors import CohelmError
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel

_SCAN, _ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
_TRANSFORMS = ("/tf", "/tf_static")
_FARTHEST = 100.0  # range of a LiDAR that states none [m]


class BagTopics(NamedTuple):
    """Topics to read of a bag; empty where it has only one of the type."""

    scan: str = ""
    odometry: str = ""


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 1 bag, or a ROS 2 bag's folder or database."""
    return path.suffix in (".bag", ".db3") or (path / "metadata.yaml").is_file()


def read_bag(
    path: Path, topics: BagTopics, mount: LidarModel | None
) -> tuple[list[Odometry], list[Scan], LidarModel]:
    """Odometry, scans, and LiDAR of a bag, times since its first odometry. mount: a LiDAR mounted
    like that one; None: as its transforms say. Raises CohelmError where it can not be read, does
    not say which topics to take, or how the LiDAR is mounted."""
    folder = path.parent if path.suffix == ".db3" else path
    store = get_typestore(Stores.ROS2_HUMBLE)
    try:
        with AnyReader([folder], default_typestore=store) as reader:
            return _read(reader, path, topics, mount)
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        raise CohelmError(f"{path} can not be read as a bag: {error}") from error


def _read(
    reader: AnyReader, path: Path, topics: BagTopics, mount: LidarModel | None
) -> tuple[list[Odometry], list[Scan], LidarModel]:
    scans_from = _topic(reader, path, _SCAN, topics.scan, "--scan-topic")
    odometry_from = _topic(reader, path, _ODOMETRY, topics.odometry, "--odom-topic")
    wanted = (scans_from, odometry_from, *_TRANSFORMS)
    some = [one for one in reader.connections if one.topic in wanted]
    links: dict[str, tuple[str, Floats]] = {}  # frame: its parent, and its transform there
    odometry: dict[float, Odometry] = {}
    seen: list[tuple[float, Any]] = []
    zero, psi, body = math.nan, 0.0, ""
    for connection, at, raw in reader.messages(connections=some):
        m: Any = reader.deserialize(raw, connection.msgtype)
        if connection.topic in _TRANSFORMS:
            for one in m.transforms:
                links.setdefault(
                    _frame(one.child_frame_id), (_frame(one.header.frame_id), _at(one))
                )
            continue
        stamp = m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec or 1e-9 * at
        if connection.topic == scans_from:
            seen.append((stamp, m))
            continue
        zero = stamp if math.isnan(zero) else zero
        place, turn, twist = m.pose.pose.position, m.pose.pose.orientation, m.twist.twist
        psi += wrap(2.0 * math.atan2(turn.z, turn.w) - psi)
        body = _frame(m.child_frame_id)
        odometry[stamp - zero] = Odometry(
            stamp - zero, Pose(place.x, place.y, psi), Twist(twist.linear.x, twist.angular.z)
        )
    if not odometry or not seen:
        raise CohelmError(f"{path}: {scans_from} or {odometry_from} is empty: record both")
    seen.sort(key=lambda one: one[0])
    first = seen[0][1]
    there = _mount(path, links, body, _frame(first.header.frame_id), mount)
    upside_down = bool(there[2, 2] < 0.0)
    backwards = (first.angle_increment < 0.0) != upside_down
    scans: list[Scan] = []
    for stamp, m in seen:
        if len(m.ranges) == len(first.ranges):
            duration = 0.0 if backwards else float(m.time_increment) * max(len(m.ranges) - 1, 1)
            ranges = np.asarray(m.ranges[: _beams(first)], dtype=np.float64)
            ranges = ranges[::-1].copy() if backwards else ranges
            ranges = np.where(ranges < first.range_max, ranges, math.inf)  # NaN: no return either
            scans.append(Scan(stamp - zero, len(scans), ranges, duration))
    return [odometry[t] for t in sorted(odometry)], scans, _lidar(first, there)


def _topic(reader: AnyReader, path: Path, kind: str, given: str, option: str) -> str:
    """The one topic of a type, or the given one."""
    found = sorted({one.topic for one in reader.connections if one.msgtype == kind})
    if given in found:
        return given
    if len(found) == 1 and not given:
        return found[0]
    have = ", ".join(found) or "none"
    raise CohelmError(
        f"{path}: which {kind.split('/')[-1]} to take is open, it has {have}: {option}"
    )


def _frame(name: str) -> str:
    return name.lstrip("/")


def _at(stamped: Any) -> Floats:
    """A transform as a matrix, (4, 4)."""
    t, q = stamped.transform.translation, stamped.transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), t.x],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), t.y],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), t.z],
        [0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip


def _mount(
    path: Path,
    links: dict[str, tuple[str, Floats]],
    body: str,
    frame: str,
    given: LidarModel | None,
) -> Floats:
    """The LiDAR's transform in the frame of the body, (4, 4)."""
    there = np.eye(4)
    if given is not None:
        yaw = math.radians(given.mount_yaw_deg)
        there[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
        there[:2, 3] = given.mount_x_m, given.mount_y_m
        return there
    at, roots = frame, {body: np.eye(4)}
    own, up = body, np.eye(4)
    while own in links and len(roots) < 50:  # the body may hang below what the LiDAR hangs on
        own, step = links[own]
        up = step @ up
        roots[own] = up
    for _ in range(50):
        if at in roots:
            return np.asarray(np.linalg.inv(roots[at]) @ there, dtype=np.float64)
        if at not in links:
            break
        at, step = links[at]
        there = step @ there
    raise CohelmError(
        f"{path}: no transform says where {frame or 'the LiDAR'} is on {body or 'the robot'}: name "
        "a robot that carries it likewise by --robot"
    )


def _beams(first: Any) -> int:
    """Number of its beams; one that is the first again, after a full circle, is not another."""
    n = len(first.ranges)
    again = abs(first.angle_increment) * (n - 0.5) > 2.0 * math.pi
    return n - 1 if again else n


def _lidar(first: Any, there: Floats) -> LidarModel:
    """The LiDAR of a scan, mounted there."""
    beams, step = _beams(first), math.degrees(abs(first.angle_increment))
    middle = math.degrees(first.angle_min + 0.5 * first.angle_increment * (beams - 1))
    yaw = math.degrees(math.atan2(there[1, 0], there[0, 0]))
    up = math.copysign(1.0, there[2, 2])  # or upside down
    far = float(first.range_max)
    return LidarModel(
        beams=beams,
        # all round, the last beam is a step short of the first
        field_of_view_deg=360.0 if step * (beams + 0.5) > 360.0 else max(step * (beams - 1), 0.001),
        range_min_m=max(float(first.range_min), 0.0),
        range_max_m=far if 0.0 < far < math.inf else _FARTHEST,
        mount_x_m=float(there[0, 3]),
        mount_y_m=float(there[1, 3]),
        mount_yaw_deg=math.degrees(wrap(math.radians(yaw + up * middle))),
    )
