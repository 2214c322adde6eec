"""Binary encoding of every message (docs/link.md)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from cohelm.link.bulk_messages import (
    LARGEST_BULK,
    Alarms,
    Checked,
    Digest,
    Docks,
    Fetch,
    FromOperator,
    FromRobot,
    HealthReport,
    Hello,
    Huge,
    Map,
    Message,
    Picture,
    Piece,
    Polyline,
    Records,
    Waypoints,
    ZoneMap,
)
from cohelm.link.codec import Malformed, Reader, WireField, layout, reported
from cohelm.link.messages import (
    VERSION,
    Command,
    Discs,
    Long,
    Request,
    RequestKind,
    ScanPart,
    Status,
    Time,
    Uplink,
)

LARGEST = 1150
"""Bytes of a datagram's message; with DTLS, UDP and IPv6 around it, below 1280 (RFC 8200)."""


class Header(NamedTuple):
    """In front of every message."""

    session: Huge
    """Random number drawn when the sender started; a new one means that its state is lost."""
    sequence: Long
    """Counts up by one with each message of a session."""
    stamp: Time
    """The sender's clock when it was sent [s]."""
    echo: Annotated[float, reported("d")]
    """Stamp of the newest message that the sender has received; NaN: none yet."""
    hold: float
    """Time since it was received [s]; NaN with it."""


UP: Mapping[int, type[Any]] = {1: Uplink, 2: Waypoints, 4: Fetch}
_DOWN: Mapping[int, type[Any]] = {
    64: Status, 65: ScanPart, 66: Discs,
    96: Hello, 97: Polyline, 98: Map, 99: HealthReport, 100: Picture, 102: Records, 103: Piece,
    104: Checked, 105: Digest, 106: ZoneMap, 107: Docks, 108: Alarms,
}  # fmt: skip
LAYOUTS: Mapping[int, tuple[type[Any], WireField[Any]]] = {
    kind: (of, layout(of)) for kind, of in {**UP, **_DOWN}.items()
}
_HEADER: WireField[Header] = layout(Header)
_REQUESTS_AT, _REQUEST_SIZE = 3 + _HEADER.most + layout(Command).most, layout(Request).most
"""Where a command's requests begin, and how long each is; the byte before them is their number."""
_WHAT_AT = layout(Long).most
"""Where in a request `what` is."""
_KINDS = {of: kind for kind, (of, _) in LAYOUTS.items()}
DATAGRAMS = (Uplink, Status, ScanPart, Discs)
"""Messages sent as datagrams."""
_DATAGRAM_KINDS = frozenset(_KINDS[of] for of in DATAGRAMS)


def encode(header: Header, message: Message) -> bytes:
    """The bytes of a message. ValueError for a number that can not be encoded."""
    kind = _KINDS[type(message)]
    into = bytearray((VERSION, kind))
    _HEADER.write(into, header)
    LAYOUTS[kind][1].write(into, message)
    return bytes(into)


def from_operator(data: bytes, bulk: bool = False) -> tuple[Header, FromOperator]:
    """Decode a message of an operator. Raises Malformed for anything else, and nothing else."""
    return _decoded(data, up=True, bulk=bulk)


def may_stop(data: bytes) -> bool:
    """Whether a datagram looks like a command with a stop in it: a cheap test for rate limiting.

    It may be wrong about what is no command; `from_operator` decides.
    """
    if len(data) < _REQUESTS_AT or data[0] != VERSION or data[1] != 1:
        return False
    end = _REQUESTS_AT + _REQUEST_SIZE * data[_REQUESTS_AT - 1]
    return RequestKind.STOP in data[_REQUESTS_AT + _WHAT_AT : end : _REQUEST_SIZE]


def from_robot(data: bytes, bulk: bool = False) -> tuple[Header, FromRobot]:
    """Decode a message of a robot. Raises Malformed for anything else, and nothing else."""
    return _decoded(data, up=False, bulk=bulk)


def largest(of: type[Any]) -> int:
    """Largest number of bytes of a message of this type."""
    return 2 + _HEADER.most + LAYOUTS[_KINDS[of]][1].most


def _decoded(data: bytes, up: bool, bulk: bool) -> tuple[Header, Any]:
    if len(data) > (LARGEST_BULK if bulk else LARGEST):
        raise Malformed(f"{len(data)} bytes are too many")
    reader = Reader(bytes(data))
    version, kind = reader.take(2)
    if version != VERSION:
        raise Malformed(
            f"version {version} of the link's protocol, and {VERSION} here: install the same "
            "cohelm on robot and station"
        )
    if kind not in LAYOUTS or (kind in UP) != up or (kind in _DATAGRAM_KINDS) == bulk:
        raise Malformed(f"a message of kind {kind} does not belong here")
    header = _HEADER.read(reader)
    message = LAYOUTS[kind][1].read(reader)
    reader.done()
    return header, message
