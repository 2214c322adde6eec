"""The bytes of every message (docs/link.md)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Pose, Stick, Twist
from cohelm.link.codec import (
    FLAG,
    Field,
    Malformed,
    Reader,
    array,
    blob,
    checked,
    choice,
    many,
    real,
    record,
    text,
    told,
    whole,
)
from cohelm.link.messages import (
    Alarm,
    Answer,
    Arming,
    Ask,
    Checked,
    Command,
    Device,
    Digest,
    Discs,
    Fetch,
    FromOperator,
    FromRobot,
    Guarding,
    Health,
    Hello,
    Lease,
    Line,
    Localised,
    Map,
    Message,
    Mode,
    Picture,
    Piece,
    Polyline,
    RecordInfo,
    Records,
    Request,
    ScanPart,
    Severity,
    Status,
    Timing,
    Verdict,
    Waypoints,
    Zone,
    ZoneMap,
)

VERSION = 6
LARGEST = 1150
"""Bytes of a datagram's message; with DTLS, UDP and IPv6 around it, below 1280 (RFC 8200)."""
LARGEST_BULK = 32_000_000
MOST_BEAMS = 500
"""Beams in one ScanPart."""
_REASON = 128
"""Bytes of why the robot stands or slows: a sentence, as long as a datagram has room for."""
_REQUESTS_AT, _REQUEST_SIZE, _WHAT_AT = 50, 15, 4
"""Where a command's requests begin, how long each is, and where in it `what` stands (docs/link.md).
The byte before them is their number."""
MOST_WAYPOINTS = 500


class Header(NamedTuple):
    """In front of every message."""

    session: int
    """Drawn when the sender started; a new one means that it knows nothing of the old."""
    sequence: int
    """Counts up by one with each message of a session."""
    stamp: float
    """The sender's clock when it was sent [s]."""
    echo: float
    """Stamp of the newest message the sender has had from the other end; NaN: none yet."""
    hold: float
    """How long ago it came [s]; NaN with it."""


def _tuple(*parts: float) -> Any:
    return parts


_BYTE, _SHORT, _LONG, _HUGE = (whole(form) for form in "BHIQ")
_TIME, _TOLD = real("d"), told("f")
_POSE, _TWIST = record(Pose, _TOLD, _TOLD, _TOLD), record(Twist, _TOLD, _TOLD)
_DEFLECTION = real("f", -1.0, 1.0)
_STICK = record(Stick, _DEFLECTION, _DEFLECTION)
_POINT: Field[tuple[float, float]] = record(_tuple, _TOLD, _TOLD)
_ANSWER = record(Answer, _LONG, FLAG, text(64))
_HEADER = record(Header, _HUGE, _LONG, _TIME, told("d"), _TOLD)


def _finite(points: NDArray[np.float64]) -> str:
    return "" if np.isfinite(points).all() else "a way-point that is not a finite number"


_LAYOUTS: Mapping[int, tuple[type[Any], Field[Any]]] = {
    # up
    1: (
        Command,
        record(
            Command, _STICK, FLAG, FLAG, choice(Device), real("f", 0.0, 1.0),
            many(record(Request, _LONG, choice(Ask), _SHORT, _TIME), 8),
        ),
    ),
    2: (
        Waypoints,
        record(Waypoints, _LONG, checked(array("f8", 2, MOST_WAYPOINTS), _finite), FLAG),
    ),
    4: (Fetch, record(Fetch, text(128), _HUGE, whole("I"))),
    # down, datagrams
    64: (
        Status,
        record(
            Status,
            record(Lease, _SHORT, _SHORT, text(24), _SHORT, text(24), _TOLD),
            choice(Mode), text(_REASON), choice(Arming), record(Stick, _TOLD, _TOLD), _TOLD,
            _POSE, _POSE, _TWIST, _TWIST, _TWIST, text(_REASON),
            record(Guarding, choice(Verdict), _TOLD, _POINT, _TOLD),
            _TOLD, _POSE, _TOLD, _TOLD, text(64), choice(Localised), _TOLD, FLAG,
            record(Timing, _TOLD, _LONG, _TOLD, _TOLD, _TOLD, _LONG),
            many(record(Alarm, _SHORT, choice(Severity), FLAG, FLAG, text(64)), 4),
            many(_ANSWER, 3), many(_POINT, 12), _TOLD,
        ),
    ),
    65: (
        ScanPart,
        record(
            ScanPart, _LONG, _BYTE, _TIME, _POSE, _LONG, _LONG, _TOLD, _TOLD,
            array("u2", 0, MOST_BEAMS),
        ),
    ),
    66: (Discs, record(Discs, _LONG, array("f4", 6, 40))),
    # down, bulk
    96: (
        Hello,
        record(
            Hello, text(64), text(32), array("f4", 2, 64), _TOLD, _TOLD, _TOLD, text(32),
            record(_tuple, _TOLD, _TOLD, _TOLD, _TOLD),
        ),
    ),
    97: (Polyline, record(Polyline, choice(Line), array("f4", 2, 100_000))),
    98: (
        Map,
        record(
            Map, _LONG, _POSE, _TOLD, _SHORT, _SHORT, _SHORT, _SHORT, _SHORT, _SHORT,
            blob(LARGEST_BULK - 1000),
        ),
    ),
    99: (Health, record(Health, _TOLD, many(text(120), 16))),
    100: (Picture, record(Picture, _LONG, _TIME, _POSE, blob(4_000_000))),
    102: (
        Records,
        record(Records, many(record(RecordInfo, text(128), _HUGE, told("d")), 1000)),
    ),
    103: (Piece, record(Piece, text(128), _HUGE, blob(1_000_000))),
    104: (Checked, record(Checked, _ANSWER, _SHORT)),
    105: (Digest, record(Digest, text(128), _HUGE, blob(32), text(120))),
    106: (
        ZoneMap,
        record(
            ZoneMap, choice(Zone), _POSE, _TOLD, _TOLD, _SHORT, _SHORT, blob(LARGEST_BULK - 1000)
        ),
    ),
}  # fmt: skip
_KINDS = {of: kind for kind, (of, _) in _LAYOUTS.items()}
_UP = frozenset({1, 2, 4})
DATAGRAMS = (Command, Status, ScanPart, Discs)
"""What travels as datagrams."""
_DATAGRAM_KINDS = frozenset(_KINDS[of] for of in DATAGRAMS)


def encode(header: Header, message: Message) -> bytes:
    """The bytes of a message. ValueError for a number that has no place in it."""
    kind = _KINDS[type(message)]
    into = bytearray((VERSION, kind))
    _HEADER.write(into, header)
    _LAYOUTS[kind][1].write(into, message)
    return bytes(into)


def from_operator(data: bytes, bulk: bool = False) -> tuple[Header, FromOperator]:
    """What an operator sent. Malformed for anything else, and nothing else is raised."""
    return _decoded(data, up=True, bulk=bulk)


def may_stop(data: bytes) -> bool:
    """Whether a datagram looks like a command with a stop in it: cheap, for those who say too much.

    It may be wrong about what is no command; `from_operator` has the last word.
    """
    if len(data) < _REQUESTS_AT or data[0] != VERSION or data[1] != 1:
        return False
    end = _REQUESTS_AT + _REQUEST_SIZE * data[_REQUESTS_AT - 1]
    return Ask.STOP in data[_REQUESTS_AT + _WHAT_AT : end : _REQUEST_SIZE]


def from_robot(data: bytes, bulk: bool = False) -> tuple[Header, FromRobot]:
    """What a robot sent. Malformed for anything else, and nothing else is raised."""
    return _decoded(data, up=False, bulk=bulk)


def largest(of: type[Any]) -> int:
    """Bytes that a message of this type takes at most."""
    return 2 + _HEADER.most + _LAYOUTS[_KINDS[of]][1].most


def _decoded(data: bytes, up: bool, bulk: bool) -> tuple[Header, Any]:
    if len(data) > (LARGEST_BULK if bulk else LARGEST):
        raise Malformed(f"{len(data)} bytes are too many")
    reader = Reader(bytes(data))
    version, kind = reader.take(2)
    if version != VERSION:
        raise Malformed(f"version {version} of the protocol; this end speaks {VERSION}")
    if kind not in _LAYOUTS or (kind in _UP) != up or (kind in _DATAGRAM_KINDS) == bulk:
        raise Malformed(f"a message of kind {kind} does not belong here")
    header = _HEADER.read(reader)
    message = _LAYOUTS[kind][1].read(reader)
    reader.done()
    return header, message
