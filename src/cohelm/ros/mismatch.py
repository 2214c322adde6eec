"""What does not fit between this node and the robot's topics: one sentence each, with its cure."""

from __future__ import annotations

import math
from collections.abc import Collection

from cohelm.ros.option_names import FILTER, OptionNames
from cohelm.ros.port import COMMAND, Endpoint, Qos, reaches

TWIST, STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
CLOUD, RANGE = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Range"
IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
TF = "tf2_msgs/msg/TFMessage"
BOOL = "std_msgs/msg/Bool"
POLYGON = "geometry_msgs/msg/PolygonStamped"
FILTER_INFO, GRID = "nav2_msgs/msg/CostmapFilterInfo", "nav_msgs/msg/OccupancyGrid"
GATE = "cohelm_gate"
"""The node that commands the base."""
_MOST_NAMED = 4
_OFTEN = 4.0
"""Scans a second: the slowest planar LiDARs that robots drive with turn five times."""


def nothing_received(
    topic: str, kind: str, qos: Qos, option: str, seen: list[Endpoint], damage: str = "",
    cure: str = "",
) -> str:  # fmt: skip
    """Why nothing is received on a topic. option: by which another one is named. damage: what was
    wrong with a message, if one came. cure: what to do where no node publishes it; by
    default to start a driver."""
    there = _publishers(topic, seen)
    right = [one for one in there if one.type == kind]
    if not there:
        cure = cure or f"start its driver, or name another topic with {option}"
        return f"no node publishes {topic}: {cure}{_others(kind, seen)}"
    if not right:
        band = ""
        if (there[0].type, kind) == (CLOUD, SCAN):
            band = ", or give this LiDAR a height_band_m in the robot's YAML file"
        if there[0].type == IMAGE and kind in (SCAN, CLOUD):
            band = ", or give it a height_band_m and depth_image: true in the robot's YAML file"
        if there[0].type == RANGE:
            band = ", or give it range_sensor: true in the robot's YAML file"
        return (
            f"{topic} is {there[0].type}{_by(there)}, and {kind} is needed: name another topic "
            f"with {option}{band}{_others(kind, seen)}"
        )
    reasons = [why for one in right if (why := reaches(one.qos, qos))]
    if len(reasons) == len(right):
        return f"{topic} never reaches this node: {reasons[0]}; fix the QoS of its publisher"
    if damage:
        return (
            f"what comes on {topic} can not be read ({damage}): is ROS_DISTRO here the robot's, "
            "and does its driver send what it says?"
        )
    stuck = f"is its driver stuck (ros2 topic hz {topic})"
    if qos.transient_local:
        stuck = "is its node not active yet (ros2 lifecycle get)"
    return f"{topic} is published{_by(right)}, but nothing comes: {stuck}, or a firewall between?"


def never(topic: str, kinds: tuple[str, ...], qos: Qos, option: str, seen: list[Endpoint]) -> str:
    """Why no publisher of a topic can be received; empty: one can, or there is none yet. kinds: of
    messages that can. option: as above."""
    there = _publishers(topic, seen)
    if not there or any(one.type in kinds and not reaches(one.qos, qos) for one in there):
        return ""
    kind = next((one.type for one in there if one.type in kinds), kinds[0])
    return nothing_received(topic, kind, qos, option, seen)


def base_type(
    topic: str, wanted: bool | None, seen: list[Endpoint], options: OptionNames = FILTER
) -> tuple[str, str]:
    """The type the base wants for its commands, and an error, or nothing.

    wanted: TwistStamped or Twist, as the user states; None: as the base's subscription says.
    """
    named = None if wanted is None else STAMPED if wanted else TWIST
    there = [one for one in seen if not one.publishes and one.topic == topic]
    kinds = sorted({one.type for one in there} & {TWIST, STAMPED})
    if not there:
        others = sorted(
            {one.topic for one in seen if not one.publishes and one.type in (TWIST, STAMPED)}
        )
        instead = f"; there is {', '.join(others[:_MOST_NAMED])}" if others else ""
        return named or TWIST, (
            f"no node subscribes to {topic}: start the base's driver, or name its topic with "
            f"{options.out}{instead}"
        )
    if not kinds:
        return named or TWIST, (
            f"{topic} is wanted as {there[0].type}{_by(there)}, and a base takes {TWIST} or "
            f"{STAMPED}: name another topic with {options.out}"
        )
    if named is not None and named not in kinds:
        return named, (
            f"{topic} is wanted as {kinds[0]}{_by(there)}: leave out --stamped and --unstamped, or "
            f"name another topic with {options.out}"
        )
    if named is None and len(kinds) > 1:
        return TWIST, (
            f"{topic} is wanted both as Twist and as TwistStamped{_by(there)}: {options.stamped}"
        )
    kind = named or kinds[0]
    right = [one for one in there if one.type == kind]
    reasons = [why for one in right if (why := reaches(COMMAND, one.qos))]
    if len(reasons) == len(right):
        return kind, (
            f"commands on {topic} never reach the base{_by(right)}: {reasons[0]}; fix the QoS of "
            "its subscription"
        )
    return kind, ""


def bypass(topic: str, seen: list[Endpoint], options: OptionNames = FILTER) -> str:
    """An error if another node commands the base past the filter; empty: none does."""
    there = _publishers(topic, seen)
    if not there:
        return ""
    if all(one.node.endswith(f"/{GATE}") for one in there):
        return (
            f"{topic} is published by another cohelm{_by(there)}: end that one first (one that "
            "was killed is gone after some seconds)"
        )
    return f"{topic} is published{_by(there)} as well, past the filter: {options.bypass}"


def commands(topic: str, out: str, period: float, seen: list[Endpoint]) -> str:
    """A notice on who publishes commands. out: the topic of safe commands, and so no controller's.
    period: from one command to the next; NaN: none came [s]."""
    there = _publishers(topic, seen)
    others = _publishing((TWIST, STAMPED), [one for one in seen if one.topic not in (topic, out)])
    instead = f"; there is {others}" if others else ""
    if not there:
        return f"commands: no node publishes {topic} yet{instead}"
    if not any(one.type in (TWIST, STAMPED) for one in there):
        return (
            f"commands: {topic} is {there[0].type}{_by(there)}, and {TWIST} or {STAMPED} is "
            f"needed: name another topic with --in{instead}"
        )
    came = "none yet" if math.isnan(period) else f"{1.0 / period:.0f} Hz"
    return f"commands: {topic}{_by(there)}, {came}"


def alone(topic: str, kind: str, what: str, seen: list[Endpoint]) -> tuple[str, str]:
    """Whether one thing is published by one node: a notice, and an error."""
    there = [one for one in _publishers(topic, seen) if one.type == kind]
    if len({one.node for one in there}) > 1:
        further = ", and describe a further LiDAR under further_lidars" if what == "LiDAR" else ""
        return "", (
            f"{topic} is published{_by(there)} at once, and one {what} is needed: remap one of "
            f"them{further} (one that was killed is gone after some seconds)"
        )
    if len(there) > 1:
        return f"{topic} is published twice{_by(there)}: are there two robots of that name?", ""
    return "", ""


def frames(topic: str, named: list[str], seen: list[Endpoint]) -> str:
    """That what comes on a topic is of two sensors; nothing where all is in one frame."""
    if len(named) < 2:
        return ""
    there = _publishers(topic, seen)
    return (
        f"{topic} comes in the frames {', '.join(map(repr, named[:_MOST_NAMED]))}{_by(there)}, and "
        "one LiDAR is needed: let each have a topic of its own, and describe the other under "
        "further_lidars"
    )


def lock(
    topic: str, seen: list[Endpoint], other: Collection[str] = (), options: OptionNames = FILTER
) -> tuple[str, str]:
    """A notice on who publishes the lock, and why it is never received, or nothing. other: topics
    that are known to be none."""
    others = _publishing((BOOL,), [one for one in seen if one.topic not in other])
    return _optional(
        "emergency stop", topic, BOOL, seen,
        f"; Bool is on {others}: is it that ({options.lock})?" if others else "",
        f", true while nothing may move: name another topic with {options.lock}{options.no_lock}",
    )  # fmt: skip


def footprint(topic: str, seen: list[Endpoint], options: OptionNames = FILTER) -> tuple[str, str]:
    """A notice on who publishes the robot's outline, and why it is never received, or nothing."""
    return _optional(
        "footprint", topic, POLYGON, seen, " yet; that of the robot's file counts",
        f": name another topic with {options.footprint}",
    )  # fmt: skip


def _optional(
    what: str, topic: str, kind: str, seen: list[Endpoint], missing: str, cure: str
) -> tuple[str, str]:
    """A notice and an error about a topic that may have no publisher."""
    there = _publishers(topic, seen)
    if not there:
        return f"{what}: no node publishes {topic}{missing}", ""
    wrong = [one for one in there if one.type != kind]
    if wrong:
        needed = f"and {kind} is needed{cure}{_others(kind, seen)}"
        return "", f"{topic} is {wrong[0].type}{_by(wrong)}, {needed}"
    return f"{what}: {topic}{_by(there)}", ""


def no_camera_info(topic: str, info: str, seen: list[Endpoint]) -> str:
    """That a depth image has no CameraInfo."""
    return (
        f"nothing is received on {info}, where the {CAMERA_INFO} of {topic} has to be: let its "
        f"driver publish that beside the images, or remap it there{_others(CAMERA_INFO, seen)}"
    )


def no_frame(
    topic: str, frame: str, body: str, known: list[str], options: OptionNames = FILTER
) -> str:
    """That no transform says where a sensor is mounted."""
    if not frame:
        return (
            f"{topic} names no frame (its header.frame_id is empty), so /tf_static can not say "
            "where it is mounted: give its driver one (mostly the parameter frame_id)"
            f"{options.mount}"
        )
    frames_there = f"it has {', '.join(known[:8])}" if known else "it is empty"
    return (
        f"{topic} is measured in the frame {frame!r}, and /tf_static does not say where that is "
        f"on {body!r} ({frames_there}): start robot_state_publisher or "
        f"static_transform_publisher{options.mount}"
    )


def two_places(topic: str, places: str) -> str:
    """That transforms contradict each other about where a sensor is mounted."""
    return (
        f"{topic} may be in two places: /tf_static has two places {places}: end the node that "
        "publishes the wrong one (a static_transform_publisher beside robot_state_publisher?)"
    )


def seldom(topic: str, rate: float) -> str:
    """That a sensor's readings are too rare to drive by, as they are in a robot's file; empty: they
    are not."""
    if rate >= 1.0:
        return ""
    return (
        f"{topic} comes once in {1.0 / rate:.1f} s, which is too seldom to drive by: let its "
        "driver publish it at least once a second"
    )


def slow(topic: str, rate: float) -> str:
    """That scans are too rare for what moves; empty: they are not."""
    if rate >= _OFTEN:
        return ""
    return (
        f"{topic} comes {rate:.1f} times a second: what moves is seen up to {1.0 / rate:.1f} s "
        f"late, and a lost LiDAR after {3.5 / rate:.1f} s: let its driver scan more often, or "
        "drive slowly among people (limits.speed_mps)"
    )


def _publishers(topic: str, seen: list[Endpoint]) -> list[Endpoint]:
    return [one for one in seen if one.publishes and one.topic == topic]


def _by(there: list[Endpoint]) -> str:
    nodes = sorted({one.node for one in there if one.node})
    return f" by {', '.join(nodes[:_MOST_NAMED])}" if nodes else ""


def _others(kind: str, seen: list[Endpoint]) -> str:
    name, topics = kind.split("/")[-1], _publishing((kind,), seen)
    return f"; {name} is on {topics}" if topics else f"; there is no {name} at all"


def _publishing(kinds: tuple[str, ...], seen: list[Endpoint]) -> str:
    topics = sorted({one.topic for one in seen if one.publishes and one.type in kinds})
    return ", ".join(topics[:_MOST_NAMED])


def no_nodes(name: str, cure: str) -> str:
    """That nothing of ROS is seen at all. name, cure: of the transport."""
    return f"no node of ROS is seen ({name}): {cure}"
