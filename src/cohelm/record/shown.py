"""Converts what the stations displayed to ROS 2 messages, and back.

| topic | type | what |
|---|---|---|
| `/diagnostics` | `DiagnosticArray` | driver, mode, stop, why, speed cap, alarms: `StatusWords` |
| `/map` | `OccupancyGrid` | the map |
| `/keep_out` | `OccupancyGrid` | keep-out zones, 100 |
| `/speed_zones` | `OccupancyGrid` | the most speed there, in percent of the usual one |
| `/reference`, `/waypoints` | `Path` | the way |
| `/obstacles` | `MarkerArray` | round obstacles: body, safe distance, velocity |
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    diagnostic_msgs__msg__DiagnosticArray as DiagnosticArray,
    diagnostic_msgs__msg__DiagnosticStatus as DiagnosticStatus,
    diagnostic_msgs__msg__KeyValue as KeyValue,
    nav_msgs__msg__MapMetaData as MapMetaData,
    nav_msgs__msg__OccupancyGrid as OccupancyGrid,
    std_msgs__msg__Header as Header,
    visualization_msgs__msg__Marker as Marker,
    visualization_msgs__msg__MarkerArray as MarkerArray,
)

from cohelm.core.types import Pose
from cohelm.link.bulk_messages import LineKind, Map, Polyline, Zone, ZoneMap
from cohelm.link.messages import Alarm, AlarmKind, Discs, Mode, Severity
from cohelm.link.recorded_status import StatusWords
from cohelm.record.markers import OBSTACLE_COLOUR, SAFE_COLOUR, marker
from cohelm.record.ros2 import header, path, pose, yaw

TOPICS = {
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/keep_out": "nav_msgs/msg/OccupancyGrid",
    "/speed_zones": "nav_msgs/msg/OccupancyGrid",
    "/reference": "nav_msgs/msg/Path",
    "/detour": "nav_msgs/msg/Path",
    "/waypoints": "nav_msgs/msg/Path",
    "/obstacles": "visualization_msgs/msg/MarkerArray",
}
_LINES = {
    LineKind.REFERENCE: "/reference", LineKind.DETOUR: "/detour", LineKind.WAYPOINTS: "/waypoints",
}  # fmt: skip
ZONES = {"/keep_out": Zone.KEEP_OUT, "/speed_zones": Zone.SPEED}
_LEVELS = {Severity.NOTICE: 0, Severity.WARNING: 1, Severity.ALARM: 2}
_UNKNOWN = 255


def to_messages(
    what: StatusWords | Map | ZoneMap | Polyline | Discs, stamp: int, frame: str
) -> Iterator[tuple[str, Any]]:
    """Topics and messages for it. stamp: [ns]. frame: of the map."""
    head = header(stamp, frame)
    match what:
        case StatusWords():
            yield "/diagnostics", DiagnosticArray(head, list(_words(what)))
        case Map():
            yield (
                "/map",
                _grid(what.cells, what.resolution, what.width, what.height, what.origin, head),
            )
        case ZoneMap():
            topic = next(topic for topic, zone in ZONES.items() if zone == what.what)
            grid = _grid(what.cells, what.resolution, what.columns, what.rows, what.origin, head)
            yield topic, grid
        case Polyline() if what.what in _LINES:
            yield _LINES[what.what], path(head, what.points)
        case Discs():
            markers: list[Any] = list(_markers(what, head))
            yield "/obstacles", MarkerArray(markers)
        case _:
            pass


def from_message(topic: str, message: Any) -> StatusWords | Map | ZoneMap | Polyline | Discs:
    """Inverse of `to_messages`: the content of a message on one of `TOPICS`."""
    match topic:
        case "/diagnostics":
            return _status_words(message)
        case "/map":
            return _map(message)
        case "/keep_out" | "/speed_zones":
            return _zones(topic, message)
        case "/obstacles":
            return _discs(message)
        case _:
            line = next(line for line, name in _LINES.items() if name == topic)
            at = [(p.pose.position.x, p.pose.position.y) for p in message.poses]
            return Polyline(line, np.array(at, dtype=np.float32).reshape(-1, 2))


def _words(texts: StatusWords) -> Iterator[Any]:
    ok, error = DiagnosticStatus.OK, DiagnosticStatus.ERROR
    yield _word(ok, "driver", texts.driver_name, number=texts.driver)
    yield _word(ok, "mode", texts.mode.name)
    yield _word(error if texts.stopped else ok, "stopped", texts.stopped)
    yield _word(ok, "why", texts.why)
    yield _word(ok, "speed cap", texts.cap_reason, metres_per_second=texts.speed_cap)
    for a in texts.alarms:
        yield _word(
            _LEVELS[a.severity], "alarm", a.text, number=a.number,
            active=int(a.active), acknowledged=int(a.acknowledged), kind=int(a.kind),
        )  # fmt: skip


def _word(level: int, name: str, text: str, **values: float) -> DiagnosticStatus:
    pairs = [KeyValue(key, str(value)) for key, value in values.items()]
    return DiagnosticStatus(level, name, text, "", pairs)


def _status_words(message: Any) -> StatusWords:
    by_name: dict[str, Any] = {}
    alarms: list[Alarm] = []
    severities = {level: severity for severity, level in _LEVELS.items()}
    for word in message.status:
        if word.name == "alarm":
            v = _values(word)
            alarms.append(
                Alarm(
                    int(v.get("number", 0)), severities.get(int(word.level), Severity.ALARM),
                    v.get("active") == 1, v.get("acknowledged") == 1, word.message,
                    AlarmKind.LOST if v.get("kind") == AlarmKind.LOST else AlarmKind.OTHER,
                )
            )  # fmt: skip
        else:
            by_name[word.name] = word

    def text(name: str) -> str:
        return str(by_name[name].message) if name in by_name else ""

    def value(name: str, key: str, default: float) -> float:
        return _values(by_name[name]).get(key, default) if name in by_name else default

    mode = text("mode")
    return StatusWords(
        int(value("driver", "number", 0)), text("driver"),
        Mode[mode] if mode in Mode.__members__ else Mode.HOLD, text("stopped"), text("why"),
        value("speed cap", "metres_per_second", math.inf), text("speed cap"), tuple(alarms),
    )  # fmt: skip


def _values(word: Any) -> dict[str, float]:
    return {pair.key: float(pair.value) for pair in word.values}


def _grid(
    packed: bytes, resolution: float, width: int, height: int, origin: Pose, head: Header
) -> OccupancyGrid:
    cells = np.frombuffer(zlib.decompress(packed), dtype=np.uint8)
    data = np.where(cells == _UNKNOWN, np.int8(-1), cells.astype(np.int8))
    about = MapMetaData(Time(0, 0), resolution, width, height, pose(*origin))
    return OccupancyGrid(head, about, data)


def _map(message: Any) -> Map:
    about = message.info
    return Map(
        1, _origin(about), round(float(about.resolution), 6), about.width, about.height, 0, 0,
        about.width, about.height, _cells(message),
    )  # fmt: skip


def _zones(topic: str, message: Any) -> ZoneMap:
    """What the usual speed is stands elsewhere."""
    about = message.info
    side = round(float(about.resolution), 6)
    return ZoneMap(
        ZONES[topic], _origin(about), side, math.nan, about.width, about.height, _cells(message)
    )


def _origin(about: Any) -> Pose:
    at = about.origin.position
    return Pose(at.x, at.y, yaw(about.origin.orientation))


def _cells(message: Any) -> bytes:
    cells = np.where(message.data < 0, np.uint8(_UNKNOWN), message.data.astype(np.uint8))
    return zlib.compress(cells.tobytes())


def _markers(discs: Discs, head: Header) -> Iterator[Marker]:
    """Three for each disc: its body, its safe distance, and where it is in a second."""
    for i, (x, y, vx, vy, radius, safe) in enumerate(discs.rows.tolist()):
        at, here = pose(x, y, 0.0), pose(0.0, 0.0, 0.0)
        body, ring = (2 * radius, 2 * radius, 0.2), (2 * safe, 2 * safe, 0.01)
        yield marker(head, "body", i, Marker.CYLINDER, at, body, OBSTACLE_COLOUR)
        yield marker(head, "safe", i, Marker.CYLINDER, at, ring, SAFE_COLOUR)
        course = [(x, y), (x + vx, y + vy)]
        yield marker(head, "velocity", i, Marker.LINE_STRIP, here, (0.03, 0.0, 0.0),
                     OBSTACLE_COLOUR, course)  # fmt: skip


def _discs(message: Any) -> Discs:
    bodies, rings, ways = (
        {m.id: m for m in message.markers if m.ns == name} for name in ("body", "safe", "velocity")
    )
    rows: list[list[float]] = []
    for i, body in bodies.items():
        if i not in rings or i not in ways:
            continue
        begin, end = ways[i].points
        rows.append([
            body.pose.position.x, body.pose.position.y, end.x - begin.x, end.y - begin.y,
            0.5 * body.scale.x, 0.5 * rings[i].scale.x,
        ])  # fmt: skip
    return Discs(0, np.array(rows, dtype=np.float32).reshape(-1, 6))
