"""The other side: any robot of the port behind ROS 2 topics, as its own driver would publish it.

For trying and testing without ROS: a simulated robot becomes one that `cohelm filter`, Nav2 or
`ros2 topic pub /cmd_vel` can drive.
"""

from __future__ import annotations

import contextlib
import io
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as TimeMessage,
    geometry_msgs__msg__Quaternion as Quaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Vector3 as Vector3,
    rosgraph_msgs__msg__Clock as ClockMessage,
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__PointCloud2 as PointCloud2,
    sensor_msgs__msg__PointField as PointField,
    sensor_msgs__msg__Range as Range,
    tf2_msgs__msg__TFMessage as TFMessage,
)

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.record import ros2
from cohelm.record.ros2 import header
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Odometry, RobotPort, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.ros import clock, rendered
from cohelm.ros.camera import COMPRESSED
from cohelm.ros.contact import contact_messages, contact_topics
from cohelm.ros.depth import info_topic
from cohelm.ros.inspection import kind_of
from cohelm.ros.messages import command
from cohelm.ros.mismatch import CAMERA_INFO, IMAGE, ODOMETRY, STAMPED, TF, TWIST
from cohelm.ros.names import resolved
from cohelm.ros.port import COMMAND, LATCHED, SENSOR, Qos, Received, Transport
from cohelm.ros.topics import Topics

_LOOKS = 0.004
"""The robot is looked at so often [s]."""
_TICK = 0.01
"""Period of /clock, where its time is not the wall's [s]."""
_TOUCHES = 0.02
"""Period of its bumpers and cliff sensors [s]."""
_BODY, _LASER, _ODOM = "base_link", "laser", "odom"
_HEIGHT = 0.2
"""Default height of a LiDAR above the body's origin [m]."""


class ServedRobot:
    """One robot on a transport, until `run` is over."""

    def __init__(
        self, transport: Transport, robot: RobotPort, topics: Topics, *, stamped: bool = False,
        simulated: bool = False,
    ) -> None:  # fmt: skip
        """stamped: whether it wants TwistStamped. simulated: its stamps are of a simulated time,
        published on /clock, and not of the wall's."""
        self._simulated, self._ticked = simulated, -math.inf
        self._robot, self._topics = robot, topics
        self._transport = transport
        self._arrived = threading.Condition()
        self._command: Twist | None = None
        self._odometry: Odometry | None = None
        self._frame: Frame | None = None
        self._scans: dict[str, Scan] = {}
        """The newest of each LiDAR, by its topic."""
        self._publishers = {
            topics.odom: transport.publish(topics.odom, ODOMETRY, Qos(True, False, 10)),
        }
        if simulated:
            self._publishers[clock.TOPIC] = transport.publish(clock.TOPIC, clock.TYPE, SENSOR)
        self._lidars: dict[str, str] = {}
        """The topic of each, by its name."""
        for lidar, topic in zip(robot.model.lidars, topics.of_lidars(robot.model), strict=False):
            self._lidars[lidar.name] = topic
            self._publishers[topic] = transport.publish(topic, kind_of(lidar), SENSOR)
            if kind_of(lidar) == IMAGE:
                info = info_topic(topic)
                self._publishers[info] = transport.publish(info, CAMERA_INFO, SENSOR)
        self._contacts = contact_topics(robot.model, topics.of_contacts(robot.model))
        self._touched = -math.inf
        for one in self._contacts:
            if one.topic not in self._publishers:
                self._publishers[one.topic] = transport.publish(one.topic, one.kind, SENSOR)
        self._tf = resolved("tf", topics.namespace)
        self._publishers[self._tf] = transport.publish(self._tf, TF, Qos(True, False, 10))
        tf = resolved("tf_static", topics.namespace)
        self._publishers[tf] = transport.publish(tf, TF, LATCHED)
        self._send(tf, mounts(robot.model))
        kind = STAMPED if stamped else TWIST
        transport.subscribe(topics.out, kind, Qos(True, False, 10), self._on_command)

    def run(self, over: Callable[[], bool]) -> None:
        """Publish the readings and obey commands until `over` returns true."""
        while not over():
            with self._arrived:
                self._arrived.wait(_LOOKS)
                command, self._command = self._command, None
            self.step(command)

    def step(self, command: Twist | None = None) -> None:
        """Obey a command that came, and publish what is new."""
        robot, topics = self._robot, self._topics
        if command is not None:
            robot.send(command)
        readings, now = robot.read(), robot.now()
        ahead = 0.0 if self._simulated else time.time() - now
        if self._simulated and now - self._ticked >= _TICK:
            self._ticked = now
            self._send(clock.TOPIC, ClockMessage(TimeMessage(int(now), int(1e9 * (now % 1.0)))))
        if readings.odometry is not None and readings.odometry is not self._odometry:
            self._odometry = readings.odometry
            self._send(topics.odom, odometry(readings.odometry, ahead))
            self._send(self._tf, odometry_transform(readings.odometry, ahead))
        if self._contacts and now - self._touched >= _TOUCHES:
            self._touched = now
            on = {one.sensor for one in readings.contacts if one.on}
            stamped = header(_nanoseconds(now + ahead), _BODY)
            for topic, message in contact_messages(self._contacts, on, stamped):
                self._send(topic, message)
        for one in (readings.scan, *readings.further):
            if one is not None and one is not self._scans.get(one.sensor):
                self._scans[one.sensor] = one
                topic, message = self._lidars[one.sensor], scan(one, robot.model, ahead)
                self._send(topic, message)
                if (info := info_topic(topic)) in self._publishers:
                    lidar, _ = _frames(robot.model)[one.sensor]
                    self._send(info, rendered.info(rendered.camera_of(lidar), message.header))

        if readings.frame is not None and readings.frame is not self._frame:
            self._frame = readings.frame
            self._send(self._pictures(), picture(readings.frame, ahead))

    def _pictures(self) -> str:
        """The camera's topic, which is there once there is a picture."""
        topic = resolved("camera/image_raw/compressed", self._topics.namespace)
        if topic not in self._publishers:
            self._publishers[topic] = self._transport.publish(topic, COMPRESSED, SENSOR)
        return topic

    def _send(self, topic: str, message: Any) -> None:
        self._publishers[topic].send(message)

    def _on_command(self, received: Received) -> None:
        message = received.message
        if message is None:
            return
        message = getattr(message, "twist", message)
        with self._arrived:
            self._command = Twist(float(message.linear.x), float(message.angular.z))
            self._arrived.notify_all()


def odometry(reading: Odometry, ahead: float) -> Any:
    """A `nav_msgs/msg/Odometry`. ahead: of the robot's clock is the wall's [s]."""
    return ros2.odometry(header(_nanoseconds(reading.stamp + ahead), _ODOM), _BODY, reading)


def odometry_transform(reading: Odometry, ahead: float) -> Any:
    """The same as a `tf2_msgs/msg/TFMessage`: the pose of the body in the odometry's frame."""
    stamped = header(_nanoseconds(reading.stamp + ahead), _ODOM)
    return TFMessage([ros2.transform(stamped, _BODY, reading.pose)])


def scan(reading: Scan, model: RobotModel, ahead: float) -> Any:
    """A `sensor_msgs/msg/LaserScan`, or where its LiDAR has a height band a `PointCloud2` of posts
    or an `Image` of depths, or of a range sensor a `Range`. ahead: of the robot's clock is the
    wall's [s]."""
    lidar, frame = _frames(model)[reading.sensor]
    stamped = header(_nanoseconds(reading.stamp + ahead), frame)
    if lidar.range_sensor:
        view = math.radians(lidar.field_of_view_deg)
        nearest = float(reading.ranges.min())
        return Range(
            stamped, Range.ULTRASOUND, view, lidar.range_min_m, lidar.range_max_m, nearest, 0.0
        )  # fmt: skip
    if lidar.depth_image:
        return rendered.image(reading.ranges, lidar, _height(lidar), stamped)
    if lidar.height_band_m is not None:
        hit = np.isfinite(reading.ranges)
        middle = 0.5 * sum(lidar.height_band_m) - _height(lidar)
        xy = reading.ranges[hit, None] * lidar.lidar().beams[hit]
        rows = np.column_stack([xy, np.full(len(xy), middle)]).astype("<f4")
        fields = [PointField(name, 4 * k, PointField.FLOAT32, 1) for k, name in enumerate("xyz")]
        data = rows.view(np.uint8).ravel()
        return PointCloud2(stamped, 1, len(rows), fields, False, 12, 12 * len(rows), data, True)
    return ros2.laser_scan(stamped, reading, lidar)


def picture(frame: Frame, ahead: float) -> Any:
    """A `sensor_msgs/msg/CompressedImage`, JPEG. ahead: as above."""
    file = io.BytesIO()
    Image.fromarray(frame.pixels).save(file, "JPEG", quality=75)
    stamped = header(_nanoseconds(frame.stamp + ahead), "camera")
    data = np.frombuffer(file.getvalue(), dtype=np.uint8)
    return CompressedImage(stamped, "rgb8; jpeg compressed bgr8", data)


def mounts(model: RobotModel) -> Any:
    """A `tf2_msgs/msg/TFMessage` with where the LiDARs are."""
    now, found = time.time_ns(), list[TransformStamped]()
    for lidar, frame in _frames(model).values():
        half = 0.5 * math.radians(lidar.mount_yaw_deg)
        c, s = math.cos(half), math.sin(half)
        x, y, z, w = 0.0, 0.0, 0.0, 1.0
        if lidar.depth_image:
            x, y, z, w = rendered.optical(rendered.tilt(lidar, _height(lidar)))
        at = Transform(
            Vector3(lidar.mount_x_m + model.axle_x_m, lidar.mount_y_m, _height(lidar)),
            Quaternion(c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z),
        )
        found.append(TransformStamped(header(now, _BODY), frame, at))
    return TFMessage(found)


def _height(lidar: LidarModel) -> float:
    return _HEIGHT if lidar.mount_z_m is None else lidar.mount_z_m


def _frames(model: RobotModel) -> dict[str, tuple[LidarModel, str]]:
    """Each LiDAR with its frame, by its name."""
    return {
        lidar.name: (lidar, f"{_LASER}_{lidar.name}" if i else _LASER)
        for i, lidar in enumerate(model.lidars)
    }


def _nanoseconds(stamp: float) -> int:
    return round(stamp * 1e9)


def parse_twist(text: str) -> Twist:
    """`0.5,0.1` as a twist. CohelmError for what is none."""
    parts = text.split(",")
    try:
        v, omega = (float(part) for part in parts)
        if not (math.isfinite(v) and math.isfinite(omega)):
            raise ValueError
    except ValueError as error:
        raise CohelmError(f"{text!r}: give speed and yaw rate, such as 0.5,0") from error
    return Twist(v, omega)


def run_controller(transport: Transport, topics: Topics, twist: Twist | None) -> threading.Event:
    """A controller that requests a twist, from a thread, twenty times a second; None: none. It ends
    with the event."""
    over = threading.Event()
    if twist is None:
        return over
    out = transport.publish(topics.command, TWIST, COMMAND)

    def publish() -> None:
        while not over.wait(0.05):
            with contextlib.suppress(CohelmError):  # the transport has been closed meanwhile
                out.send(command(twist, TWIST, _BODY))

    threading.Thread(target=publish, name="controller", daemon=True).start()
    return over
