"""The camera of a ROS 2 robot, for the operator's view; nothing that drives uses it."""

from __future__ import annotations

import logging
import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.robot.port import Encoded, Frame
from cohelm.ros import mismatch
from cohelm.ros.clock import Clock, SimulatedClock, seconds
from cohelm.ros.mismatch import IMAGE
from cohelm.ros.port import SENSOR, Endpoint, Received, Transport

COMPRESSED = "sensor_msgs/msg/CompressedImage"
OLDEST = 10.0
"""A stamp that is older, or in the future, is none: the picture is of when it came [s]."""
_FORWARD, _BACKWARD = slice(0, 3), slice(2, None, -1)
_ENCODINGS = {
    "rgb8": (3, _FORWARD), "bgr8": (3, _BACKWARD), "8UC3": (3, _BACKWARD), "rgba8": (4, _FORWARD),
    "bgra8": (4, _BACKWARD), "mono8": (1, _FORWARD), "8UC1": (1, _FORWARD),
}  # fmt: skip
"""Bytes of a pixel, and which of them are red, green and blue; of grey, the one."""
_log = logging.getLogger("cohelm.ros")


class CameraTopic(NamedTuple):
    """Where pictures come from."""

    name: str
    kind: str


def choose(named: str | None, seen: list[Endpoint]) -> tuple[CameraTopic | None, str]:
    """The camera to look through, and a sentence about it, or nothing.

    named: the topic of `sensor_msgs/msg/CompressedImage` or `Image`; empty: none; None: the only
    compressed one there is. CohelmError for a named one that can not be looked through.
    """
    there = {one.topic: one.type for one in seen if one.publishes}
    if named:
        kind = there.get(named, "")
        if kind not in (COMPRESSED, IMAGE):
            raise CohelmError(
                mismatch.nothing_received(named, COMPRESSED, SENSOR, "--topic camera=TOPIC", seen)
            )
        return CameraTopic(named, kind), ""
    found = sorted(
        topic
        for topic, kind in there.items()
        if kind == COMPRESSED and "depth" not in topic.lower()
    )
    if named is None and len(found) == 1:
        return CameraTopic(found[0], COMPRESSED), f"pictures: {found[0]}"
    if named is None and found:
        some = ", ".join(found[:4])
        return None, f"pictures: none of {some}; choose one with --topic camera=TOPIC"
    return None, ""


class Camera:
    """Keeps the newest picture of a topic."""

    def __init__(
        self, transport: Transport, topic: CameraTopic, clock: Clock,
        simulated: SimulatedClock | None = None,
    ) -> None:  # fmt: skip
        """clock: of the picture's stamps. simulated: the simulator's instead."""
        self._topic, self._clock, self._simulated = topic, clock, simulated
        self._lock, self._number = threading.Lock(), -1
        self._newest: tuple[int, Any] | None = None
        self._last_error = ""
        self._end = transport.subscribe(*topic, SENSOR, self._on_image)

    def __call__(self, now: float) -> Frame | Encoded | None:
        """The newest picture, once. now: of the robot's clock [s]."""
        with self._lock:
            newest, self._newest = self._newest, None
        if newest is None:
            return None
        number, message = newest
        try:
            age = (self._simulated or self._clock).age(seconds(message.header.stamp))
            stamp = now - (age if 0.0 <= age <= OLDEST else 0.0)
            if self._topic.kind == COMPRESSED:
                return Encoded(stamp, number, bytes(message.data))
            return Frame(stamp, number, pixels(message))
        except CohelmError as error:
            if str(error) != self._last_error:
                self._last_error = str(error)
                _log.warning("%s: %s", self._topic.name, error)
            return None

    def close(self) -> None:
        """Look no more."""
        self._end()

    def _on_image(self, received: Received) -> None:
        if received.message is None:
            return
        with self._lock:
            self._number += 1
            self._newest = self._number, received.message


def pixels(image: Any) -> NDArray[np.uint8]:
    """Of a `sensor_msgs/msg/Image`, (height, width, 3), RGB; a view, nothing is copied. CohelmError
    for what is none."""
    encoding, width, height = str(image.encoding), int(image.width), int(image.height)
    if encoding not in _ENCODINGS:
        raise CohelmError(
            f"pictures encoded as {encoding!r} can not be shown; there are "
            f"{', '.join(_ENCODINGS)}, or the compressed topic beside it"
        )
    deep, colours = _ENCODINGS[encoding]
    row, data = int(image.step), np.asarray(image.data, dtype=np.uint8)
    if width < 1 or height < 1 or row < deep * width or len(data) < row * height:
        raise CohelmError(
            f"a picture of {width} x {height} pixels in rows of {row} bytes does not fit its "
            f"{len(data)} bytes"
        )
    rows = data[: row * height].reshape(height, row)[:, : deep * width]
    return np.broadcast_to(rows.reshape(height, width, deep)[:, :, colours], (height, width, 3))
