"""Keys and liveliness tokens by which nodes of rmw_zenoh discover each other and exchange data.

As rmw_zenoh's own description has them (https://github.com/ros2/rmw_zenoh, docs/design.md): data
goes by `domain/topic/type/hash`, and each node, publisher and subscription declares a token.
"""

from __future__ import annotations

import hashlib
import os
import struct
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.ros.names import dds_type, ros_type
from cohelm.ros.port import Endpoint, Qos
from cohelm.ros.types import known, type_hash

SPACE = "@ros2_lv"
NO_HASH = "TypeHashNotSupported"
"""Of every type in ROS 2 Humble."""
_PUBLISHES = {"MP": True, "MS": False}
_BEST_EFFORT = "2"
_TRANSIENT_LOCAL, _VOLATILE = "1", "2"
_DEPTH = 42
"""Where a token names none."""
_NODE, _TOPIC, _QOS = 8, 9, 12
"""Positions in a token: of the node's name, the topic and the quality of service."""
_STAMPED = struct.Struct("<qqB")
_IDENTITY = 16
"""Bytes of a sender's."""


class Owner(NamedTuple):
    """A node, which has a session of its own."""

    domain: int
    session: str
    node: str
    namespace: str = "/"

    def token(self) -> str:
        """The node's own."""
        return f"{SPACE}/{self.domain}/{self.session}/0/0/NN/{self._named()}"

    def of(self, number: int, publishes: bool, topic: str, kind: str, qos: Qos) -> str:
        """A publisher's or subscriber's. number: its own among the node's, from 1."""
        return (
            f"{SPACE}/{self.domain}/{self.session}/0/{number}/{'MP' if publishes else 'MS'}/"
            f"{self._named()}/{_mangled(topic)}/{dds_type(kind)}/{hash_of(kind)}/{_quality(qos)}"
        )

    def _named(self) -> str:
        return f"%/{_mangled(self.namespace)}/{self.node}"


def everything(domain: int) -> str:
    """The key of all tokens in a domain."""
    return f"{SPACE}/{domain}/**"


def data_key(domain: int, topic: str, kind: str) -> str:
    """By which the messages of a topic go."""
    return f"{domain}/{topic.strip('/')}/{dds_type(kind)}/{hash_of(kind)}"


def hash_of(kind: str) -> str:
    """Of a type, in the ROS 2 distribution that `ROS_DISTRO` names."""
    return NO_HASH if os.environ.get("ROS_DISTRO") == "humble" else type_hash(kind)


def read(token: str) -> tuple[str, Endpoint] | None:
    """Parses a token: session, and publisher or subscriber; None for neither.

    Its quality of service is as declared: rmw_zenoh refuses nobody for it. A type with another
    definition than ours has a name that says so: it is never received under ours.
    """
    parts = token.split("/")
    if len(parts) <= _QOS or parts[0] != SPACE or parts[5] not in _PUBLISHES:
        return None
    space, name = parts[_NODE - 1].replace("%", "/"), parts[_NODE].replace("%", "/")
    topic, kind = parts[_TOPIC].replace("%", "/"), ros_type(parts[_TOPIC + 1])
    if _other(kind, parts[_TOPIC + 2]):
        kind += " of another definition (is ROS_DISTRO here the robot's?)"
    qos = _parsed_qos(parts[_QOS])
    node = f"{space.rstrip('/')}/{name.lstrip('/')}"
    return parts[2], Endpoint(topic, kind, qos, _PUBLISHES[parts[5]], node)


def attachment(number: int, stamp: int, identity: bytes) -> bytes:
    """What goes with each message: its number from 1, when it was sent [ns], and its sender (16
    bytes); rmw_zenoh 0.2.4 and later drop one without."""
    return _STAMPED.pack(number, stamp, len(identity)) + identity


def sender(attachment: bytes) -> str:
    """Of a message, by its attachment; empty where that names none."""
    if len(attachment) < _STAMPED.size + _IDENTITY:
        return ""
    return attachment[_STAMPED.size : _STAMPED.size + _IDENTITY].hex()


def identity(token: str) -> bytes:
    """Identity of a token's owner: a hash of our own, not the one that rmw_zenoh makes of it."""
    return hashlib.blake2b(token.encode(), digest_size=_IDENTITY).digest()


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _other(kind: str, type_hash: str) -> bool:
    try:
        return type_hash != hash_of(known(kind))
    except (CohelmError, ValueError):  # a custom type
        return False


def _quality(qos: Qos) -> str:
    reliable = "" if qos.reliable else _BEST_EFFORT
    lasting = _TRANSIENT_LOCAL if qos.transient_local else ""
    return f"{reliable}:{lasting}:,{'' if qos.depth == _DEPTH else qos.depth}:,:,:,,"


def _parsed_qos(text: str) -> Qos:
    reliable, lasting, history, *_ = [*text.split(":"), "", "", ""]
    depth = history.rpartition(",")[2]
    return Qos(
        reliable != _BEST_EFFORT, lasting == _TRANSIENT_LOCAL,
        int(depth) if depth.isdecimal() else _DEPTH,
    )  # fmt: skip
