"""Finds out what a ROS 2 robot offers: topics, types, rates, mounts, clocks; and what is amiss."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.robot.model import RobotModel
from cohelm.robot.sensors import LidarModel
from cohelm.ros import clock, cloud, cone, depth, laser, mismatch
from cohelm.ros.camera import CameraTopic
from cohelm.ros.clock import Clock, SimulatedClock, estimated, seconds
from cohelm.ros.connection import Connection
from cohelm.ros.contact import contact_topics, usual_topic
from cohelm.ros.mismatch import (
    CAMERA_INFO,
    CLOUD,
    IMAGE,
    ODOMETRY,
    RANGE,
    SCAN,
    STAMPED,
    TF,
    TWIST,
)  # fmt: skip
from cohelm.ros.names import namespace_of, resolved
from cohelm.ros.port import COMMAND, LATCHED, SENSOR, Received, Transport
from cohelm.ros.transforms import Mount, StaticTransforms

_READINGS, _SCANS = 15, 6
"""So many odometry readings and scans are looked at before anything moves..."""
_LEAST = 1.2
"""... for so long at least [s]: discovery takes its time, and controllers a few commands."""
_LATE = 0.005
"""Last beams that seem so far in the future belong to scans that are stamped at their end [s]."""


class Topics(NamedTuple):
    """Where what is, by full name."""

    command: str = "/cmd_vel_nav"
    out: str = "/cmd_vel"
    scan: str = "/scan"
    odom: str = "/odom"
    lock: str = "/emergency_stop"
    """Empty: none."""
    namespace: str = "/"
    further: tuple[tuple[str, str], ...] = ()
    """Of further LiDARs: name and topic. Of one that is not named here: /scan_NAME."""
    contacts: tuple[tuple[str, str], ...] = ()
    """The same of bumpers and cliff sensors: /bumper_NAME, /cliff_NAME, /hazard_detection."""
    camera: str | None = None
    """Of pictures; empty: none; None: the only one there is."""

    @classmethod
    def named(
        cls, namespace: str = "/", command: str = "/cmd_vel_nav", out: str = "/cmd_vel",
        scan: str = "/scan", odom: str = "/odom", lock: str = "/emergency_stop",
        further: Sequence[str] = (), contacts: Sequence[str] = (), camera: str | None = None,
    ) -> Topics:  # fmt: skip
        """As somebody names them: in a namespace, if there is one, also those with a slash before
        them that are there by default. further: `NAME=TOPIC` for each further LiDAR whose topic is
        not /scan_NAME; contacts: the same of bumpers and cliff sensors. CohelmError for what is
        no name."""
        space = namespace_of(namespace)
        inside = [
            name and resolved(name.lstrip("/") if name == default else name, space)
            for name, default in zip(
                (command, out, scan, odom, lock), cls._field_defaults.values(), strict=False
            )
        ]
        camera = resolved(camera, space) if camera else camera
        return cls(
            *inside, namespace=space, further=_pairs(further, "a further LiDAR's scans", space),
            contacts=_pairs(contacts, "a bumper or cliff sensor", space), camera=camera,
        )  # fmt: skip

    def of_lidars(self, model: RobotModel) -> tuple[str, ...]:
        """The topics of its LiDARs' scans, the first one first. CohelmError for a topic of a LiDAR
        that the robot does not have."""
        names, given = [lidar.name for lidar in model.further_lidars], dict(self.further)
        if strange := [name for name in given if name not in names]:
            raise CohelmError(
                f"{model.name} has no further LiDAR {strange[0]!r}: describe it under "
                "further_lidars in the robot's YAML file"
            )
        usual = (resolved(f"scan_{name}", self.namespace) for name in names)
        topics = (self.scan, *(given.get(*one) for one in zip(names, usual, strict=True)))
        if len(set(topics)) < len(topics):
            raise CohelmError(
                f"two LiDARs of {model.name} can not share a topic: {', '.join(topics)}"
            )
        return topics

    def of_contacts(self, model: RobotModel) -> tuple[str, ...]:
        """The topics of its bumpers and cliff sensors. CohelmError for one that the robot does not
        have."""
        given = dict(self.contacts)
        names = [one.name for one in model.contacts]
        if strange := [name for name in given if name not in names]:
            raise CohelmError(
                f"{model.name} has no bumper or cliff sensor {strange[0]!r}: describe it under "
                "bumpers or cliff_sensors in the robot's YAML file"
            )
        return tuple(
            given.get(one.name) or resolved(usual_topic(one), self.namespace)
            for one in model.contacts
        )


def _pairs(given: Sequence[str], what: str, space: str) -> tuple[tuple[str, str], ...]:
    """Names and topics. CohelmError for what is no `NAME=TOPIC`."""
    pairs = [one.partition("=") for one in given]
    if bad := [one for one, (_, _, topic) in zip(given, pairs, strict=True) if not topic]:
        raise CohelmError(f"{bad[0]!r}: name {what} as NAME=TOPIC")
    return tuple((name, resolved(topic, space)) for name, _, topic in pairs)


class Allowed(NamedTuple):
    """What somebody said instead of leaving it to be found out."""

    stamped: bool | None = None
    """Whether the base wants TwistStamped; None: as its subscription says."""
    bypass: bool = False
    """Whether others may drive the base past the filter."""
    mount_from_model: bool = False
    """Whether the robot's description says where the LiDAR is, and not /tf_static."""
    clock: float = clock.MOST
    """By how much clocks may differ [s]."""
    lock_silence: float = math.inf
    """Without a word on the lock's topic for so long the base is locked [s]."""


class FoundLidar(NamedTuple):
    """A LiDAR, as it was found."""

    topic: str
    mount: Mount
    clock: Clock
    stamped_at_end: bool
    """Whether scans are stamped when their last beam was measured, not their first."""
    cloud: Floats | None = None
    """(4, 4), of one that sends point clouds, depth images or single ranges: from their frame into
    the body's."""
    camera: depth.Camera | None = None
    """Of one that sends depth images."""


class Found(NamedTuple):
    """A ROS 2 robot, as it was found. Can be pickled."""

    topics: Topics
    model: RobotModel
    """As described, with the LiDARs and the rates that were found."""
    out_type: str
    body: str
    """Frame of the base, from the odometry."""
    odom: str
    """Frame of the odometry's poses."""
    odom_clock: Clock
    lidars: tuple[FoundLidar, ...]
    """The first one first."""
    command_period: float
    """From one command to the next, as the controller sends them; NaN: none came [s]."""
    notes: tuple[str, ...]
    """What was found, and what was made of it; a sentence each."""
    connection: Connection = Connection()
    """By which it was found."""
    bypass: bool = False
    """Whether others may drive the base past the filter."""
    lock_silence: float = math.inf
    """Without a word on the lock's topic for so long the base is locked [s]."""
    simulated: bool = False
    """Whether stamps are of the simulator's time on /clock."""
    camera: CameraTopic | None = None
    """What people look through; chosen for who drives."""


def look(
    transport: Transport, model: RobotModel, topics: Topics, allowed: Allowed | None = None,
    wait: float = 10.0, drives: bool = True, over: Callable[[], bool] = lambda: False,
) -> Found:  # fmt: skip
    """Look at a robot that stands.

    wait: for what is missing [s]. drives: whether the base is to be driven from here; else nobody
    has to listen to `topics.out`. over: whether to give up.

    Raises CohelmError with everything that does not fit, one sentence a line.
    """
    allowed = allowed or Allowed()
    heard = _Heard(transport, topics, model)
    end, least = time.monotonic() + wait, time.monotonic() + _LEAST
    try:
        while time.monotonic() < end and not over():
            time.sleep(0.05)
            if time.monotonic() < least or not heard.enough():
                continue
            framed = allowed.mount_from_model or heard.framed()
            listened = not drives or any(
                not one.publishes and one.topic == topics.out for one in transport.endpoints()
            )
            if framed and listened:
                break
        return heard.found(model, allowed, drives)
    finally:
        heard.end()


class _Came(NamedTuple):
    """A message with a stamp."""

    stamp: float
    """When it came, of this machine's monotonic clock [s]."""
    age: float
    """By this machine's wall clock [s]..."""
    simulated: float
    """... and by the simulator's; NaN: there is none [s]."""
    message: Any


class _Heard:
    """What has come so far."""

    def __init__(self, transport: Transport, topics: Topics, model: RobotModel) -> None:
        self._transport, self._topics = transport, topics
        self._odometry: list[_Came] = []
        self._scans: dict[str, list[_Came]] = {topic: [] for topic in topics.of_lidars(model)}
        """By their topics, the first LiDAR's first."""
        described = zip(self._scans, (model.lidar, *model.further_lidars), strict=True)
        self._kinds = {topic: kind_of(given) for topic, given in described}
        self._infos: dict[str, list[_Came]] = {
            topic: [] for topic, kind in self._kinds.items() if kind == IMAGE
        }
        """CameraInfo, by the topics of the depth images that it is of."""
        self._contacts = contact_topics(model, topics.of_contacts(model))
        self._touched: set[str] = set()
        """Topics of bumpers and cliff sensors on which anything came."""
        self._commands: list[float] = []
        self._clock, self._simulated = SimulatedClock(), False
        self._damage: dict[str, str] = {}
        self._transforms = StaticTransforms()
        frames = LATCHED._replace(depth=100)
        self._ends = [
            transport.subscribe(*what)
            for what in (
                (clock.TOPIC, clock.TYPE, SENSOR, self._clock.hear),
                (topics.odom, ODOMETRY, SENSOR, self._into(self._odometry, topics.odom)),
                *(
                    (topic, self._kinds[topic], SENSOR, self._into(rows, topic))
                    for topic, rows in self._scans.items()
                ),
                *(
                    (depth.info_topic(topic), CAMERA_INFO, SENSOR, self._into(rows, topic))
                    for topic, rows in self._infos.items()
                ),
                *(
                    (topic, kind, SENSOR, partial(self._touch, topic))
                    for topic, kind in {(one.topic, one.kind) for one in self._contacts}
                ),
                *((topics.command, kind, SENSOR, self._command) for kind in (TWIST, STAMPED)),
                *(
                    (name, TF, frames, self._transform)
                    for name in {"/tf_static", resolved("tf_static", topics.namespace)}
                ),
            )
        ]

    def end(self) -> None:
        """Hear no more."""
        for one in self._ends:
            one()

    def enough(self) -> bool:
        """Whether the sensors are known."""
        scans = min(map(len, self._scans.values()))
        told = all(self._infos.values())
        told = told and all(one.topic in self._touched for one in self._contacts)
        return len(self._odometry) >= _READINGS and scans >= _SCANS and told

    def framed(self) -> bool:
        """Whether it is known where every LiDAR is. CohelmError as `StaticTransforms.mount`."""
        if not self._odometry or not all(self._scans.values()):
            return False
        return all(
            self._transforms.between(self._frame(topic), self._body()) is not None
            for topic in self._scans
        )

    def found(self, model: RobotModel, allowed: Allowed, drives: bool) -> Found:
        """All of it. CohelmError for what does not fit."""
        seen, topics = self._transport.endpoints(), self._topics
        if not seen and not self._odometry and not any(self._scans.values()):
            raise CohelmError(mismatch.nobody(self._transport.name, self._transport.unseen))
        wrong: list[str] = []
        notes = [f"transport: {self._transport.name}"]
        for topic, kind, came, option in (
            (topics.odom, ODOMETRY, self._odometry, "--odom"),
            *(
                (topic, self._kinds[topic], rows, "--further-scan" if i else "--scan")
                for i, (topic, rows) in enumerate(self._scans.items())
            ),
        ):
            if len(came) < 3:
                damage = self._damage.get(topic, "")
                wrong.append(mismatch.unheard(topic, kind, SENSOR, option, seen, damage))
        wrong += [
            mismatch.no_camera_info(topic, depth.info_topic(topic), seen)
            for topic, rows in self._infos.items() if not rows
        ]  # fmt: skip
        silent = {(o.topic, o.kind) for o in self._contacts if o.topic not in self._touched}
        for topic, kind in sorted(silent):
            damage = self._damage.get(topic, "")
            wrong.append(mismatch.unheard(topic, kind, SENSOR, "--contact", seen, damage))
        notes += [f"{one.model.said}: {one.topic}, {one.kind}" for one in self._contacts]
        out_type = TWIST
        if drives:
            out_type, amiss = mismatch.base_type(topics.out, allowed.stamped, COMMAND, seen)
            past = "" if allowed.bypass else mismatch.bypass(topics.out, seen)
            wrong += [one for one in (amiss, past) if one]
            notes.append(f"commands to the base: {topics.out}, {out_type}")
        if topics.lock:
            locked, amiss = mismatch.lock(topics.lock, seen)
            wrong += [amiss] if amiss else []
            notes.append(locked)
        if wrong:
            raise CohelmError("\n".join(wrong))
        return self._sensed(model, allowed, out_type, notes)

    def _sensed(
        self, model: RobotModel, allowed: Allowed, out_type: str, notes: list[str]
    ) -> Found:
        topics = self._topics
        self._simulated = self._by_simulator()
        if self._simulated:
            notes.append(f"simulated time: {clock.TOPIC}, {self._clock.rate:.2f} of the wall's")
        odom_clock = estimated(self._ages(self._odometry), topics.odom, allowed.clock)
        odom_rate = self._rate(self._odometry)
        notes.append(
            f"odometry: {topics.odom}, {odom_rate:.0f} Hz, {self._odom()} -> {self._body()}"
        )
        described = (model.lidar, *model.further_lidars)
        lidars = [
            self._lidar(topic, given, allowed, notes)
            for topic, given in zip(self._scans, described, strict=True)
        ]
        clocks = [(topics.odom, odom_clock), *((one.topic, one.clock) for one, _ in lidars)]
        notes += [_differs(name, one) for name, one in clocks if one.ahead]
        notes += [
            f"{one.topic} is stamped at the end of each scan, and taken so"
            for one, _ in lidars if one.stamped_at_end
        ]  # fmt: skip
        odometry = model.odometry.model_copy(update={"rate_hz": odom_rate})
        models = [made for _, made in lidars]
        made = model.model_copy(
            update={
                "lidar": models[0],
                "further_lidars": tuple(models[1:]),
                "odometry": odometry,
            }
        )
        period = _period(self._commands)
        if not math.isnan(period):
            notes.append(f"commands: {topics.command}, {1.0 / period:.0f} Hz")
        else:
            notes.append(f"commands: {topics.command}, none yet")
        return Found(
            topics, made, out_type, self._body(), self._odom(), odom_clock,
            tuple(one for one, _ in lidars), period, tuple(notes), bypass=allowed.bypass,
            lock_silence=allowed.lock_silence, simulated=self._simulated,
        )  # fmt: skip

    def _by_simulator(self) -> bool:
        """Whether the stamps are of the time on /clock, and not of the wall's. CohelmError where
        that goes too fast."""
        newest = self._odometry[-1]
        if abs(newest.age) <= clock.MOST or not abs(newest.simulated) <= 1.0:  # nor for NaN
            return False
        if self._clock.rate > clock.FASTEST:
            raise CohelmError(
                f"{clock.TOPIC} is {self._clock.rate:.1f} times as fast as the wall, and the "
                "filter counts with its own seconds: slow the simulator down to real time"
            )
        return True

    def _ages(self, rows: list[_Came]) -> list[float]:
        """How old each was when it came [s]."""
        if not self._simulated:
            return [one.age for one in rows]
        return [one.simulated for one in rows if not math.isnan(one.simulated)]

    def _rate(self, rows: list[_Came]) -> float:
        """How many come a second [Hz]; of a simulator's."""
        if not self._simulated:
            return _rate([one.stamp for one in rows])
        return _rate([seconds(one.message.header.stamp) for one in rows])

    def _lidar(
        self, topic: str, given: LidarModel | None, allowed: Allowed, notes: list[str]
    ) -> tuple[FoundLidar, LidarModel]:
        """One LiDAR as it is, and as the robot's description will say it."""
        if given is not None and given.height_band_m is not None:
            return self._cloud(topic, given, allowed, notes)
        if given is not None and given.range_sensor:
            return self._cone(topic, given, allowed, notes)
        rows = self._scans[topic]
        mount, scan, rate = self._placed(topic, given, allowed), rows[-1].message, self._rate(rows)
        late, duration = laser.taken(scan, mount)
        ages = [age - duration - late for age in self._ages(rows)]
        at_end = -(duration + clock.AHEAD) <= min(ages) < -_LATE
        if at_end:
            ages = [age + duration for age in ages]
        ticks = estimated(ages, topic, allowed.clock)
        try:
            lidar = laser.lidar_model(scan, topic, mount, rate, min(ages) + ticks.ahead, given)
        except ValueError as error:  # a LiDAR model that is none
            raise CohelmError(f"{topic}: {error}") from error
        notes.append(
            f"LiDAR: {topic}, {rate:.1f} Hz, {lidar.beams} beams over "
            f"{lidar.field_of_view_deg:.0f} deg, at x {lidar.mount_x_m:.3f} y "
            f"{lidar.mount_y_m:.3f} m, middle beam at {lidar.mount_yaw_deg:.1f} deg"
            + (", upside down" if mount.upside_down else "")
        )
        return FoundLidar(topic, mount, ticks, at_end), lidar

    def _cloud(
        self, topic: str, given: LidarModel, allowed: Allowed, notes: list[str]
    ) -> tuple[FoundLidar, LidarModel]:
        """One that sends point clouds: what it sees and how finely is as described; or depth
        images, whose camera is asked too."""
        rows, body = self._scans[topic], self._body()
        matrix = self._transforms.between(self._frame(topic), body)
        if matrix is None:
            frames = self._transforms.frames()
            raise CohelmError(mismatch.no_frame(topic, self._frame(topic), body, frames))
        ages, rate = self._ages(rows), self._rate(rows)
        ticks = estimated(ages, topic, allowed.clock)
        x, y, z = matrix[:3, 3].tolist()
        lidar = given.model_copy(
            update={
                "rate_hz": rate, "sweep_s": 0.0, "mount_x_m": x, "mount_y_m": y,
                "latency_s": min(max(min(ages) + ticks.ahead, 0.0), 1.0),
            }
        )  # fmt: skip
        camera, what, grain = None, "point cloud", ""
        if infos := self._infos.get(topic):
            camera = depth.camera(infos[-1].message, depth.info_topic(topic))
            lidar = depth.described(camera, matrix, lidar, topic)
            ranges = depth.DepthRanges(lidar, camera, matrix, topic)
            what = f"depth image: {camera.width} x {camera.height}"
            grain = (
                f", over {lidar.field_of_view_deg:.0f} deg, middle beam at "
                f"{lidar.mount_yaw_deg:.1f} deg, {1e3 * camera.gap * lidar.range_max_m:.0f} mm "
                f"between rays at {lidar.range_max_m:g} m"
            )
        else:
            ranges = cloud.CloudRanges(lidar, matrix, topic)
        ranges.of(rows[-1].message)
        if lidar.floor is not None:
            grain += (
                f"; floor from {lidar.floor.from_m:g} to {lidar.floor.to_m:g} m, of which "
                f"{100.0 * ranges.floor_seen:.0f} % is seen now"
            )
        low, high = given.height_band_m or (0.0, 0.0)
        notes.append(
            f"{what}: {topic}, {rate:.1f} Hz, from {low:g} to {high:g} m above {body}, as "
            f"{lidar.beams} beams, at x {x:.3f} y {y:.3f} m{grain}"
        )
        pose = Pose(x, y, math.radians(lidar.mount_yaw_deg))
        return FoundLidar(topic, Mount(pose, False, z), ticks, False, matrix, camera), lidar

    def _cone(
        self, topic: str, given: LidarModel, allowed: Allowed, notes: list[str]
    ) -> tuple[FoundLidar, LidarModel]:
        """One that sends single ranges."""
        rows, body = self._scans[topic], self._body()
        matrix = self._transforms.between(self._frame(topic), body)
        if allowed.mount_from_model:
            matrix = _matrix(given)
        if matrix is None:
            frames = self._transforms.frames()
            raise CohelmError(mismatch.no_frame(topic, self._frame(topic), body, frames))
        ages, rate = self._ages(rows), self._rate(rows)
        ticks = estimated(ages, topic, allowed.clock)
        lidar = cone.described(
            rows[-1].message, topic, matrix, rate, min(ages) + ticks.ahead, given
        )  # fmt: skip
        near = lidar.range_min_m == lidar.range_max_m
        notes.append(
            f"range sensor: {topic}, {rate:.1f} Hz, "
            + (f"whether something is within {lidar.range_max_m:g} m" if near else
               f"from {lidar.range_min_m:g} to {lidar.range_max_m:g} m")
            + f" in {lidar.field_of_view_deg:.0f} deg, at x {lidar.mount_x_m:.3f} y "
            f"{lidar.mount_y_m:.3f} m, looks at {lidar.mount_yaw_deg:.1f} deg"
        )  # fmt: skip
        x, y, z = matrix[:3, 3].tolist()
        pose = Pose(x, y, math.radians(lidar.mount_yaw_deg))
        return FoundLidar(topic, Mount(pose, False, z), ticks, False, matrix), lidar

    def _placed(self, topic: str, given: LidarModel | None, allowed: Allowed) -> Mount:
        """Where a LiDAR is."""
        if not allowed.mount_from_model:
            mount = self._transforms.mount(self._frame(topic), self._body())
            if mount is not None:
                return mount
        elif given is not None:
            return Mount(
                Pose(given.mount_x_m, given.mount_y_m, math.radians(given.mount_yaw_deg)),
                False, math.nan if given.mount_z_m is None else given.mount_z_m,
            )  # fmt: skip
        frames = self._transforms.frames()
        raise CohelmError(mismatch.no_frame(topic, self._frame(topic), self._body(), frames))

    def _frame(self, topic: str) -> str:
        return self._scans[topic][-1].message.header.frame_id

    def _body(self) -> str:
        return self._odometry[-1].message.child_frame_id or "base_link"

    def _odom(self) -> str:
        return self._odometry[-1].message.header.frame_id or "odom"

    def _into(self, rows: list[_Came], topic: str) -> Callable[[Received], None]:
        def heard(received: Received) -> None:
            message = received.message
            if message is None:
                self._damage[topic] = received.damage
                return
            stamp = seconds(message.header.stamp)
            ages = time.time() - stamp, self._clock.age(stamp)
            rows.append(_Came(received.stamp, *ages, message))
            del rows[:-200]

        return heard

    def _touch(self, topic: str, received: Received) -> None:
        if received.message is None:
            self._damage[topic] = received.damage
        else:
            self._touched.add(topic)

    def _command(self, received: Received) -> None:
        if received.message is not None:
            self._commands.append(received.stamp)

    def _transform(self, received: Received) -> None:
        if received.message is not None:
            self._transforms.add(received.message)


def kind_of(lidar: LidarModel | None) -> str:
    """The type of the messages of a LiDAR that is described so."""
    if lidar is not None and lidar.range_sensor:
        return RANGE
    if lidar is None or lidar.height_band_m is None:
        return SCAN
    return IMAGE if lidar.depth_image else CLOUD


def _matrix(lidar: LidarModel) -> Floats:
    """Where it is by its description, level, (4, 4)."""
    yaw = math.radians(lidar.mount_yaw_deg)
    c, s = math.cos(yaw), math.sin(yaw)
    made: Floats = np.eye(4)
    made[:2, :2] = [[c, -s], [s, c]]
    made[:3, 3] = lidar.mount_x_m, lidar.mount_y_m, lidar.mount_z_m or 0.0
    return made


def _rate(came: list[float]) -> float:
    """How many come a second, by when they did; but for the first ones, which discovery holds up
    [Hz]."""
    steps = [b - a for a, b in pairwise(came)]
    usual = statistics.mean(steps[len(steps) // 3 :])
    return min(max(1.0 / max(usual, 1e-3), 0.1), 1000.0)


def _period(stamps: list[float]) -> float:
    """From one command to the next, in the middle of them all; NaN where too few came [s]."""
    steps = [b - a for a, b in pairwise(stamps)]
    if len(steps) < 5:
        return math.nan
    usual = statistics.median(steps)
    return usual if 0.002 <= usual <= 1.0 else math.nan


def _differs(topic: str, one: Clock) -> str:
    direction = "ahead of" if one.ahead > 0.0 else "behind"
    return (
        f"the clock that stamps {topic} is {abs(one.ahead):.3f} s {direction} this machine's: "
        "taken into account, up to the time a message is under way"
    )
