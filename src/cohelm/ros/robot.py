"""A ROS 2 robot behind the robot port: odometry and scans in, commands for its base out."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.base import OLDEST, Robot
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Health, Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.ros import laser
from cohelm.ros.clock import Clock, SimulatedClock, WallSteps, seconds
from cohelm.ros.cloud import CloudRanges
from cohelm.ros.cone import ConeRanges
from cohelm.ros.connection import connection
from cohelm.ros.contact import Contacts, contact_topics
from cohelm.ros.depth import DepthRanges
from cohelm.ros.footprint import FootprintTopic
from cohelm.ros.found import Allowed, Found, FoundLidar
from cohelm.ros.inspection import kind_of
from cohelm.ros.interlock import Interlock
from cohelm.ros.look import look
from cohelm.ros.messages import command
from cohelm.ros.mismatch import GATE, ODOMETRY
from cohelm.ros.option_names import ROBOT
from cohelm.ros.port import COMMAND, SENSOR, Received, Transport
from cohelm.ros.topics import Topics
from cohelm.ros.transforms import yaw_of

_QUIET = 1.0
"""A robot that stands is sent zero for this long, and then nothing: others may drive it [s]."""
_DAMAGES = 3
"""So many messages in a row that can not be used are no chance; what comes no more is missed after
three and a half (`loop.sensor_watchdog`), without it being known why."""
_DRIVES, _ASIDE, _ALONG = 0.1, 0.3, 0.15
"""A twist faster than this [m/s], aside by this share of it, and along the heading but for this
angle [rad], is in the frame of the pose."""
_STILL = Twist(0.0, 0.0)


class Ros2Robot(Robot):
    """See `robot.base.Robot`. With the model alone, `cohelm robot ... --driver ros2`, it looks for
    the robot on the topics that `COHELM_ROS_TOPICS` names (`odom=/odom scan=/front/scan`), and
    takes the model's LiDARs for those there are; `scan_NAME=` is of a further one."""

    def __init__(
        self, model: RobotModel, found: Found | None = None, transport: Transport | None = None
    ) -> None:
        """found: what `look` found; `model` has to be its. transport: by default as `connection`
        chooses, closed with the robot. Raises CohelmError where there is no such robot."""
        self._transport = transport or connection().open("cohelm_robot")
        try:
            if found is None:
                topics = topics_of(os.environ.get("COHELM_ROS_TOPICS", "").split())
                found = look(self._transport, model, topics, Allowed(options=ROBOT))
            super().__init__(model)
            self._found = found
            topics = found.topics
            self._lock = threading.Lock()
            self._odometry: Received | None = None
            self._came: dict[str, Received] = {}
            """The newest unread scan of each LiDAR, by its name."""
            self._last: dict[str, Any] = {}
            """The newest message of each LiDAR, read or not."""
            self._sent = _STILL
            self._stopped_since = -math.inf
            self._steps = WallSteps()
            self._simulated = SimulatedClock.on(self._transport) if found.simulated else None
            self._unusable: dict[str, tuple[int, str]] = {}
            """Of each topic, how many of the last messages in a row were, and why."""
            if model.lidar is None:
                raise CohelmError(f"{model.name} has no LiDAR: describe it in the robot's YAML")
            both = list(zip(model.lidars, found.lidars, strict=True))
            self._lidars = {lidar.name: (one, _ranges(lidar, one)) for lidar, one in both}
            self._out = self._transport.publish(topics.out, found.out_type, COMMAND)
            alone = [(topics.odom, ODOMETRY, "odometry")]
            alone += [(one.topic, kind_of(lidar), "LiDAR") for lidar, one in both]
            self._interlock = Interlock(
                self._transport,
                topics.out,
                topics.lock,
                found.bypass,
                found.lock_silence,
                alone,
                found.options,
            )
            self._transport.subscribe(topics.odom, ODOMETRY, SENSOR, self._on_odometry)
            felt = contact_topics(model, topics.of_contacts(model))
            self._contacts = Contacts(self._transport, felt, self.now)
            self._footprint = None
            if topics.footprint:
                self._footprint = FootprintTopic(
                    self._transport, topics.footprint, found.body, model
                )
            for lidar, one in both:
                callback = partial(self._on_scan, lidar.name)
                self._transport.subscribe(one.topic, kind_of(lidar), SENSOR, callback)
        except BaseException:
            self._transport.close()
            raise

    def now(self) -> float:
        """The robot's clock [s]: of a simulated one as its simulator's goes."""
        simulated = self._simulated
        return super().now() if simulated is None else simulated.now()

    def read(self) -> Readings:
        """What has come since; a scan once. Nothing before a simulator's time is known."""
        with self._lock:
            odometry, self._odometry = self._odometry, None
            scans, self._came = self._came, {}
        if self._simulated is not None and not self._simulated.known:
            odometry, scans = None, {}
        seen = {name: self._seen(name, scan.message) for name, scan in scans.items()}
        first = seen.pop(next(iter(self._lidars)), None)
        further = tuple(scan for scan in seen.values() if scan is not None)
        measured = None if odometry is None else self._measured(odometry.message)
        outline, wrong = (None, "") if self._footprint is None else self._footprint.read()
        faults = (*self._interlock.faults(), *filter(None, (wrong, *self._damages())))
        health = Health(self.now(), math.nan, faults)
        return Readings(measured, first, None, health, further, self._contacts.read(), outline)

    def send(self, twist: Twist) -> None:
        """To the base, as the type that it wants; after a while of standing, nothing."""
        now = self.now()
        if twist != _STILL:
            self._stopped_since = now
        self._sent = twist
        if now - self._stopped_since <= _QUIET:
            self._out.send(command(twist, self._found.out_type, self._found.body, self._stamp()))

    def stop(self) -> None:
        """Zero; the base brakes as hard as it does."""
        if self._sent != _STILL:
            self._stopped_since = self.now()
        self.send(_STILL)

    def close(self) -> None:
        """Leave the network."""
        self._interlock.close()
        self._transport.close()

    def _stamp(self) -> float:
        """Of a command, by the clock of the base, which drops it when it is older than its time-out
        [s]."""
        if self._simulated is not None and self._simulated.known:
            return self._simulated.time()
        return time.time() + self._found.odom_clock.ahead

    def _measured(self, message: Any) -> Odometry:
        age = self._aged(self._found.odom_clock, seconds(message.header.stamp))
        at, turned = message.pose.pose.position, message.pose.pose.orientation
        way = message.twist.twist
        return self.odometry(
            Pose(at.x, at.y, yaw_of(turned)), Twist(way.linear.x, way.angular.z), _near(age)
        )

    def _seen(self, name: str, message: Any) -> Scan | None:
        """A message of a LiDAR; None for a range sensor's that measured nothing: it is late until
        it does."""
        lidar, converts = self._lidars[name]
        ranges = converts.of(message)
        if isinstance(converts, ConeRanges) and math.isnan(ranges[0]):
            return None
        late, duration = laser.taken(message, lidar.mount) if lidar.cloud is None else (0.0, 0.0)
        stamp = seconds(message.header.stamp) + late
        if not lidar.stamped_at_end:
            stamp += duration
        age = _near(self._aged(lidar.clock, stamp))
        floor = converts.floor if isinstance(converts, CloudRanges | DepthRanges) else None
        return self.scan(ranges, age, duration, name, floor and floor.edges)

    def _aged(self, clock: Clock, stamp: float) -> float:
        """By the simulator's time, if there is one, else by a clock."""
        if self._simulated is not None:
            return self._simulated.age(stamp)
        return self._steps.corrected(clock.age(stamp))

    def _on_odometry(self, received: Received) -> None:
        self._interlock.received(self._found.topics.odom, received)
        if self._usable(self._found.topics.odom, received, self._wrong_twist):
            with self._lock:
                self._odometry = received

    def _on_scan(self, name: str, received: Received) -> None:
        topic = self._lidars[name][0].topic
        self._interlock.received(topic, received)
        if self._usable(topic, received, partial(self._wrong_scan, name)):
            before = self._last.get(name)
            if before is not None and same(received.message, before):
                return  # relayed twice
            with self._lock:
                self._last[name], self._came[name] = received.message, received

    def _wrong_scan(self, name: str, message: Any) -> str:
        """Why a message of a LiDAR can not be used."""
        lidar, converts = self._lidars[name]
        topic, frame = lidar.topic, lidar.frame.lstrip("/")
        if frame and message.header.frame_id.lstrip("/") != frame:
            return (
                f"{topic} comes in the frame {message.header.frame_id!r}, and was in "
                f"{lidar.frame!r} when it was looked at: fix its driver, or start again"
            )
        if isinstance(converts, laser.Ranges):
            try:
                laser.layout(message, topic)
            except CohelmError as error:
                return str(error)
        return ""

    def _wrong_twist(self, message: Any) -> str:
        """Why odometry can not be used: a robot that drives where it looks along the axes of the
        pose's frame."""
        at, yaw = message.twist.twist.linear, yaw_of(message.pose.pose.orientation)
        speed = math.hypot(at.x, at.y)
        if not (speed > _DRIVES and abs(at.y) > _ASIDE * speed):
            return ""
        if not abs(math.remainder(math.atan2(at.y, at.x) - yaw, math.pi)) < _ALONG:
            return ""
        found = self._found
        return (
            f"{found.topics.odom} gives its twist along the axes of {found.odom!r}, and those of "
            f"{found.body!r} are needed (REP-105, {ODOMETRY}): fix its driver"
        )

    def _usable(self, topic: str, received: Received, wrong: Callable[[Any], str]) -> bool:
        """Whether a message can be used. wrong: says why one that can be read can not."""
        message = received.message
        if message is None:
            why = f"what comes on {topic} can not be read ({received.damage}): fix its driver"
        else:
            why = wrong(message)
        with self._lock:
            many = self._unusable.get(topic, (0, ""))[0]
            self._unusable[topic] = (many + 1, why) if why else (0, "")
        return not why

    def _damages(self) -> list[str]:
        """What is wrong with topics of which nothing can be used any more."""
        with self._lock:
            return [why for many, why in self._unusable.values() if many >= _DAMAGES]


def _ranges(
    model: LidarModel, found: FoundLidar
) -> laser.Ranges | CloudRanges | DepthRanges | ConeRanges:  # fmt: skip
    """What makes ranges of the messages of a LiDAR."""
    if found.cloud is not None and model.range_sensor:
        return ConeRanges(model, found.cloud, found.topic)
    if found.cloud is not None and found.camera is not None:
        return DepthRanges(model, found.camera, found.cloud, found.topic)
    if found.cloud is not None:
        return CloudRanges(model, found.cloud, found.topic)
    return laser.Ranges(model, found.mount, found.topic)


class Ros2Make:
    """Makes the robot that was found, of its model. Can be pickled."""

    real_time = True

    def __init__(self, found: Found) -> None:
        self.found = found

    def __call__(self, model: RobotModel) -> Ros2Robot:
        """A new one. CohelmError where the network can not be joined."""
        transport = self.found.connection.open(GATE, self.found.topics.namespace)
        return Ros2Robot(model, self.found, transport)


def adapted(found: Found) -> RobotAdapter:
    """The robot that was found, behind the port; called in the process that keeps it. CohelmError
    where the network can not be joined."""
    return RobotAdapter(Ros2Make(found)(found.model))


def same(message: Any, before: Any) -> bool:
    """Whether a message of a LiDAR is another one again, with its stamp and what it measured."""
    if message.header.stamp != before.header.stamp:
        return False
    field = next(one for one in ("ranges", "data", "range") if hasattr(message, one))
    return bool(np.array_equal(getattr(message, field), getattr(before, field), equal_nan=True))


def _near(age: float) -> float:
    """Clocks agree to 20 ms: what is younger than now by less is of now. Stamps of zero, or of
    another clock, are as old as readings can be."""
    return 0.0 if -0.02 < age < 0.0 else min(age, OLDEST)


def topics_of(pairs: Sequence[str]) -> Topics:
    """From `odom=/odom` and the like; `scan_NAME=` is of a further LiDAR, `contact_NAME=` of a
    bumper or cliff sensor. CohelmError for what is none of them."""
    names = ("out", "scan", "odom", "lock", "namespace", "camera", "footprint")
    named: dict[str, str] = {}
    several: dict[str, list[str]] = {"scan_": [], "contact_": []}
    for pair in pairs:
        key, equals, name = pair.partition("=")
        of = next((one for one in several if key.startswith(one)), "")
        if of and name:
            several[of].append(pair.removeprefix(of))
            continue
        if key not in names or not (name or (equals and key in ("lock", "camera"))):
            raise CohelmError(
                f"{pair!r}: name topics as KEY=NAME, KEY one of {', '.join(names)}, scan_NAME, "
                "contact_NAME"
            )
        named[key] = name
    return Topics.named(**named, further=several["scan_"], contacts=several["contact_"])
