"""What a transport of ROS 2 messages offers: publish, subscribe, and list endpoints.

Messages are those of rosbags' typestore, names those that ROS users see (`/cmd_vel`,
`geometry_msgs/msg/Twist`). Reception is stamped with this machine's monotonic clock.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from cohelm.core.errors import CohelmError


class Qos(NamedTuple):
    """Quality of service, as far as it decides which endpoints match."""

    reliable: bool = True
    """What is lost is sent again; as a subscriber: nothing else will do."""
    transient_local: bool = False
    """Late subscribers get the last ones too; as a subscriber: nothing else will do."""
    depth: int = 1
    """How many of the last messages count."""


SENSOR = Qos(reliable=False, depth=5)
"""Of subscribers to sensors: matches every publisher, and nothing is sent twice."""
COMMAND = Qos(reliable=True, depth=1)
"""Of publishers of commands: matches every subscriber, and only the newest counts."""
LATCHED = Qos(reliable=True, transient_local=True, depth=1)
"""Published once, and kept for late subscribers: `/map`, `/tf_static`."""


class Endpoint(NamedTuple):
    """A publisher or subscriber of another node."""

    topic: str
    type: str
    qos: Qos
    publishes: bool
    node: str
    """Its node, where the graph says so; else empty."""


class Received(NamedTuple):
    """One message, as it came."""

    message: Any
    """None if it could not be read."""
    stamp: float
    """When it came, by this machine's monotonic clock [s]."""
    damage: str = ""
    """Why it could not be read."""
    sender: str = ""
    """The same for all messages of one publisher, and for no other's; empty where the transport
    does not tell."""


Callback = Callable[[Received], None]
End = Callable[[], None]
"""Ends a subscription; again it does nothing."""


def ensure_open(closed: threading.Event) -> None:
    """CohelmError where a transport is closed."""
    if closed.is_set():
        raise CohelmError("the transport is closed: make a new one")


class Publisher(Protocol):
    """Of one topic."""

    def send(self, message: Any) -> None:
        """To all subscribers, without waiting."""
        ...


class Transport(Protocol):
    """The port. Its calls may come from any thread; callbacks come from the transport's own."""

    @property
    def name(self) -> str:
        """Of the transport, for messages to the user."""
        ...

    @property
    def unseen(self) -> str:
        """What to check where no other node is seen, for the user."""
        ...

    def publish(self, topic: str, kind: str, qos: Qos) -> Publisher:
        """A new publisher of a topic with messages of a type."""
        ...

    def subscribe(self, topic: str, kind: str, qos: Qos, callback: Callback) -> End:
        """Calls `callback` with every message on a topic from now on, until what it returns is
        called. `callback` must not take long, nor raise."""
        ...

    def endpoints(self) -> list[Endpoint]:
        """All publishers and subscribers of others that are known by now; it takes a second or so
        until all are."""
        ...

    def lost(self) -> str:
        """Why nothing can come now, in a sentence; empty where nothing is known against it."""
        ...

    def close(self) -> None:
        """Leave; no callback afterwards."""
        ...


def reaches(offered: Qos, wanted: Qos) -> str:
    """Why a publisher with this quality of service never reaches a subscriber; empty: it does."""
    if wanted.reliable and not offered.reliable:
        return "the publisher is best effort and the subscriber wants reliable"
    if wanted.transient_local and not offered.transient_local:
        return "the publisher is volatile and the subscriber wants transient local"
    return ""
