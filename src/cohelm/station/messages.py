"""Messages between page and server; `typescript.py` generates the page's types from them.

Text messages are JSON objects with a `type`. The robot's are those of the link, field by field, as
`view.shown` writes them, and so is the command to it; large and frequent ones (map, scan, picture)
are binary.
SI units and radians, world frame, unless a name says otherwise; None for unknown or infinite
numbers.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, TypeAdapter

from cohelm.core.schema import Coordinate, Schema
from cohelm.link.bulk_messages import MOST_WAYPOINTS, Docks, HealthReport, Hello, Polyline, Records
from cohelm.link.codec import layout
from cohelm.link.messages import Command, Discs, Mode, RequestKind, Status
from cohelm.link.station_end import LinkState
from cohelm.station.robot_link import PlaybackPosition

Point = tuple[Coordinate, Coordinate]
Count = Annotated[int, Field(ge=0, lt=2**53)]

# --- from the page ------------------------------------------------------------------------------

Request = Literal[
    "stop", "reset", "take", "give", "refuse", "acknowledge", "record", "record_stop",
    "hold", "shared", "automatic", "manual", "dock", "undock",
]  # fmt: skip


_COMMAND = layout(Command)


def _sendable(command: Command) -> Command:
    """The command, if the link can encode it: every number is finite and in its range."""
    _COMMAND.write(bytearray(), command)
    return command


class Steer(Schema):
    """The operator's command. Sent at 50 Hz while a page is open; also the page's heartbeat."""

    type: Literal["steer"] = "steer"
    n: Count
    """Sequence number; one that is not newer than the last is dropped."""
    echo_ms: Annotated[float, Field(ge=0.0, le=1e15)]
    """`at_ms` of the newest beat received: bounds the age of this message."""
    command: Annotated[Command, AfterValidator(_sendable)]
    """Not valid if there is no stick: gamepad disconnected, tab hidden."""


class Do(Schema):
    """A request to do something once."""

    type: Literal["do"] = "do"
    what: Request
    value: Annotated[int, Field(ge=0, le=65535)] = 0
    """Number of the alarm to acknowledge (0: all), of the client to give the lease to (0: none), or
    of the dock, from 1 (0: where the robot is)."""
    echo_ms: Annotated[float, Field(ge=0.0, le=1e15)] | None = None
    """`at_ms` of the newest beat received when the operator pressed: a request from before a stop
    is not done after it, however long it was in transit. Null: just now."""

    def request(self) -> tuple[RequestKind, int]:
        """The request to the robot, and its value."""
        if self.what in ("record", "record_stop"):
            return RequestKind.RECORD, int(self.what == "record")
        if self.what.upper() in Mode.__members__:
            return RequestKind.MODE, Mode[self.what.upper()]
        return RequestKind[self.what.upper()], self.value


class Waypoints(Schema):
    """A path for the robot to check and, unless `only_check`, to follow."""

    type: Literal["waypoints"] = "waypoints"
    points: Annotated[list[Point], Field(min_length=1, max_length=MOST_WAYPOINTS)]
    only_check: bool


class Got(Schema):
    """Credit: the page has shown a message of this stream, and can take another."""

    type: Literal["got"] = "got"
    stream: Literal["state", "scan", "frame"]


class Play(Schema):
    """Whether a replay runs, how fast, and from where; None: unchanged."""

    type: Literal["play"] = "play"
    playing: bool | None = None
    speed: Annotated[float, Field(ge=0.05, le=100.0)] | None = None
    seek_s: Annotated[float, Field(ge=0.0, le=1e7)] | None = None


FromPage = Annotated[Steer | Do | Waypoints | Got | Play, Field(discriminator="type")]
"""All messages from a page."""

_FROM_PAGE: TypeAdapter[FromPage] = TypeAdapter(FromPage)


def from_page(text: str) -> FromPage:
    """Parse a page's message; raises pydantic's ValidationError if it is malformed."""
    return _FROM_PAGE.validate_json(text, strict=True)


# --- to the page --------------------------------------------------------------------------------


class Beat(Schema):
    """Heartbeat of the station; 25 times a second, whatever the robot does."""

    type: Literal["beat"] = "beat"
    at_ms: float
    """The station's clock."""
    page_ms: float | None
    """Round trip of a beat and its stick."""


class Welcome(Schema):
    """First message on every connection."""

    type: Literal["welcome"] = "welcome"
    you: str
    """Name of this page, as the driver and the others see it."""
    key: str
    """The page sends it when it reconnects, to be the same operator again."""
    version: str
    replay_s: float | None
    """Length of the record that is shown; None for a robot."""
    stale_s: float
    """A page that receives nothing for so long shows it, and its stick counts as lost."""


class Who(Schema):
    """The driver, and the operator that requests the lease."""

    type: Literal["who"] = "who"
    you_drive: bool
    driver: str | None
    driver_lost: bool
    """Whether the robot hears nothing of the driver: nobody drives, and it can be taken over."""
    requester: str | None
    """The operator that requests the lease from the driver."""
    requester_client: int
    you_request: bool
    left_s: float | None
    """Time until the request is granted, if the driver does not answer."""
    operators: list[str]
    """All connected operators."""


class Checked(Schema):
    """The robot's answer to waypoints."""

    type: Literal["checked"] = "checked"
    ok: bool
    only_check: bool
    why: str
    worst: int | None
    """Index of the waypoint at fault, from 0."""


class Refused(Schema):
    """A request of the page was refused, and why."""

    type: Literal["refused"] = "refused"
    what: Request
    why: str


ToPage = Beat | Welcome | Who | Checked | Refused
"""The server's own messages to the page."""
FROM_ROBOT = (
    Hello, Status, Discs, Polyline, Docks, Records, HealthReport, LinkState, PlaybackPosition,
)  # fmt: skip
"""The robot's and its link's messages that pages get as they are; `type` is the name of each."""
