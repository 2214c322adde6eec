"""Names of topics and types: as ROS users write them, and as DDS carries them."""

from __future__ import annotations

import re

from cohelm.core.errors import CohelmError

_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+\Z")
_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z")
_TYPE = re.compile(r"(\w+)::msg::dds_::(\w+)_\Z")


def resolved(name: str, namespace: str = "/") -> str:
    """A topic's full name: one without a leading slash is in the namespace.

    Raises CohelmError for what ROS 2 would not take for a name.
    """
    if not _NAME.match(name):
        raise CohelmError(
            f"{name!r} is no name of a topic: letters, digits and _ between slashes, such as "
            "/cmd_vel or front/scan"
        )
    return name if name.startswith("/") else f"{namespace_of(namespace).rstrip('/')}/{name}"


def namespace_of(text: str) -> str:
    """A namespace with its leading slash and no trailing one; `/` for none.

    Raises CohelmError for what ROS 2 would not take for one.
    """
    made = "/" + text.strip("/")
    if made != "/" and not _TOPIC.match(made):
        raise CohelmError(f"{text!r} is no namespace: give one such as /j100_0001")
    return made


def dds_topic(topic: str) -> str:
    """`/cmd_vel` is `rt/cmd_vel` to DDS."""
    return f"rt{topic}"


def ros_topic(topic: str) -> str:
    """The topic of a DDS topic's name; empty for one that is not of ROS (services, parameters)."""
    return topic[2:] if topic.startswith("rt/") else ""


def dds_type(kind: str) -> str:
    """`geometry_msgs/msg/Twist` is `geometry_msgs::msg::dds_::Twist_` to DDS."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


def ros_type(kind: str) -> str:
    """The type of a DDS type's name; another one unchanged."""
    found = _TYPE.match(kind)
    return f"{found[1]}/msg/{found[2]}" if found else kind
