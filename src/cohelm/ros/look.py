"""Finds out what a ROS 2 robot offers: topics, types, rates, mounts, clocks; and what is amiss."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.robot.model import RobotModel
from cohelm.ros import clock, laser, mismatch
from cohelm.ros.clock import Clock, estimated, seconds
from cohelm.ros.connection import Connection
from cohelm.ros.mismatch import ODOMETRY, SCAN, STAMPED, TF, TWIST
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
    namespace: str = "/"

    @classmethod
    def named(
        cls, namespace: str = "/", command: str = "/cmd_vel_nav", out: str = "/cmd_vel",
        scan: str = "/scan", odom: str = "/odom",
    ) -> Topics:  # fmt: skip
        """As somebody names them: in a namespace, if there is one, also those with a slash before
        them that are there by default. CohelmError for what is no name."""
        space = namespace_of(namespace)
        inside = [
            resolved(name.lstrip("/") if name == default else name, space)
            for name, default in zip(
                (command, out, scan, odom), cls._field_defaults.values(), strict=False
            )
        ]
        return cls(*inside, namespace=space)


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


class Found(NamedTuple):
    """A ROS 2 robot, as it was found. Can be pickled."""

    topics: Topics
    model: RobotModel
    """As described, with the LiDAR and the rates that were found."""
    out_type: str
    body: str
    """Frame of the base, from the odometry."""
    odom: str
    """Frame of the odometry's poses."""
    mount: Mount
    odom_clock: Clock
    scan_clock: Clock
    stamped_at_end: bool
    """Whether scans are stamped when their last beam was measured, not their first."""
    command_period: float
    """From one command to the next, as the controller sends them; NaN: none came [s]."""
    notes: tuple[str, ...]
    """What was found, and what was made of it; a sentence each."""
    connection: Connection = Connection()
    """By which it was found."""


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
    heard = _Heard(transport, topics)
    end, least = time.monotonic() + wait, time.monotonic() + _LEAST
    while time.monotonic() < end and not over():
        time.sleep(0.05)
        if time.monotonic() < least or not heard.enough():
            continue
        framed = allowed.mount_from_model or heard.mount() is not None
        listened = not drives or any(
            not one.publishes and one.topic == topics.out for one in transport.endpoints()
        )
        if framed and listened:
            break
    return heard.found(model, allowed, drives)


class _Heard:
    """What has come so far."""

    def __init__(self, transport: Transport, topics: Topics) -> None:
        self._transport, self._topics = transport, topics
        self._odometry: list[tuple[float, float, Any]] = []
        self._scans: list[tuple[float, float, Any]] = []
        self._commands: list[float] = []
        self._damage: dict[str, str] = {}
        self._transforms = StaticTransforms()
        transport.subscribe(topics.odom, ODOMETRY, SENSOR, self._into(self._odometry, topics.odom))
        transport.subscribe(topics.scan, SCAN, SENSOR, self._into(self._scans, topics.scan))
        for kind in (TWIST, STAMPED):
            transport.subscribe(topics.command, kind, SENSOR, self._command)
        for name in {"/tf_static", resolved("tf_static", topics.namespace)}:
            transport.subscribe(name, TF, LATCHED._replace(depth=100), self._transform)

    def enough(self) -> bool:
        """Whether the sensors are known."""
        return len(self._odometry) >= _READINGS and len(self._scans) >= _SCANS

    def mount(self) -> Mount | None:
        """Of the LiDAR, as far as it is known. CohelmError as `StaticTransforms.mount`."""
        if not self._odometry or not self._scans:
            return None
        return self._transforms.mount(self._frame(), self._body())

    def found(self, model: RobotModel, allowed: Allowed, drives: bool) -> Found:
        """All of it. CohelmError for what does not fit."""
        seen, topics = self._transport.endpoints(), self._topics
        if not seen and not self._odometry and not self._scans:
            raise CohelmError(mismatch.nobody(self._transport.name, self._transport.unseen))
        wrong: list[str] = []
        notes = [f"transport: {self._transport.name}"]
        for topic, kind, came, option in (
            (topics.odom, ODOMETRY, self._odometry, "--odom"),
            (topics.scan, SCAN, self._scans, "--scan"),
        ):
            if len(came) < 3:
                damage = self._damage.get(topic, "")
                wrong.append(mismatch.unheard(topic, kind, SENSOR, option, seen, damage))
        out_type = TWIST
        if drives:
            out_type, amiss = mismatch.base_type(topics.out, allowed.stamped, COMMAND, seen)
            past = "" if allowed.bypass else mismatch.bypass(topics.out, seen)
            wrong += [one for one in (amiss, past) if one]
            notes.append(f"commands to the base: {topics.out}, {out_type}")
        if wrong:
            raise CohelmError("\n".join(wrong))
        try:
            return self._sensed(model, allowed, out_type, notes)
        except ValueError as error:  # a LiDAR model that is none
            raise CohelmError(f"{topics.scan}: {error}") from error

    def _sensed(
        self, model: RobotModel, allowed: Allowed, out_type: str, notes: list[str]
    ) -> Found:
        topics = self._topics
        odom_clock = estimated([age for _, age, _ in self._odometry], topics.odom, allowed.clock)
        mount = self._placed(model, allowed)
        scan = self._scans[-1][2]
        late, duration = laser.taken(scan, mount)
        ages = [age - duration - late for _, age, _ in self._scans]
        at_end = -(duration + clock.AHEAD) <= min(ages) < -_LATE
        if at_end:
            ages = [age + duration for age in ages]
        scan_clock = estimated(ages, topics.scan, allowed.clock)
        odom_rate, scan_rate = _rate(self._odometry), _rate(self._scans)
        lidar = laser.lidar_model(
            scan, topics.scan, mount, scan_rate, min(ages) + scan_clock.ahead, model.lidar
        )
        odometry = model.odometry.model_copy(update={"rate_hz": odom_rate})
        made = model.model_copy(update={"lidar": lidar, "odometry": odometry})
        period = _period(self._commands)
        notes += [
            f"odometry: {topics.odom}, {odom_rate:.0f} Hz, {self._odom()} -> {self._body()}",
            f"LiDAR: {topics.scan}, {scan_rate:.1f} Hz, {lidar.beams} beams over "
            f"{lidar.field_of_view_deg:.0f} deg, at x {lidar.mount_x_m:.3f} y "
            f"{lidar.mount_y_m:.3f} m, "
            f"middle beam at {lidar.mount_yaw_deg:.1f} deg"
            + (", upside down" if mount.upside_down else ""),
            *(_differs(name, one) for name, one in ((topics.odom, odom_clock),
              (topics.scan, scan_clock)) if one.ahead),
        ]  # fmt: skip
        if at_end:
            notes.append(f"{topics.scan} is stamped at the end of each scan, and taken so")
        if not math.isnan(period):
            notes.append(f"commands: {topics.command}, {1.0 / period:.0f} Hz")
        else:
            notes.append(f"commands: {topics.command}, none yet")
        return Found(
            topics, made, out_type, self._body(), self._odom(), mount, odom_clock, scan_clock,
            at_end, period, tuple(notes),
        )  # fmt: skip

    def _placed(self, model: RobotModel, allowed: Allowed) -> Mount:
        """Where the LiDAR is."""
        if not allowed.mount_from_model:
            mount = self._transforms.mount(self._frame(), self._body())
            if mount is not None:
                return mount
        if allowed.mount_from_model and model.lidar is not None:
            given = model.lidar
            return Mount(
                Pose(given.mount_x_m, given.mount_y_m, math.radians(given.mount_yaw_deg)),
                False, 0.0,
            )  # fmt: skip
        raise CohelmError(
            mismatch.no_frame(
                self._topics.scan, self._frame(), self._body(), self._transforms.frames()
            )
        )

    def _frame(self) -> str:
        return self._scans[-1][2].header.frame_id

    def _body(self) -> str:
        return self._odometry[-1][2].child_frame_id or "base_link"

    def _odom(self) -> str:
        return self._odometry[-1][2].header.frame_id or "odom"

    def _into(self, rows: list[tuple[float, float, Any]], topic: str) -> Callable[[Received], None]:
        def heard(received: Received) -> None:
            message = received.message
            if message is None:
                self._damage[topic] = received.damage
                return
            rows.append((received.stamp, time.time() - seconds(message.header.stamp), message))
            del rows[:-200]

        return heard

    def _command(self, received: Received) -> None:
        if received.message is not None:
            self._commands.append(received.stamp)

    def _transform(self, received: Received) -> None:
        if received.message is not None:
            self._transforms.add(received.message)


def _rate(came: list[tuple[float, float, Any]]) -> float:
    """How many come a second; by the median, as discovery holds the first ones up [Hz]."""
    steps = [b[0] - a[0] for a, b in pairwise(came)]
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
