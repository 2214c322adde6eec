"""The topics of a record: readings, periods and events as ROS 2 messages.

`/odom` in the odometry frame, `/scan` (of further LiDARs `/scan_NAME`), `/tf` (map, odom,
base_link), `/cmd_vel` and `/cmd_vel_safe`, `/joy`, `/camera/image/compressed`, `/rosout` for
events, `/period` for every number of a period, and what the stations displayed (`shown.TOPICS`).
The caller decides where the bytes go: into a file, or to viewers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__TwistStamped as TwistStamped,
    rcl_interfaces__msg__Log as Log,
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__Joy as Joy,
    std_msgs__msg__Header as Header,
    tf2_msgs__msg__TFMessage as TFMessage,
)

from cohelm.core.row import ROW
from cohelm.core.types import Floats, Pose, Twist
from cohelm.link.recorded_status import Displayed
from cohelm.record import markers, period, ros2, shown
from cohelm.record.period import NO_DISCS, NO_H, STORE
from cohelm.robot.keep.record_pipe import Event, OutlineChange
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Encoded, Odometry, Scan
from cohelm.robot.sensors import LidarModel

MAP, ODOM, BASE, LASER, CAMERA = "map", "odom", "base_link", "laser", "camera"
IMAGE = "/camera/image/compressed"

TOPICS = {
    period.TOPIC: period.TYPE,
    "/odom": "nav_msgs/msg/Odometry",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
    "/cmd_vel_safe": "geometry_msgs/msg/TwistStamped",
    "/joy": "sensor_msgs/msg/Joy",
    IMAGE: "sensor_msgs/msg/CompressedImage",
    "/rosout": "rcl_interfaces/msg/Log",
    "/scene": "visualization_msgs/msg/MarkerArray",
    **shown.TOPICS,
}
"""Every topic, with its type. `/cmd_vel` is the command at the wheels, `/cmd_vel_safe` the law's;
`/joy` has axes fore-aft and left-right; `/scene` holds the robot's outline and a run's walls.
"""

LASTING = frozenset({"/tf_static", "/scene", *shown.TOPICS}) - {"/obstacles"}
"""Topics published once or on change: their last message stays valid (latched)."""

NO_WALLS: Floats = np.empty((0, 4))


class RecordedLidar(NamedTuple):
    """Where the scans of a LiDAR go."""

    model: LidarModel
    topic: str
    frame: str


def scan_topic(name: str) -> str:
    """Of a further LiDAR."""
    return f"/scan_{name}"


def _lidars(robot: RobotModel | None) -> dict[str, RecordedLidar]:
    """By their names, the first one first."""
    if robot is None or robot.lidar is None:
        return {}
    first = {robot.lidar.name: RecordedLidar(robot.lidar, "/scan", LASER)}
    return first | {
        one.name: RecordedLidar(one, scan_topic(one.name), f"{LASER}_{one.name}")
        for one in robot.further_lidars
    }


class Definition(NamedTuple):
    """Of the messages on a topic."""

    name: str
    """Of the type, as `std_msgs/msg/Header`."""
    text: str
    """In ROS 2's own words, with all that it is made of."""


def definitions(robot: RobotModel | None) -> dict[str, Definition]:
    """Of every topic. robot: whose drive it is, if it is one."""
    return {topic: Definition(name, _text(name)) for topic, name in _types(robot).items()}


def _types(robot: RobotModel | None) -> dict[str, str]:
    return TOPICS | {one.topic: TOPICS["/scan"] for one in _lidars(robot).values()}


def _text(name: str) -> str:
    if name == period.TYPE:
        return period.DEFINITION
    return STORE.generate_msgdef(name, ros_version=2)[0]


class RecordTopics:
    """Makes the messages of a run or a drive, and passes them on."""

    def __init__(
        self, epoch: int, put: Callable[[str, bytes, int, int | None], None],
        robot: RobotModel | None = None, wanted: Callable[[str], bool] = lambda _: True,
    ) -> None:  # fmt: skip
        """epoch: time stamp of t = 0 [ns]. put: called with topic, message (CDR), stamp [ns],
        and the number of a scan or picture. robot: of a drive. wanted: whether to make messages of
        a topic; called for each."""
        self._epoch, self._put, self._wanted = epoch, put, wanted
        self._lidars, self._robot = _lidars(robot), robot
        self._periods = 0
        self._odometry: Pose | None = None
        self._types = _types(robot)

    def begin(self, outline: Floats | None = None, walls: Floats = NO_WALLS) -> None:
        """Write constant messages. outline: (k, 2) of a run's robot, body frame; walls: (s, 4)."""
        mounts = [
            self._frame(0.0, BASE, one.frame, one.model.lidar().mount)
            for one in self._lidars.values()
        ]
        if mounts:
            self._say(0.0, "/tf_static", TFMessage(mounts))
        corners = self._robot.outline if self._robot is not None else outline
        if corners is not None:
            start = self._stamp(0.0)
            self._say(0.0, "/scene", markers.scene(corners, BASE, walls, MAP, start))

    def write(self, message: object) -> None:
        """One message: an Odometry, a Scan, an Encoded, an Event, an OutlineChange, what was
        Displayed, or a row of ROW as bytes."""
        if isinstance(message, bytes):
            self.period(np.frombuffer(message, dtype=ROW).reshape(()))
        elif isinstance(message, Odometry):
            self._odom(message)
        elif isinstance(message, Displayed):
            for topic, what in shown.to_messages(message.what, self._stamp(message.stamp), MAP):
                self._say(message.stamp, topic, what)
        elif isinstance(message, Scan):
            self._scan(message)
        elif isinstance(message, Encoded):
            image = np.frombuffer(message.data, dtype=np.uint8)
            seen = CompressedImage(self._head(message.stamp, CAMERA), "jpeg", image)
            self._say(message.stamp, IMAGE, seen, message.number)
        elif isinstance(message, Event):
            self._event(message)
        elif isinstance(message, OutlineChange):
            at = self._stamp(message.stamp)
            drawn = markers.scene(message.corners, BASE, NO_WALLS, MAP, at)
            self._say(message.stamp, "/scene", drawn)
        else:
            raise TypeError(f"a record does not hold a {type(message).__name__}")

    def period(
        self, row: NDArray[np.void], h: Floats = NO_H, discs: Floats = NO_DISCS, beside: bool = True
    ) -> None:
        """One period: a row of ROW, shape (), of a run with h_i and the discs. beside: whether
        to write standard ROS 2 messages too."""
        t = float(row["t"])
        self._say(t, period.TOPIC, period.message(row.tolist(), h, discs), self._periods)
        self._periods += 1
        if not beside:
            return
        robot = self._head(t, BASE)
        for topic, stage in (("/cmd_vel", "applied"), ("/cmd_vel_safe", "safe")):
            given = Twist(float(row[f"{stage}_v"]), float(row[f"{stage}_omega"]))
            self._say(t, topic, TwistStamped(robot, ros2.twist(given)))
        axes = np.array([row["stick_x"], row["stick_psi"]], dtype=np.float32)
        self._say(t, "/joy", Joy(robot, axes, np.empty(0, dtype=np.int32)))
        place = Pose(float(row["x"]), float(row["y"]), float(row["psi"]))
        odometry = self._odometry
        if odometry is not None and all(math.isfinite(value) for value in place + odometry):
            at = self._frame(t, MAP, ODOM, _under(place, odometry))
            self._say(t, "/tf", TFMessage([at]))

    def _odom(self, odometry: Odometry) -> None:
        t, self._odometry = odometry.stamp, odometry.pose
        self._say(t, "/odom", ros2.odometry(self._head(t, ODOM), BASE, odometry))
        self._say(t, "/tf", TFMessage([self._frame(t, ODOM, BASE, odometry.pose)]))

    def _scan(self, scan: Scan) -> None:
        found = self._lidars.get(scan.sensor)
        if found is None:
            return
        message = ros2.laser_scan(self._head(scan.stamp, found.frame), scan, found.model)
        self._say(scan.stamp, found.topic, message, scan.number)

    def _event(self, event: Event) -> None:
        level = Log.ERROR if event.serious else Log.INFO
        at = self._head(event.stamp, "").stamp
        message = Log(at, level, event.who, event.text, "", "", 0)
        self._say(event.stamp, "/rosout", message)

    def _frame(self, t: float, parent: str, child: str, pose: Pose) -> Any:
        return ros2.transform(self._head(t, parent), child, pose)

    def _head(self, t: float, frame: str) -> Header:
        return ros2.header(self._stamp(t), frame)

    def _stamp(self, t: float) -> int:
        return self._epoch + (round(t * 1e9) if math.isfinite(t) else 0)

    def _say(self, t: float, topic: str, message: Any, number: int | None = None) -> None:
        if self._wanted(topic):
            data = bytes(STORE.serialize_cdr(message, self._types[topic]))
            self._put(topic, data, max(self._stamp(t), 0), number)


def _under(place: Pose, odometry: Pose) -> Pose:
    """The pose of the odometry frame in the map, from the robot's poses in both."""
    psi = math.remainder(place.psi - odometry.psi, math.tau)
    c, s = math.cos(psi), math.sin(psi)
    return Pose(
        place.x - c * odometry.x + s * odometry.y, place.y - s * odometry.x - c * odometry.y, psi
    )
