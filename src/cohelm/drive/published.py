"""Twists that one who looks on publishes over Foxglove's protocol, from bytes to numbers."""

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
"""By the names that ROS 1 and ROS 2 have for them."""
_HEAD = struct.Struct("<BI")
"""Before a message's bytes: what it is, and the channel."""
_MOST = 8
"""Channels."""
_AGAIN = 2.0
"""What is refused is told no more often [s]."""
_ASKED = 0.1
"""From one question whether they are there to the next [s]."""


class PublishedTwists:
    """Of one connection; all but `vouch` is called from the server's loop and returns at once."""

    def __init__(self, teleop: FoxgloveTeleop | None, tell: Callable[[str], None]) -> None:
        """tell: says a sentence to them, from the server's loop."""
        self._teleop, self._tell = teleop, tell
        self._channels: dict[int, tuple[str, str]] = {}
        """Type and encoding of each."""
        self._turning: asyncio.AbstractEventLoop | None = None
        self._refused = -math.inf
        """When it was last told that a twist does not count [s]."""

    def advertise(self, channel: Any) -> None:
        """They will publish. KeyError, TypeError for what is no channel."""
        number, topic = channel["id"], channel["topic"]
        name, encoding = channel["schemaName"], channel["encoding"]
        kind = _KINDS.get(name)
        if kind is None:
            self._tell(f"{topic} is {name}: the robot is steered with {_TWIST} or TwistStamped")
        elif len(self._channels) >= _MOST:
            self._tell(f"{topic} is one too many: steer on one topic")
        elif encoding not in ENCODINGS:
            self._tell(f"{topic} comes as {encoding}: it has to be {' or '.join(ENCODINGS)}")
        else:
            self._channels[int(number)] = kind, encoding

    def unadvertise(self, number: Any) -> None:
        """They will publish no more on that."""
        if self._channels.pop(number, None) and not self._channels:
            self.gone()

    def take(self, data: bytes) -> None:
        """One message. ValueError, KeyError, TypeError or struct.error for what is none."""
        what, number = _HEAD.unpack_from(data)
        if what != 1:
            raise ValueError
        if number not in self._channels or self._teleop is None:
            return  # of a channel that was refused
        kind, encoding = self._channels[number]
        twist = twist_of(data[_HEAD.size :], kind, encoding)
        self._turning = asyncio.get_running_loop()
        why, now = self._teleop.publish(self, twist, self._say), time.monotonic()
        if why and now - self._refused > _AGAIN:
            self._refused = now
            self._tell(why)

    def gone(self) -> None:
        """They publish nothing any more."""
        if self._teleop is not None:
            self._teleop.gone(self)

    async def vouch(self, connection: ServerConnection) -> None:
        """Ask all the time whether they are there, while they may steer."""
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
            await asyncio.sleep(_ASKED)

    def _say(self, text: str) -> None:
        """From another thread."""
        if self._turning is not None:
            self._turning.call_soon_threadsafe(self._tell, text)


def twist_of(data: bytes, kind: str, encoding: str) -> Twist:
    """Of a message. ValueError, KeyError, TypeError or struct.error for what is none."""
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
