"""Bumpers and cliff sensors over ROS 2: reads their messages, and keeps the newest of each."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any, NamedTuple

from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__Range as Range,
    std_msgs__msg__Bool as Bool,
)

from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Contact
from cohelm.ros.cone import rep117_range
from cohelm.ros.mismatch import BOOL, RANGE
from cohelm.ros.port import SENSOR, Received, Transport
from cohelm.ros.types import HAZARD, HAZARDS, store

CREATE_3 = (
    "bump_front_center", "bump_front_left", "bump_front_right", "bump_left", "bump_right",
    "cliff_front_left", "cliff_front_right", "cliff_side_left", "cliff_side_right",
)  # fmt: skip
"""The frames of an iRobot Create 3's bumpers and cliff sensors."""


class ContactTopic(NamedTuple):
    """Where the messages of one sensor come."""

    model: ContactModel
    topic: str
    kind: str


def kind_of_contact(model: ContactModel) -> str:
    """The type of its messages."""
    if model.hazard is not None:
        return HAZARDS
    ranges = isinstance(model, CliffModel) and model.floor_m is not None
    return RANGE if ranges else BOOL


def usual_topic(model: ContactModel) -> str:
    """Where its messages are by default."""
    if model.hazard is not None:
        return "hazard_detection"
    return f"{'cliff' if isinstance(model, CliffModel) else 'bumper'}_{model.name}"


def doubt(model: ContactModel) -> str:
    """Why it may never be on, though its messages come; empty: nothing is known."""
    if model.hazard is None or model.hazard in CREATE_3:
        return ""
    return (
        f"{model.label}: hazard {model.hazard!r} is no frame of a Create 3, and with a wrong one "
        f"it is never on: try it, or choose {', '.join(CREATE_3)}"
    )


def is_on(model: ContactModel, message: Any) -> bool | None:
    """Whether a message reports contact; None: no statement, as a range that was not measured."""
    if model.hazard is not None:
        frames = (one.header.frame_id.lstrip("/") for one in message.detections)
        return model.hazard in frames
    if not isinstance(model, CliffModel) or model.floor_m is None:
        return bool(message.data)
    low, high = float(message.min_range), float(message.max_range)
    measured = rep117_range(float(message.range), low, high)
    if math.isnan(measured):
        return None
    # Drivers that know no inf send the largest range, which may be less than the drop.
    return measured > model.floor_m + model.drop_m or measured >= high


class Contacts:
    """Subscribes to all of a robot's. Each message counts as of its arrival."""

    def __init__(
        self, transport: Transport, topics: tuple[ContactTopic, ...], now: Callable[[], float]
    ) -> None:
        """now: the robot's clock [s]."""
        self._now, self._lock = now, threading.Lock()
        self._newest: dict[str, Contact] = {}
        self._unread: set[str] = set()
        """Those that were on since they were read last, if only for a moment."""
        for one in topics:
            transport.subscribe(one.topic, one.kind, SENSOR, partial(self._on_message, one.model))

    def read(self) -> tuple[Contact, ...]:
        """The newest of each that has been received."""
        with self._lock:
            unread, self._unread = self._unread, set()
            newest = tuple(self._newest.values())
        return tuple(one._replace(on=one.on or one.sensor in unread) for one in newest)

    def _on_message(self, model: ContactModel, received: Received) -> None:
        on = None if received.message is None else is_on(model, received.message)
        if on is None:
            return
        now = self._now()
        with self._lock:
            self._newest[model.name] = Contact(now, model.name, on)
            if on:
                self._unread.add(model.name)


def contact_topics(model: RobotModel, topics: tuple[str, ...]) -> tuple[ContactTopic, ...]:
    """Of all its sensors, in the order of their models."""
    return tuple(
        ContactTopic(one, topic, kind_of_contact(one))
        for one, topic in zip(model.contacts, topics, strict=True)
    )


def contact_messages(
    topics: Sequence[ContactTopic], on: Collection[str], header: Any
) -> list[tuple[str, Any]]:
    """The messages that a robot's own driver would publish, one for each topic. on: the names of
    those that are on."""
    made: dict[str, Any] = {}
    detection, vector = (store().types[name] for name in (HAZARD, HAZARDS))
    for model, topic, kind in topics:
        if kind == HAZARDS:
            made.setdefault(topic, vector(header, []))
            if model.name in on:
                made[topic].detections.append(detection(_framed(header, model.hazard), 1))
        elif kind == RANGE and isinstance(model, CliffModel):
            far = 0.0 if model.floor_m is None else model.floor_m
            there = math.inf if model.name in on else far
            made[topic] = Range(header, Range.INFRARED, 0.1, 0.001, 2.0 * far + 1.0, there, 0.0)
        else:
            made[topic] = Bool(model.name in on)
    return list(made.items())


def _framed(header: Any, frame: str | None) -> Any:
    return type(header)(header.stamp, frame)
