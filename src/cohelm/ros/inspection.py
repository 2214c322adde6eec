"""What has been received of a robot while it is inspected: messages, ages and rates, frames."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.robot.model import RobotModel
from cohelm.robot.sensors import LidarModel
from cohelm.ros import clock, depth
from cohelm.ros.clock import SimulatedClock, seconds
from cohelm.ros.contact import contact_topics
from cohelm.ros.mismatch import CAMERA_INFO, CLOUD, IMAGE, ODOMETRY, RANGE, SCAN, STAMPED, TF, TWIST
from cohelm.ros.names import resolved
from cohelm.ros.port import LATCHED, SENSOR, Received, Transport
from cohelm.ros.topics import Topics
from cohelm.ros.transforms import Mount, StaticTransforms

_READINGS, _SCANS = 15, 6
"""So many odometry readings and scans are looked at before anything moves."""
_KEPT = 200


class Came(NamedTuple):
    """A message with a stamp."""

    stamp: float
    """When it came, of this machine's monotonic clock [s]."""
    age: float
    """By this machine's wall clock [s]..."""
    simulated: float
    """... and by the simulator's; NaN: there is none [s]."""
    message: Any


class Inspection:
    """One look at a robot: what has come so far."""

    def __init__(self, transport: Transport, topics: Topics, model: RobotModel) -> None:
        self.topics, self.axle = topics, model.axle_x_m
        self.odometry: list[Came] = []
        self.scans: dict[str, list[Came]] = {topic: [] for topic in topics.of_lidars(model)}
        """By their topics, the first LiDAR's first."""
        described = zip(self.scans, (model.lidar, *model.further_lidars), strict=True)
        self.kinds = {topic: kind_of(lidar) for topic, lidar in described}
        self.infos: dict[str, list[Came]] = {
            topic: [] for topic, kind in self.kinds.items() if kind == IMAGE
        }
        """CameraInfo, by the topics of the depth images that it is of."""
        self.contacts = contact_topics(model, topics.of_contacts(model))
        self.touched: set[str] = set()
        """Topics of bumpers and cliff sensors on which anything came."""
        self.commands: list[float] = []
        """When each came [s]."""
        self.clock, self.simulated = SimulatedClock(), False
        """The latter: whether stamps are of the former, as `settle_time` found."""
        self.damage: dict[str, str] = {}
        """By topic, what was wrong with a message."""
        self.transforms = StaticTransforms()
        frames = LATCHED._replace(depth=100)
        self._ends = [
            transport.subscribe(*what)
            for what in (
                (clock.TOPIC, clock.TYPE, SENSOR, self.clock.on_message),
                (topics.odom, ODOMETRY, SENSOR, self._into(self.odometry, topics.odom)),
                *(
                    (topic, self.kinds[topic], SENSOR, self._into(rows, topic))
                    for topic, rows in self.scans.items()
                ),
                *(
                    (depth.info_topic(topic), CAMERA_INFO, SENSOR, self._into(rows, topic))
                    for topic, rows in self.infos.items()
                ),
                *(
                    (topic, kind, SENSOR, partial(self._touch, topic))
                    for topic, kind in {(one.topic, one.kind) for one in self.contacts}
                ),
                *((topics.command, kind, SENSOR, self._command) for kind in (TWIST, STAMPED)),
                *(
                    (name, TF, frames, self._transform)
                    for name in {"/tf_static", resolved("tf_static", topics.namespace)}
                ),
            )
        ]

    def end(self) -> None:
        """Receive no more."""
        for one in self._ends:
            one()

    def enough(self) -> bool:
        """Whether the sensors are known."""
        scans = min(map(len, self.scans.values()))
        complete = all(self.infos.values())
        complete = complete and all(one.topic in self.touched for one in self.contacts)
        return len(self.odometry) >= _READINGS and scans >= _SCANS and complete

    def framed(self) -> bool:
        """Whether it is known where every LiDAR is. CohelmError as `StaticTransforms.mount`."""
        if not self.odometry or not all(self.scans.values()):
            return False
        return all(
            self.transforms.between(self.frame(topic), self.body()) is not None
            for topic in self.scans
        )

    def mount(self, topic: str, option: str) -> Mount | None:
        """Where a planar LiDAR is, from the middle of the axle. CohelmError and option as there."""
        found = self.transforms.mount(self.frame(topic), self.body(), option)
        if found is None:
            return None
        return found._replace(pose=found.pose._replace(x=found.pose.x - self.axle))

    def into_body(self, topic: str) -> Floats | None:
        """From the frame of its messages into the body's, (4, 4); None: no transform."""
        found = self.transforms.between(self.frame(topic), self.body())
        if found is not None:
            found[0, 3] -= self.axle
        return found

    def settle_time(self) -> None:
        """Find out whether the stamps are of the time on /clock, and not of the wall's. CohelmError
        where that goes too fast."""
        newest = self.odometry[-1]
        if abs(newest.age) <= clock.MOST or not abs(newest.simulated) <= 1.0:  # nor for NaN
            return
        if self.clock.rate > clock.FASTEST:
            raise CohelmError(
                f"{clock.TOPIC} is {self.clock.rate:.1f} times as fast as the wall, and the "
                "filter counts with its own seconds: slow the simulator down to real time"
            )
        self.simulated = True

    def ages(self, rows: list[Came]) -> list[float]:
        """How old each was when it came [s]."""
        if not self.simulated:
            return [one.age for one in rows]
        return [one.simulated for one in rows if not math.isnan(one.simulated)]

    def rate(self, rows: list[Came]) -> float:
        """How many come a second [Hz]; of a simulator's."""
        if not self.simulated:
            return _rate([one.stamp for one in rows])
        return _rate([seconds(one.message.header.stamp) for one in rows])

    def command_period(self) -> float:
        """From one command to the next, in the middle of them all; NaN where too few came [s]."""
        steps = [b - a for a, b in pairwise(self.commands)]
        if len(steps) < 5:
            return math.nan
        usual = statistics.median(steps)
        return usual if 0.002 <= usual <= 1.0 else math.nan

    def frames(self, topic: str) -> list[str]:
        """In which the scans of this topic have come; of one LiDAR it is one."""
        return sorted({one.message.header.frame_id for one in self.scans[topic]})

    def frame(self, topic: str) -> str:
        """In which the newest scan of this topic is."""
        return self.scans[topic][-1].message.header.frame_id

    def body(self) -> str:
        """The frame of the base."""
        return self.odometry[-1].message.child_frame_id or "base_link"

    def odom(self) -> str:
        """The frame of the odometry's poses."""
        return self.odometry[-1].message.header.frame_id or "odom"

    def _into(self, rows: list[Came], topic: str) -> Callable[[Received], None]:
        def on_message(received: Received) -> None:
            message = received.message
            if message is None:
                self.damage[topic] = received.damage
                return
            stamp = seconds(message.header.stamp)
            ages = time.time() - stamp, self.clock.age(stamp)
            rows.append(Came(received.stamp, *ages, message))
            del rows[:-_KEPT]

        return on_message

    def _touch(self, topic: str, received: Received) -> None:
        if received.message is None:
            self.damage[topic] = received.damage
        else:
            self.touched.add(topic)

    def _command(self, received: Received) -> None:
        if received.message is not None:
            self.commands.append(received.stamp)

    def _transform(self, received: Received) -> None:
        if received.message is not None:
            self.transforms.add(received.message)


def kind_of(lidar: LidarModel | None) -> str:
    """The type of the messages of a LiDAR that is described so."""
    if lidar is not None and lidar.range_sensor:
        return RANGE
    if lidar is None or lidar.height_band_m is None:
        return SCAN
    return IMAGE if lidar.depth_image else CLOUD


def _rate(came: list[float]) -> float:
    """How many come a second, by when they did; but for the first ones, which discovery holds up
    [Hz]."""
    steps = [b - a for a, b in pairwise(came)]
    usual = statistics.mean(steps[len(steps) // 3 :])
    return min(max(1.0 / max(usual, 1e-3), 0.1), 1000.0)
