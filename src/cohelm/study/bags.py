"""Reads drives from ROS 1 and ROS 2 bags of any robot, whatever their topics are called."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from cohelm.core.errors import CohelmError
from cohelm.core.scalars import wrap
from cohelm.core.types import Pose, Twist
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.ros.laser import Ranges, lidar_model, taken
from cohelm.ros.transforms import Mount, StaticTransforms, mount_of, yaw_of
from cohelm.scenario.worlds.carmen import RecordedDrive
from cohelm.scenario.worlds.file import faults

_SCAN, _ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
_TRANSFORMS = ("/tf", "/tf_static")
_FARTHEST = 100.0  # range of a LiDAR that states none [m]
_RATE = 1.0  # of any LiDAR: mapping needs none, and a further bag has to be of the same one [Hz]


class BagTopics(NamedTuple):
    """Topics to read of a bag; empty where it has only one of the type."""

    scan: str = ""
    odometry: str = ""


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 1 bag, or a ROS 2 bag's folder or database."""
    return path.suffix in (".bag", ".db3") or (path / "metadata.yaml").is_file()


def read_bag(path: Path, topics: BagTopics, mount: LidarModel | None) -> RecordedDrive:
    """The drive in a bag, times since its first odometry. mount: a LiDAR mounted
    like that one; None: as its transforms say. Raises CohelmError where it can not be read, does
    not say which topics to take, or how the LiDAR is mounted."""
    folder = path.parent if path.suffix == ".db3" else path
    store = get_typestore(Stores.ROS2_HUMBLE)
    try:
        with AnyReader([folder], default_typestore=store) as reader:
            return _read(reader, path, topics, mount)
    except CohelmError:
        raise
    except ValidationError as error:
        raise faults(path, error) from error
    except Exception as error:  # whatever its reader makes of damaged bytes
        said = (str(error).splitlines() or [""])[0]
        if " " not in said:  # a key, or nothing
            said = f"it is damaged ({type(error).__name__})"
        raise CohelmError(f"{path} can not be read as a bag: {said}") from error


def _read(
    reader: AnyReader, path: Path, topics: BagTopics, given: LidarModel | None
) -> RecordedDrive:
    scans_from = _topic(reader, path, _SCAN, topics.scan, "--scan-topic")
    odometry_from = _topic(reader, path, _ODOMETRY, topics.odometry, "--odom-topic")
    wanted = (scans_from, odometry_from, *_TRANSFORMS)
    some = [one for one in reader.connections if one.topic in wanted]
    transforms = StaticTransforms()
    odometry: dict[float, Odometry] = {}
    seen: list[tuple[float, Any]] = []
    zero, psi, body = math.nan, 0.0, ""
    for connection, at, raw in reader.messages(connections=some):
        m: Any = reader.deserialize(raw, connection.msgtype)
        if connection.topic in _TRANSFORMS:
            transforms.add(m)
            continue
        stamp = m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec or 1e-9 * at
        if connection.topic == scans_from:
            seen.append((stamp, m))
            continue
        place, heading, twist = m.pose.pose.position, yaw_of(m.pose.pose.orientation), m.twist.twist
        if not all(map(math.isfinite, (place.x, place.y, heading))):
            continue
        zero = stamp if math.isnan(zero) else zero
        psi += wrap(heading - psi)
        body = m.child_frame_id
        odometry[stamp - zero] = Odometry(
            stamp - zero, Pose(place.x, place.y, psi), Twist(twist.linear.x, twist.angular.z)
        )
    if not seen:
        raise CohelmError(f"{path}: {scans_from} is empty: record it")
    if not odometry:
        raise CohelmError(
            f"{path}: {odometry_from} is empty, or holds no pose that is a number (an orientation "
            "of zeros is none): record it"
        )
    seen.sort(key=lambda one: one[0])
    mount = _mount(path, transforms, body, seen[0][1].header.frame_id, given)
    on_beams: Ranges | None = None
    scans: list[Scan] = []
    wrong: list[str] = []
    for stamp, m in seen:
        try:
            on_beams = on_beams or Ranges(_lidar(m, scans_from, mount), mount, scans_from)
            ranges = on_beams.of(m)
        except CohelmError as error:
            wrong.append(str(error))
            continue
        ranges[ranges >= on_beams.model.range_max_m] = math.inf
        later, duration = taken(m, mount)
        scans.append(Scan(stamp + later - zero, len(scans), ranges, duration))
    if on_beams is None:
        raise CohelmError(f"{path}: {wrong[0]}")
    left_out = f"{len(wrong)} of {len(seen)} scans: {wrong[0]}" if wrong else ""
    return RecordedDrive(
        [odometry[t] for t in sorted(odometry)], scans, on_beams.model, left_out=left_out
    )


def _lidar(first: Any, topic: str, mount: Mount) -> LidarModel:
    """Of a bag, by its first scan."""
    first.range_min = max(float(first.range_min), 0.0)
    if not first.range_min < first.range_max < math.inf:
        first.range_max = _FARTHEST
    return lidar_model(first, topic, mount, _RATE, 0.0, None)


def _topic(reader: AnyReader, path: Path, kind: str, given: str, option: str) -> str:
    """The one topic of a type, or the given one."""
    found = sorted({one.topic for one in reader.connections if one.msgtype == kind})
    if given in found:
        return given
    if len(found) == 1 and not given:
        return found[0]
    name = kind.split("/")[-1]
    if not found:
        there = ", ".join(sorted({one.topic for one in reader.connections})) or "no topic"
        raise CohelmError(f"{path}: holds no {name}, only {there}: record one")
    raise CohelmError(f"{path}: which {name} to take is open, it has {', '.join(found)}: {option}")


def _mount(
    path: Path, transforms: StaticTransforms, body: str, frame: str, given: LidarModel | None
) -> Mount:
    """Where the LiDAR is on the robot: as that one, or by the transforms."""
    if given is not None:
        return Mount(given.mount, False, math.nan)
    there = transforms.between(frame, body)
    if there is None:
        raise CohelmError(
            f"{path}: no transform says where {frame or 'the LiDAR'} is on {body or 'the robot'}: "
            "name a robot that carries it likewise by --robot"
        )
    return mount_of(there)
