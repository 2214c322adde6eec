"""The robot's messages as the page gets them, and what the station adds to them."""

from __future__ import annotations

import json
import math
import re
import struct
from enum import IntEnum
from typing import Any, cast

import numpy as np

from cohelm import __version__
from cohelm.core.types import Floats
from cohelm.link import messages as robot
from cohelm.link.bulk_messages import Map, Picture, ZoneMap
from cohelm.station import messages as page
from cohelm.station.robot_link import ReplayLink

_PERSON = re.compile(r"(?<=\bstop by )[^()]* \((\d+)\)|^[^()]* \((\d+)\)(?= pressed stop$)")
"""Who pressed stop, as the robot has it: the certificate's name, and the client's number."""
_LOST = re.compile(r"^(the driver|the stick) is lost(?=:)")
MOST_POINTS = 2000
"""Most rows of one array sent to a page; a longer line is thinned out."""


def shown(message: tuple[Any, ...], **more: float) -> str:
    """A message of the robot as JSON, with its name as `type`. more: fields beside its own."""
    beside = {name: _plain(number) for name, number in more.items()}
    return json.dumps({"type": type(message).__name__} | _fields(message) | beside)


def _fields(message: Any) -> dict[str, Any]:
    return {name: _plain(part) for name, part in message._asdict().items()}


def _plain(value: Any) -> Any:
    """Numbers rounded, null for one that is not finite; an enumeration by its name; a row of
    numbers, as a pose, is an array, and null where one of them is not known."""
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, np.ndarray):
        return _rows(cast(Floats, value))
    if not isinstance(value, tuple):
        return value
    parts = cast(tuple[Any, ...], value)
    plain = [_plain(part) for part in parts]
    if parts and all(isinstance(part, float) for part in parts):
        return None if None in plain else plain
    return _fields(parts) if hasattr(parts, "_fields") else [x for x in plain if x is not None]


def _rows(rows: Floats) -> list[list[float]]:
    """(n, k) to millimetres, thinned out to `MOST_POINTS`, without rows that are not finite."""
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) > MOST_POINTS:
        rows = rows[np.linspace(0, len(rows) - 1, MOST_POINTS).astype(int)]
    return rows.astype(np.float64).round(3).tolist()


def welcome(name: str, key: str, stale: float, link: object) -> page.Welcome:
    """The first message to a page."""
    recorded = link if isinstance(link, ReplayLink) else None
    return page.Welcome(
        you=name, key=key, version=__version__, stale_s=stale,
        replay_s=recorded.duration if recorded else None,
    )  # fmt: skip


def who(lease: robot.Lease, names: dict[int, str], operators: list[str]) -> page.Who:
    """The driver. names: of the robot's clients that are pages of this station, and of those that
    were until a moment ago. operators: whose page is there."""

    def name(number: int, own_name: str) -> str | None:
        if number == 0:
            return None
        known = names.get(number)
        if known is None:
            return f"{own_name or 'unnamed'} ({number})"
        return known if known in operators else f"{known} (page closed)"

    left = lease.left if math.isfinite(lease.left) else None
    return page.Who(
        you_drive=lease.you == lease.driver != 0,
        driver=name(lease.driver, lease.driver_name),
        driver_lost=lease.left == 0.0 and lease.driver not in (0, lease.you),
        requester=name(lease.requester, lease.requester_name), requester_client=lease.requester,
        you_request=lease.requester == lease.you != 0,
        left_s=None if left is None else math.ceil(max(left, 0.0)), operators=operators,
    )  # fmt: skip


def whole(status: robot.Status, alarms: tuple[robot.Alarm, ...]) -> robot.Status:
    """With its alarms' whole texts, and with those for which it has no room; that of the stop is
    why it is stopped. alarms: all of them, as they were told last; what the status says is newer.
    """
    told = {alarm.number: alarm.text for alarm in alarms}

    def text(said: str, *known: str) -> str:
        cut = said.endswith("…")
        return next((one for one in known if cut and one.startswith(said[:-1])), said)

    worst = tuple(
        alarm._replace(text=text(alarm.text, told.get(alarm.number, ""))) for alarm in status.alarms
    )
    status = status._replace(
        alarms=worst, stopped=text(status.stopped, *told.values()),
        why=text(status.why, *told.values()),
    )  # fmt: skip
    if len(worst) < robot.MOST_ALARMS:
        return status
    numbers = {alarm.number for alarm in worst}
    more = tuple(alarm for alarm in alarms if alarm.number not in numbers)
    return status._replace(alarms=worst + more)


def persons(text: str, you: int, names: dict[int, str]) -> str:
    """A text of the robot with the page's name of who pressed stop, in place of the certificate's
    and the number. you: the number of the one who reads it. names: as `who` has them."""

    def called(match: re.Match[str]) -> str:
        number = int(match[1] or match[2])
        return "you" if number == you else names.get(number) or match[0]

    return _PERSON.sub(called, text)


def named(status: robot.Status, names: dict[int, str]) -> robot.Status:
    """With `persons` in its texts; a stop by a loss that is over, as its alarm is, says so."""

    def shown(text: str) -> str:
        return persons(text, status.lease.you, names)

    stopped, why = shown(status.stopped), shown(status.why)
    lost = _LOST.match(stopped)
    if lost and not any(one.active and one.text.startswith(lost[0]) for one in status.alarms):
        was = _LOST.sub(r"\1 was lost", stopped)
        stopped, why = was, was if why == stopped else why
    alarms = tuple(alarm._replace(text=shown(alarm.text)) for alarm in status.alarms)
    return status._replace(stopped=stopped, why=why, alarms=alarms)


# Binary messages to the page: maps, zones, scans and pictures. `web/src/binary.ts` reads them.
#
# Little-endian; the first four bytes are the type. Arrays begin at a multiple of eight bytes, so
# that the page can read them in place.


MAP, SCAN, FRAME, ZONES = 1, 2, 3, 4
_MAP = struct.Struct("<II4d6I")
_ZONES = struct.Struct("<II5d2I")
_SCAN = struct.Struct("<II6dII")
_FRAME = struct.Struct("<II4d")


def map_part(part: Map) -> bytes:
    """A map, or a rectangle of one; its cells stay compressed."""
    head = _MAP.pack(
        MAP, part.number, *part.origin, part.resolution, part.width, part.height,
        part.column, part.row, part.columns, part.rows,
    )  # fmt: skip
    return head + part.cells


def zones(message: ZoneMap) -> bytes:
    """Keep-out or speed zones; cells stay compressed."""
    head = _ZONES.pack(
        ZONES, message.what, *message.origin, message.resolution, message.usual, message.columns,
        message.rows,
    )  # fmt: skip
    return head + message.cells


def scan(whole: robot.ScanPart, age: float) -> bytes:
    """A whole scan. age: since it was taken [s]."""
    ranges = np.ascontiguousarray(whole.ranges, dtype="<u2")
    head = _SCAN.pack(
        SCAN, whole.number, *whole.sensor, whole.first, whole.step, _finite(age) * 1e3,
        len(ranges), whole.lidar,
    )  # fmt: skip
    return head + ranges.tobytes()


def frame(picture: Picture, age: float) -> bytes:
    """A picture of the camera, with the pose it was taken from."""
    head = _FRAME.pack(FRAME, picture.number, *picture.pose, _finite(age) * 1e3)
    return head + picture.jpeg


def _finite(age: float) -> float:
    return age if math.isfinite(age) else 0.0
