"""A drive as it goes, into one MCAP file of ROS 2's own messages: what a robot's loop records.

`/odom` in the odometry frame, `/scan`, `/tf` (map, odom, base_link), `/cmd_vel` and
`/cmd_vel_safe`, `/joy`, `/camera/image/compressed`, `/rosout` for what happened, and `/period`:
every number of a period; besides, what the stations were shown (`shown.TOPICS`).
"""

from __future__ import annotations

import io
import math
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Pose as RosPose,
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__Quaternion as Quaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Twist as RosTwist,
    geometry_msgs__msg__TwistStamped as TwistStamped,
    geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
    geometry_msgs__msg__Vector3 as Vector3,
    nav_msgs__msg__Odometry as RosOdometry,
    rcl_interfaces__msg__Log as Log,
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__Joy as Joy,
    sensor_msgs__msg__LaserScan as LaserScan,
    std_msgs__msg__Header as Header,
    tf2_msgs__msg__TFMessage as TFMessage,
)

from cohelm import __version__
from cohelm.core.period import MEANINGS, PERIOD
from cohelm.core.types import Pose, wrap
from cohelm.link.recorded_status import Shown
from cohelm.record import shown
from cohelm.record.status import STORE
from cohelm.robot.keep.gated_robot import Event
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Odometry, Scan

PERIOD_TYPE = "cohelm_msgs/msg/Period"
METADATA = "cohelm drive"
MAP, ODOM, BASE, LASER, CAMERA = "map", "odom", "base_link", "laser", "camera"
IMAGE = "/camera/image/compressed"

TOPICS = {
    "/odom": "nav_msgs/msg/Odometry",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
    "/cmd_vel_safe": "geometry_msgs/msg/TwistStamped",
    "/joy": "sensor_msgs/msg/Joy",
    IMAGE: "sensor_msgs/msg/CompressedImage",
    "/rosout": "rcl_interfaces/msg/Log",
    "/period": PERIOD_TYPE,
    **shown.TOPICS,
}


def _definition() -> str:
    lines = ["# One period of cohelm's loop; see docs/records.md. Numbers in () are equations."]
    lines += [
        f"{PERIOD[name].name} {name.lower()}  # {MEANINGS[name]}" for name in PERIOD.names or ()
    ]
    return "\n".join(lines) + "\n"


DEFINITION = _definition()
STORE.register(get_types_from_msg(DEFINITION, PERIOD_TYPE))


class Photo(NamedTuple):
    """A frame of the camera, packed."""

    stamp: float
    """When it was taken [s]."""
    number: int
    """As the camera counts."""
    jpeg: bytes


class DriveFile:
    """Writes a drive into an open file. OSError where the file can not grow."""

    def __init__(self, file: IO[bytes], model: RobotModel, epoch: int, scenario: str = "") -> None:
        """epoch: wall-clock time when the robot's clock was 0 [ns]; a label only."""
        # the MCAP writer would buffer a bare file itself, where no flush of ours reaches
        self._file = io.BufferedWriter(file) if isinstance(file, io.RawIOBase) else file
        self._epoch = epoch
        self._count = 0
        self._mcap = Writer(self._file, chunk_size=1 << 16, compression=CompressionType.ZSTD)
        self._mcap.start(profile=Profile.ROS2, library=f"cohelm {__version__}")
        about = {"version": __version__, "robot": model.name, "epoch_ns": str(epoch)}
        self._mcap.add_metadata(METADATA, about)
        robot = model.model_dump_json().encode()
        self._mcap.add_attachment(epoch, epoch, "robot.json", "application/json", robot)
        if scenario:
            said = scenario.encode()
            self._mcap.add_attachment(epoch, epoch, "scenario.yaml", "application/yaml", said)
        self._channels: dict[str, int] = {}
        for topic, name in TOPICS.items():
            if name == PERIOD_TYPE:
                definition = DEFINITION
            else:
                definition, _ = STORE.generate_msgdef(name, ros_version=2)
            schema = self._mcap.register_schema(name, SchemaEncoding.ROS2, definition.encode())
            channel = self._mcap.register_channel(topic, MessageEncoding.CDR, schema)
            self._channels[topic] = channel
        self._lidar = model.lidar
        if self._lidar is not None:
            mount = self._lidar.lidar().mount
            self._say(0.0, "/tf_static", TFMessage([self._frame(0.0, BASE, LASER, mount)]))
        self._odometry: Pose | None = None

    def write(self, message: object) -> None:
        """One message: an Odometry, a Scan, a Photo, an Event, or what was Shown."""
        if isinstance(message, Odometry):
            self._odom(message)
        elif isinstance(message, Shown):
            for topic, what in shown.said(message.what, self._stamp(message.stamp), MAP):
                self._say(message.stamp, topic, what)
        elif isinstance(message, Scan):
            self._scan(message)
        elif isinstance(message, Photo):
            image = np.frombuffer(message.jpeg, dtype=np.uint8)
            seen = CompressedImage(Header(self._time(message.stamp), CAMERA), "jpeg", image)
            self._say(message.stamp, IMAGE, seen, message.number)
        elif isinstance(message, Event):
            self._event(message)
        else:
            raise TypeError(f"a drive does not hold a {type(message).__name__}")

    def period(self, row: NDArray[np.void]) -> None:
        """One period: a row of PERIOD, shape ()."""
        t = float(row["t"])
        self._say(t, "/period", STORE.types[PERIOD_TYPE](*row.tolist()))
        robot = Header(self._time(t), BASE)
        applied, safe = (_twist(float(row[f"{s}_v"]), float(row[f"{s}_omega"])) for s in _TWISTS)
        self._say(t, "/cmd_vel", TwistStamped(robot, applied))
        self._say(t, "/cmd_vel_safe", TwistStamped(robot, safe))
        axes = np.array([row["stick_x"], row["stick_psi"]], dtype=np.float32)
        self._say(t, "/joy", Joy(robot, axes, np.empty(0, dtype=np.int32)))
        place = Pose(float(row["x"]), float(row["y"]), float(row["psi"]))
        if self._odometry is not None and all(math.isfinite(value) for value in place):
            at = self._frame(t, MAP, ODOM, _under(place, self._odometry))
            self._say(t, "/tf", TFMessage([at]))

    def flush(self) -> None:
        """Everything so far stands in the file."""
        self._mcap.flush()
        self._file.flush()

    def finish(self) -> None:
        """The file is whole."""
        self._mcap.finish()
        self._file.flush()

    def _odom(self, odometry: Odometry) -> None:
        t, pose, twist = odometry
        self._odometry = pose
        header = Header(self._time(t), ODOM)
        known = PoseWithCovariance(_pose(pose), np.zeros(36))
        driven = TwistWithCovariance(_twist(twist.v, twist.omega), np.zeros(36))
        self._say(t, "/odom", RosOdometry(header, BASE, known, driven))
        self._say(t, "/tf", TFMessage([self._frame(t, ODOM, BASE, pose)]))

    def _scan(self, scan: Scan) -> None:
        lidar = self._lidar
        if lidar is None:
            return
        numbers, n = lidar.lidar(), len(scan.ranges)
        message = LaserScan(
            header=Header(self._time(scan.stamp), LASER),
            angle_min=numbers.first,
            angle_max=numbers.first + numbers.step * (n - 1),
            angle_increment=numbers.step,
            time_increment=scan.duration / max(n - 1, 1),
            scan_time=1.0 / lidar.rate_hz,
            range_min=lidar.range_min_m,
            range_max=lidar.range_max_m,
            ranges=scan.ranges.astype(np.float32),
            intensities=np.empty(0, dtype=np.float32),
        )
        self._say(scan.stamp, "/scan", message, scan.number)

    def _event(self, event: Event) -> None:
        level = Log.ERROR if event.serious else Log.INFO
        message = Log(self._time(event.stamp), level, event.who, event.text, "", "", 0)
        self._say(event.stamp, "/rosout", message)

    def _frame(self, t: float, parent: str, child: str, pose: Pose) -> TransformStamped:
        at = _pose(pose)
        where = Transform(Vector3(pose.x, pose.y, 0.0), at.orientation)
        return TransformStamped(Header(self._time(t), parent), child, where)

    def _time(self, t: float) -> Time:
        return Time(*divmod(self._stamp(t), 1_000_000_000))

    def _stamp(self, t: float) -> int:
        return self._epoch + (round(t * 1e9) if math.isfinite(t) else 0)

    def _say(self, t: float, topic: str, message: Any, number: int | None = None) -> None:
        data = bytes(STORE.serialize_cdr(message, TOPICS[topic]))
        stamp = max(self._stamp(t), 0)
        self._count += 1
        count = self._count if number is None else number
        self._mcap.add_message(self._channels[topic], stamp, data, stamp, sequence=count)


_TWISTS = ("applied", "safe")


def _pose(pose: Pose) -> RosPose:
    half = 0.5 * pose.psi if math.isfinite(pose.psi) else math.nan
    quaternion = Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
    return RosPose(Point(pose.x, pose.y, 0.0), quaternion)


def _twist(v: float, omega: float) -> RosTwist:
    return RosTwist(Vector3(v, 0.0, 0.0), Vector3(0.0, 0.0, omega))


def _under(place: Pose, odometry: Pose) -> Pose:
    """The pose of the odometry frame in the map, from the robot's poses in both."""
    psi = wrap(place.psi - odometry.psi)
    c, s = math.cos(psi), math.sin(psi)
    return Pose(
        place.x - c * odometry.x + s * odometry.y, place.y - s * odometry.x - c * odometry.y, psi
    )


def periods(rows: list[Any]) -> NDArray[np.void]:
    """Messages of `/period` as rows of PERIOD."""
    names = [name.lower() for name in PERIOD.names or ()]
    return np.array([tuple(getattr(m, name) for name in names) for m in rows], dtype=PERIOD)
