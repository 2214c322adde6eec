"""Publishes the robot's pose on its map (REP-105), the map, and the path that is driven."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__PoseWithCovarianceStamped as PoseWithCovarianceStamped,
    tf2_msgs__msg__TFMessage as TFMessage,
)

from cohelm.core.errors import CohelmError
from cohelm.core.frames import compose
from cohelm.core.types import Floats, Pose
from cohelm.link.bulk_messages import Map
from cohelm.perceive.pipeline import Seen
from cohelm.record import ros2
from cohelm.record.ros2 import header, transform
from cohelm.record.shown import TOPICS, to_messages
from cohelm.robot.port import Odometry
from cohelm.ros.clock import SimulatedClock
from cohelm.ros.found import Found
from cohelm.ros.mismatch import TF
from cohelm.ros.names import resolved
from cohelm.ros.port import COMMAND, LATCHED, Qos, Received, Transport

NODE = "cohelm_robot"
POSE, PATH = "geometry_msgs/msg/PoseWithCovarianceStamped", "nav_msgs/msg/Path"
MAP = "map"
"""Default frame of the map."""
_LISTENS = 2.0
"""Before the first transform: other publishers of it are discovered by then [s]."""
_EVERY = 0.03
"""From one transform to the next, at least [s]."""
_SENT = 256
"""So many own transforms are known again when the network brings them back."""


class LocatedPose(NamedTuple):
    """The robot's pose at the stamp of an odometry message."""

    stamp: float
    """By the clock that stamps the odometry [s]."""
    map_odom: Pose
    """The pose of the odometry's frame in the map."""
    pose: Pose
    """Of the body in the map: compose(map_odom, the odometry's pose)."""
    covariance: Floats
    """(3, 3) of `pose`, in x, y, psi."""


class Localized:
    """Of one robot that is localised on a map. `take` is called between two periods, and takes no
    time; what is sent leaves from a thread of its own."""

    def __init__(
        self, transport: Transport, found: Found, log: Callable[[str], None],
        frame: str = MAP, transforms: bool = True,
    ) -> None:  # fmt: skip
        """log: receives sentences for the user. frame: the map's. transforms: whether to publish
        map -> odom at all."""
        self._transport, self._found, self._log = transport, found, log
        self.frame, self._transforms = frame, transforms
        self._begins = time.monotonic() + _LISTENS
        space = found.topics.namespace
        own = resolved("tf", space)
        self._topics = tuple(dict.fromkeys((own, "/tf")))
        self._carries = ""
        """The topic with the base's transform odometry -> base."""
        self._other = ""
        """The parent that another node gives that frame."""
        self._warned_other = False
        self._refusals: set[str] = set()
        """Why messages could not be sent."""
        self._sent: deque[tuple[int, int]] = deque(maxlen=_SENT)
        self._tf: Any = None
        self._pose = transport.publish(resolved(f"{NODE}/pose", space), POSE, COMMAND)
        self._path = transport.publish(resolved(f"{NODE}/path", space), PATH, LATCHED)
        self._clock = SimulatedClock.on(transport) if found.simulated else None
        self._turn = threading.Condition()
        self._place: LocatedPose | None = None
        self._line: Floats | None = None
        self._map: Map | None = None
        self._seen: Floats | None = None
        self._drawn: Floats = np.empty((0, 3))
        self._newest = -math.inf
        self._over = False
        if transforms:
            frames = Qos(reliable=False, depth=100)
            for name in self._topics:
                transport.subscribe(name, TF, frames, self._into(name))
                transport.subscribe(f"{name}_static", TF, LATCHED, self._into(""))
        self._thread = threading.Thread(target=self._run, name="localized", daemon=True)
        self._thread.start()

    def take(self, seen: Seen, odometry: Odometry | None, now: float, line: Floats | None) -> None:
        """The newest state. odometry: the newest. now: of the robot's clock [s]. line: (n, 3), the
        poses of the path that is driven, None: there is none; published again when it changes."""
        with self._turn:
            if line is not None and line is not self._seen:
                self._line = self._seen = line
                self._turn.notify()
            if seen.lost or odometry is None or not np.isfinite(odometry.pose).all():
                self._place = None
                return
            stamp = self._stamp(now - odometry.stamp)
            if not stamp > self._newest:  # nor for NaN
                return
            self._newest = stamp
            map_odom = compose(seen.map_odom, seen.odom_received)
            at = compose(map_odom, odometry.pose)
            self._place = LocatedPose(stamp, map_odom, at, seen.covariance)
            self._turn.notify()

    def draw(self, known: Map) -> None:
        """The map that the robot is localised on, once."""
        with self._turn:
            self._map = known
            self._turn.notify()

    def close(self) -> None:
        """Publish no more; the transport is its owner's to close."""
        with self._turn:
            self._over = True
            self._turn.notify()
        self._thread.join()

    def _stamp(self, age: float) -> float:
        """By the clock that stamps the odometry, of what is so old [s]."""
        if self._clock is not None:
            return self._clock.time() - age
        return time.time() + self._found.odom_clock.ahead - age

    def _into(self, topic: str) -> Callable[[Received], None]:
        """The callback for the transforms of a topic; empty: the static ones."""
        odom, body = self._found.odom.lstrip("/"), self._found.body.lstrip("/")

        def on_transforms(received: Received) -> None:
            message = received.message
            for one in () if message is None else message.transforms:
                stamp = one.header.stamp
                child, parent = one.child_frame_id.lstrip("/"), one.header.frame_id.lstrip("/")
                if child == odom and (stamp.sec, stamp.nanosec) not in self._sent:
                    self._other = parent
                elif (child, parent) == (body, odom) and topic:
                    self._carries = topic

        return on_transforms

    def _run(self) -> None:
        while True:
            with self._turn:
                self._turn.wait_for(
                    lambda: self._over or self._place or self._map or self._line is not None
                )
                if self._over:
                    return
                place, self._place = self._place, None
                line, self._line = self._line, None
                drawn = None
                if time.monotonic() >= self._begins:
                    drawn, self._map = self._map, None
            try:
                if drawn is not None:
                    self._send_map(drawn)
                if line is not None and not np.array_equal(line, self._drawn):
                    self._drawn = line
                    self._path.send(path(line, self.frame, self._stamp(0.0)))
                if place is not None:
                    self._publish_pose(place)
            except CohelmError as error:  # the network has no room: the next may pass
                if str(error) not in self._refusals:
                    self._refusals.add(str(error))
                    self._log(str(error))
            time.sleep(_EVERY)

    def _send_map(self, drawn: Map) -> None:
        """Unless another node publishes one already."""
        topic = resolved("map", self._found.topics.namespace)
        for one in self._transport.endpoints():
            if one.publishes and one.topic == topic:
                publisher = one.node or "another node"
                self._log(f"{topic} is published by {publisher} already: cohelm publishes none")
                return
        ((_, message),) = to_messages(drawn, round(1e9 * self._stamp(0.0)), self.frame)
        self._transport.publish(topic, TOPICS["/map"], LATCHED).send(message)

    def _publish_pose(self, place: LocatedPose) -> None:
        self._pose.send(located(place, self.frame))
        if not self._transforms or time.monotonic() < self._begins:
            return
        odom = self._found.odom
        if self._other:
            if not self._warned_other:
                self._warned_other = True
                self._log(
                    f"{self._other} -> {odom} is published by another node (amcl, slam_toolbox?): "
                    f"cohelm publishes no {self.frame} -> {odom}; end that one, then start again"
                )
            return
        if self._tf is None:
            topic = self._carries or self._topics[0]
            self._tf = self._transport.publish(topic, TF, COMMAND)
            self._log(f"{self.frame} -> {odom} is published on {topic}")
            if not self._carries:
                self._log(
                    f"no node publishes {odom} -> {self._found.body} on {topic}, so ROS does not "
                    "see the robot on the map: let its driver do that (ros2_control: "
                    "enable_odom_tf), or robot_localization"
                )
        stamped = header(round(1e9 * place.stamp), self.frame)
        self._sent.append((stamped.stamp.sec, stamped.stamp.nanosec))
        self._tf.send(TFMessage([transform(stamped, odom, place.map_odom)]))


def located(place: LocatedPose, frame: str) -> Any:
    """A `geometry_msgs/msg/PoseWithCovarianceStamped`."""
    rows = np.zeros((6, 6))
    rows[np.ix_((0, 1, 5), (0, 1, 5))] = place.covariance
    return PoseWithCovarianceStamped(
        header(round(1e9 * place.stamp), frame),
        PoseWithCovariance(ros2.pose(*place.pose), rows.ravel()),
    )


def path(line: Floats, frame: str, stamp: float) -> Any:
    """A `nav_msgs/msg/Path` of poses (n, 3). stamp: [s]."""
    stamped = header(round(1e9 * stamp) if math.isfinite(stamp) else 0, frame)
    return ros2.path(stamped, line)
