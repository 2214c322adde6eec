"""Twists that a viewer publishes over Foxglove's protocol: parses their messages."""

from __future__ import annotations

import asyncio
import json
import math
import struct
import time
from collections.abc import Callable
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from cohelm.core.types import Twist
from cohelm.drive.foxglove_teleop import ALIVE, FoxgloveTeleop
from cohelm.record.period import STORE

ENCODINGS = ("json", "cdr")
_TWIST, _STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
_KINDS = {
    "geometry_msgs/Twist": _TWIST, _TWIST: _TWIST,
    "geometry_msgs/TwistStamped": _STAMPED, _STAMPED: _STAMPED,
}  # fmt: skip
"""By their names in ROS 1 and ROS 2."""
_HEAD = struct.Struct("<BI")
"""Before a message's bytes: opcode and channel."""
_MAX_CHANNELS = 8
"""Channels of one viewer."""
_REPORT_PERIOD = 2.0
"""Least time from one reported refusal to the next [s]."""
_PING_PERIOD = 0.1
"""Period of pings [s]."""


class PublishedTwists:
    """The twists of one connection, in the server's loop; all but `keep_alive` returns at once."""

    def __init__(self, teleop: FoxgloveTeleop | None, report: Callable[[str], None]) -> None:
        """report: shows a sentence to the viewer; called from the server's loop."""
        self._teleop, self._report = teleop, report
        self._channels: dict[int, tuple[str, str]] = {}
        """Type and encoding of each."""
        self._event_loop: asyncio.AbstractEventLoop | None = None
        self._refusal_reported = -math.inf
        """When a refused twist was last reported [s]."""

    def advertise(self, channel: Any) -> None:
        """Open a channel. KeyError, TypeError for what is no channel."""
        number, topic = channel["id"], channel["topic"]
        name, encoding = channel["schemaName"], channel["encoding"]
        kind = _KINDS.get(name)
        if kind is None:
            self._report(f"{topic} is {name}: the robot is steered with {_TWIST} or TwistStamped")
        elif len(self._channels) >= _MAX_CHANNELS:
            self._report(f"{topic} is one too many: steer on one topic")
        elif encoding not in ENCODINGS:
            self._report(f"{topic} comes as {encoding}: it has to be {' or '.join(ENCODINGS)}")
        else:
            self._channels[int(number)] = kind, encoding

    def unadvertise(self, number: Any) -> None:
        """Close a channel."""
        if self._channels.pop(number, None) and not self._channels:
            self.gone()

    def take(self, data: bytes) -> None:
        """Take a message. ValueError, KeyError, TypeError or struct.error if it is malformed."""
        what, number = _HEAD.unpack_from(data)
        if what != 1:
            raise ValueError
        if number not in self._channels or self._teleop is None:
            return  # of a channel that was refused
        kind, encoding = self._channels[number]
        twist = twist_of(data[_HEAD.size :], kind, encoding)
        self._event_loop = asyncio.get_running_loop()
        why, now = self._teleop.publish(self, twist, self._say), time.monotonic()
        if why and now - self._refusal_reported > _REPORT_PERIOD:
            self._refusal_reported = now
            self._report(why)

    def gone(self) -> None:
        """The viewer publishes no more."""
        if self._teleop is not None:
            self._teleop.gone(self)

    async def keep_alive(self, connection: ServerConnection) -> None:
        """Ping the viewer all the time, where it may steer."""
        while self._teleop is not None:
            try:
                answer = await connection.ping()
                async with asyncio.timeout(ALIVE):
                    await answer
                self._teleop.answered(self)
            except TimeoutError:
                pass
            except ConnectionClosed:
                return
            await asyncio.sleep(_PING_PERIOD)

    def _say(self, text: str) -> None:
        """Show a sentence; called from another thread."""
        if self._event_loop is not None:
            self._event_loop.call_soon_threadsafe(self._report, text)


def twist_of(data: bytes, kind: str, encoding: str) -> Twist:
    """A message's twist. ValueError, KeyError, TypeError or struct.error if it is malformed."""
    if encoding == "json":
        found: Any = json.loads(data)
        found = found["twist"] if kind == _STAMPED else found
        return Twist(float(found["linear"]["x"]), float(found["angular"]["z"]))
    try:
        message: Any = STORE.deserialize_cdr(data, kind)
    except Exception as error:  # whatever bytes do to it
        raise ValueError from error
    message = message.twist if kind == _STAMPED else message
    return Twist(float(message.linear.x), float(message.angular.z))
