"""The messages that this node publishes: commands, diagnostics, its reason, markers."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

from rosbags.typesys.stores.ros2_jazzy import (
    diagnostic_msgs__msg__DiagnosticArray as DiagnosticArray,
    diagnostic_msgs__msg__DiagnosticStatus as DiagnosticStatus,
    diagnostic_msgs__msg__KeyValue as KeyValue,
    geometry_msgs__msg__TwistStamped as TwistStamped,
    std_msgs__msg__ColorRGBA as Colour,
    std_msgs__msg__String as String,
    visualization_msgs__msg__Marker as Marker,
    visualization_msgs__msg__MarkerArray as MarkerArray,
)

from cohelm.core.types import Floats, Twist
from cohelm.record import ros2
from cohelm.record.markers import marker
from cohelm.record.ros2 import header, pose
from cohelm.ros.mismatch import STAMPED

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
STRING = "std_msgs/msg/String"
OK, WARN, ERROR = 0, 1, 2
_COLOURS = {
    OK: Colour(0.2, 0.7, 0.3, 1.0), WARN: Colour(0.95, 0.6, 0.1, 1.0),
    ERROR: Colour(0.85, 0.15, 0.15, 1.0),
}  # fmt: skip


def command(twist: Twist, kind: str, frame: str, now: float | None = None) -> Any:
    """A `geometry_msgs/msg/Twist`, or a TwistStamped of now, by default the wall's [s]."""
    made = ros2.twist(twist)
    return TwistStamped(header(nanoseconds(now), frame), made) if kind == STAMPED else made


def nanoseconds(now: float | None) -> int:
    """Of a time [s], by default the wall's."""
    return time.time_ns() if now is None else round(1e9 * now)


def reason(text: str) -> Any:
    """A `std_msgs/msg/String`."""
    return String(text)


def diagnostics(
    name: str, robot: str, level: int, text: str, values: Mapping[str, object],
    now: float | None,
) -> Any:  # fmt: skip
    """A `diagnostic_msgs/msg/DiagnosticArray` with one status; numbers to four digits. now:
    None for the wall's [s]."""
    pairs = [KeyValue(key, _plain(value)) for key, value in values.items()]
    status = DiagnosticStatus(level, name, text, robot, pairs)
    return DiagnosticArray(header(nanoseconds(now), ""), [status])


def markers(
    outline: Floats, body: str, odom: str, level: int, limiting: tuple[float, float] | None,
    axle: float = 0.0,
) -> Any:  # fmt: skip
    """The outline in the colour of what the filter does, and what holds the robot back; both for
    the newest transforms that there are. axle: from which the outline is, in the body's frame."""
    here = pose(axle, 0.0, 0.0)
    corners = outline.tolist()
    drawn = [
        marker(
            header(0, body), "cohelm footprint", 0, Marker.LINE_STRIP, here, (0.02, 0.0, 0.0),
            _COLOURS[level], [*corners, *corners[:1]],
        )
    ]  # fmt: skip
    at = pose(*limiting, 0.0) if limiting is not None else here
    limit_marker = marker(
        header(0, odom), "cohelm limiting", 1, Marker.SPHERE, at, (0.12, 0.12, 0.12),
        _COLOURS[ERROR],
    )  # fmt: skip
    if limiting is None:
        limit_marker.action = Marker.DELETE
    both: list[Any] = [*drawn, limit_marker]
    return MarkerArray(both)


def _plain(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else str(value)
    return str(value)
