"""Messages over the reliable stream: see `messages`."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Pose
from cohelm.link.codec import UpTo, array, blob, checked, reported, text, whole
from cohelm.link.messages import (
    Alarm,
    Answer,
    Discs,
    Long,
    ScanPart,
    Short,
    Status,
    Time,
    Uplink,
    Words,
)

LARGEST_BULK = 32_000_000
"""Bytes of a bulk message."""
MOST_WAYPOINTS = 500
MOST_DOCKS = 50

Huge = Annotated[int, whole("Q")]
FileName = Annotated[str, text(255)]
"""As long as the longest."""
Whole = Annotated[str, text(400)]
"""A text that no datagram has room for."""


def _finite(points: NDArray[np.float64]) -> str:
    return "" if np.isfinite(points).all() else "a waypoint that is not a finite number"


class Hello(NamedTuple):
    """Bulk, first: the robot's description."""

    name: Words
    outline: Annotated[NDArray[np.float32], array("f4", 2, 64)]
    """(k, 2), convex, counter-clockwise, in the body frame [m]."""
    v_max: float
    """[m/s]"""
    omega_max: float
    """[rad/s]"""
    camera: tuple[float, float, float, float]
    """Vertical angle of view [rad], x and z of its mount [m], tilt down [rad]; NaN: no camera."""
    carry_on: bool
    """In shared and automatic mode it drives on alone when its operator is lost."""


class LineKind(IntEnum):
    """Kind of a polyline."""

    REFERENCE = 0
    DETOUR = 1
    """The present detour; else no points."""
    WAYPOINTS = 2


class Polyline(NamedTuple):
    """Bulk: points in the map, joined; replaces the earlier of its kind."""

    what: LineKind
    points: Annotated[NDArray[np.float32], array("f4", 2, 100_000)]
    """(n, 2) [m]"""


class Map(NamedTuple):
    """Bulk: an occupancy grid, or a rectangle of one."""

    number: Long
    """Counts up with each new map; parts of one map share it."""
    origin: Pose
    """Of the lower left corner of the whole."""
    resolution: float
    """Side of a cell [m]."""
    width: Short
    height: Short
    """Cells of the whole."""
    column: Short
    row: Short
    """Where this part begins, from the lower left."""
    columns: Short
    rows: Short
    cells: Annotated[bytes, blob(LARGEST_BULK - 1000)]
    """zlib of rows * columns bytes, row by row from below: 0 free .. 100 occupied, 255 unknown."""


class Zone(IntEnum):
    """Kind of a zone."""

    KEEP_OUT = 0
    SPEED = 1


class ZoneMap(NamedTuple):
    """Bulk: all keep-out zones, or all speed zones; replaces the earlier of its kind. Without cells
    there are none."""

    what: Zone
    origin: Pose
    """Of the lower left corner, in the map."""
    resolution: float
    """Side of a cell [m]."""
    usual: float
    """The speed of which cells are percents [m/s]; NaN: not known."""
    columns: Short
    rows: Short
    cells: Annotated[bytes, blob(LARGEST_BULK - 1000)]
    """zlib of rows * columns bytes, row by row from below: 0 none; keep-out 100; else the most
    speed that is asked for, 1 .. 100 percent of the usual one."""


class DockPlace(NamedTuple):
    """A dock."""

    name: Whole
    pose: Pose
    """Of the docked robot, in the map."""
    approach: float
    """Length of the straight way that ends there [m]."""


class Docks(NamedTuple):
    """Bulk: where the robot can dock; replaces the earlier ones."""

    all: Annotated[tuple[DockPlace, ...], UpTo(MOST_DOCKS)]


class HealthReport(NamedTuple):
    """Bulk: battery and faults; sent at every change."""

    battery: float
    """Share of its charge, in hundredths."""
    faults: Annotated[tuple[Whole, ...], UpTo(16)]


class WholeAlarm(NamedTuple):
    """An alarm, and its text, of which a status has only the beginning."""

    alarm: Alarm
    text: Whole


class Alarms(NamedTuple):
    """Bulk: all alarms, the worst first; sent at every change."""

    all: Annotated[tuple[WholeAlarm, ...], UpTo(32)]


class Picture(NamedTuple):
    """Bulk: one picture of the camera; a newer one replaces one not sent yet."""

    number: Long
    taken: Time
    """The robot's clock [s]."""
    pose: Pose
    """Of the body in the map, then."""
    jpeg: Annotated[bytes, blob(4_000_000)]


class RecordInfo(NamedTuple):
    """A record on the robot."""

    name: FileName
    size: Huge
    """[byte]"""
    started: Annotated[float, reported("d")]
    """Unix time; a label only [s]."""


class Records(NamedTuple):
    """Bulk: the records on the robot, newest first."""

    all: Annotated[tuple[RecordInfo, ...], UpTo(1000)]


class Piece(NamedTuple):
    """Bulk: a piece of a record, requested with `Fetch`; an empty one is the end."""

    name: FileName
    offset: Huge
    data: Annotated[bytes, blob(1_000_000)]


class Digest(NamedTuple):
    """Bulk: size and hash of a record, requested with `Fetch`."""

    name: FileName
    size: Huge
    """[byte]"""
    sha256: Annotated[bytes, blob(32)]
    """Of these bytes; empty where there are none to be had."""
    why: Whole
    """Why not; empty: they can be had."""


class Checked(NamedTuple):
    """Bulk: the result of checking proposed waypoints."""

    answer: Answer
    worst: Short
    """Index of the refused waypoint, from 0; 65535: none."""


class Waypoints(NamedTuple):
    """Bulk, up: waypoints to be checked and, if accepted, followed."""

    number: Long
    """Of the proposal; the answer has it again."""
    points: Annotated[NDArray[np.float64], checked(array("f8", 2, MOST_WAYPOINTS), _finite)]
    """(n, 2) in the map [m]"""
    only_check: bool
    """Check them only, do not follow them."""


class Fetch(NamedTuple):
    """Bulk, up: request part of a record; an empty name requests the list."""

    name: FileName
    offset: Huge = 0
    """From which byte on."""
    size: Long = 0
    """Number of bytes; 0: request size and hash."""


FromOperator: TypeAlias = Uplink | Waypoints | Fetch
FromRobot: TypeAlias = (
    Status | ScanPart | Discs | Hello | Polyline | Map | ZoneMap | Docks | HealthReport | Alarms
    | Picture | Records | Piece | Digest | Checked
)  # fmt: skip
Message: TypeAlias = FromOperator | FromRobot
"""What may go either way."""


def slot_of(message: object) -> object:
    """What a published message replaces: the last one with the same slot."""
    if isinstance(message, Polyline | ZoneMap):
        return type(message), message.what
    return (Map, message.column, message.row) if isinstance(message, Map) else type(message)
