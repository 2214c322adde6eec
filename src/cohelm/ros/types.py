"""Message types from rosbags' typestore: their bytes (CDR), their hashes, the types for DDS."""

from __future__ import annotations

import os
from functools import cache
from importlib import import_module
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cohelm.core.errors import CohelmError
from cohelm.ros.mismatch import FILTER_INFO
from cohelm.ros.names import dds_type

HAZARD = "irobot_create_msgs/msg/HazardDetection"
HAZARDS = "irobot_create_msgs/msg/HazardDetectionVector"
_OTHERS = {
    HAZARD: """
        uint8 BACKUP_LIMIT=0
        uint8 BUMP=1
        uint8 CLIFF=2
        uint8 STALL=3
        uint8 WHEEL_DROP=4
        uint8 OBJECT_PROXIMITY=5
        std_msgs/Header header
        uint8 type
    """,
    HAZARDS: "std_msgs/Header header\nirobot_create_msgs/HazardDetection[] detections",
    FILTER_INFO: """
        std_msgs/Header header
        uint8 type
        string filter_mask_topic
        float32 base
        float32 multiplier
    """,
}
"""Types beside ROS 2's own: of iRobot's Create 3, the base of the TurtleBot 4, and of Nav2."""
_KNOWN = {
    "humble": Stores.ROS2_HUMBLE, "iron": Stores.ROS2_IRON, "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED, "lyrical": Stores.ROS2_LYRICAL, "rolling": Stores.LATEST,
}  # fmt: skip


def store() -> Typestore:
    """All message types of the ROS 2 distribution in `ROS_DISTRO`, by default Jazzy's. CohelmError
    for one that is none of them."""
    return _store(os.environ.get("ROS_DISTRO") or "jazzy")


@cache
def _store(name: str) -> Typestore:
    if name not in _KNOWN:
        raise CohelmError(
            f"ROS_DISTRO is {name!r}, and there are {', '.join(_KNOWN)}: set the robot's, or unset "
            "it for jazzy"
        )
    made = get_typestore(_KNOWN[name])
    for name, text in _OTHERS.items():
        made.register(get_types_from_msg(text, name))
    return made


def known(kind: str) -> str:
    """A known type. Raises CohelmError for an unknown one."""
    if kind not in store().fielddefs:
        raise CohelmError(f"{kind} is no message type of ROS 2's own: give one of those")
    return kind


def packed(message: Any, kind: str) -> bytes:
    """The bytes of a message. Raises CohelmError for one that does not fit its type."""
    try:
        return bytes(store().serialize_cdr(message, kind))
    except Exception as error:
        raise CohelmError(f"a {kind} can not be made of that: {error}") from error


def unpacked(data: bytes, kind: str) -> tuple[Any, str]:
    """The message in some bytes, or None and what is wrong with them: they may be anything."""
    try:
        return store().deserialize_cdr(data, kind), ""
    except Exception as error:  # rosbags raises of all kinds on bytes that are no message
        return None, f"{len(data)} bytes are no {kind} ({type(error).__name__})"


@cache
def type_hash(kind: str) -> str:
    """`RIHS01_...`, by which ROS 2 compares definitions of a type (REP-2011)."""
    return store().hash_rihs01(kind)


@cache
def wire(kind: str) -> Any:
    """A class for cyclonedds that carries the bytes of one message in `data`.

    cyclonedds learns the type from it, for discovery, and leaves the bytes to rosbags. A sample
    that only reports that its publisher has gone goes through `deserialize_key`.
    """
    described = _struct(kind)

    class Wire:
        __idl__ = described.__idl__
        __idl_annotations__ = described.__idl_annotations__
        __idl_field_annotations__ = described.__idl_field_annotations__

        def __init__(self, data: bytes) -> None:
            self.data = data

        def serialize(self, *_: Any, **__: Any) -> bytes:
            return self.data

        @classmethod
        def deserialize(cls, data: Any, *_: Any, **__: Any) -> Wire:
            return cls(bytes(data))

        @classmethod
        def deserialize_key(cls, data: Any, *_: Any, **__: Any) -> Wire:
            return cls(b"")

    return Wire


@cache
def _struct(kind: str) -> Any:
    make_idl_struct = import_module("cyclonedds.idl").make_idl_struct
    fields = {name: _field(desc) for name, desc in store().fielddefs[kind][1]}
    return make_idl_struct(kind.split("/")[-1], dds_type(kind), fields)


def _field(desc: Any) -> Any:
    """A field of rosbags as cyclonedds describes it."""
    types: Any = import_module("cyclonedds.idl").types
    node, inside = desc
    if node == Nodetype.BASE:
        name = inside[0]
        if name in ("byte", "char", "octet"):
            return types.uint8
        return {"bool": bool, "string": str}.get(name) or getattr(types, name)
    if node == Nodetype.NAME:
        return _struct(inside)
    of, length = _field(inside[0]), inside[1]
    if node == Nodetype.ARRAY:
        return types.array[of, length]
    return types.sequence[of, length] if length else types.sequence[of]
