"""Messages between page and server; `typescript.py` generates the page's types from them.

Text messages are JSON objects with a `type`. Large and frequent ones (map, scan, picture) are
binary, see `binary.py`. SI units and radians, world frame, unless a name says otherwise; None for
unknown or infinite numbers.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from cohelm.core.schema import Coordinate, Schema

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Deflection = Annotated[float, Field(ge=-1.0, le=1.0)]
Point = tuple[Coordinate, Coordinate]
Count = Annotated[int, Field(ge=0, lt=2**53)]
Where = tuple[float, float, float]
Motion = tuple[float, float]


# --- from the page ------------------------------------------------------------------------------

ModeName = Literal["hold", "shared", "automatic", "manual"]
DeviceName = Literal["none", "keyboard", "gamepad", "touch"]
Request = Literal[
    "stop", "reset", "take", "give", "refuse", "acknowledge", "record", "record_stop",
    "hold", "shared", "automatic", "manual", "dock", "undock",
]  # fmt: skip


class Stick(Schema):
    """State of the stick. Sent at 50 Hz while a page is open; also the page's heartbeat."""

    type: Literal["stick"] = "stick"
    n: Count
    """Sequence number; one that is not newer than the last is dropped."""
    echo_ms: Annotated[float, Field(ge=0.0, le=1e15)]
    """`at_ms` of the newest beat received: bounds the age of this message."""
    x: Deflection
    """Fore-aft, forward positive."""
    psi: Deflection
    """Left-right, left positive."""
    valid: bool
    """False if there is no stick: gamepad disconnected, tab hidden. Not the same as centred."""
    armed: bool
    """The operator chose this device, and it was centred since."""
    device: DeviceName
    speed_scale: Share
    """Share of the robot's speed that the operator allows."""


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


class Waypoints(Schema):
    """A path for the robot to check and, unless `only_check`, to follow."""

    type: Literal["waypoints"] = "waypoints"
    points: Annotated[list[Point], Field(min_length=1, max_length=200)]
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


FromPage = Annotated[Stick | Do | Waypoints | Got | Play, Field(discriminator="type")]
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


class Camera(Schema):
    """Field of view and mount of the camera, to draw into its picture."""

    field_of_view_rad: float
    """Vertical."""
    mount_x_m: float
    mount_z_m: float
    tilt_rad: float


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
    centre: float
    """Deflections up to this are centred, and arm a waiting gamepad."""


class Robot(Schema):
    """The robot's name, outline and camera."""

    type: Literal["robot"] = "robot"
    name: str
    outline: list[Point]
    """Corners, body frame [m]."""
    camera: Camera | None


class State(Schema):
    """The robot's state, up to 30 times a second."""

    type: Literal["state"] = "state"
    t_s: float
    """The robot's clock."""
    age_ms: float
    """Age when it was sent to the page."""
    pose: Where
    localised: Literal["unknown", "exact", "good", "poor", "lost"]
    sigma_m: float | None
    reference: Where | None
    twist: Motion
    """Measured."""
    nominal: Motion
    """Blended command of operator and controller, before the filter."""
    applied: Motion
    """Command at the wheels."""
    why: str
    """Why `applied` differs from `nominal`, or empty."""
    verdict: Literal["untouched", "shaped", "braking", "standing", "invalid"]
    stick: Motion
    """The stick in use on the robot: fore-aft, left-right."""
    arming: Literal["absent", "waiting", "armed"]
    authority: float | None
    """e^{-V_h}: the controller's share."""
    e_p: float | None
    h_m2: float | None
    clearance_m: float | None
    """From the outline to the nearest obstacle."""
    limiting: Point | None
    """Position of the limiting obstacle."""
    ahead: list[Point]
    """Predicted path, in steps of `ahead_step_s`."""
    ahead_step_s: float
    mode: ModeName
    stopped: str
    """Why the robot is stopped; empty: it is not."""
    speed_cap_mps: float | None
    cap_reason: str
    recording: bool
    docking: Literal["away", "staged", "docking", "docked", "undocking", "between"]
    dock: int
    """Number of the dock, from 1; 0: none."""


class Who(Schema):
    """The driver, and the operator that requests the lease."""

    type: Literal["who"] = "who"
    you_drive: bool
    driver: str | None
    requester: str | None
    """The operator that requests the lease from the driver."""
    requester_client: int
    you_request: bool
    left_s: float | None
    """Time until the request is granted, if the driver does not answer."""
    operators: list[str]
    """All connected operators."""


class Alarm(Schema):
    """One alarm."""

    number: int
    severity: Literal["notice", "warning", "alarm"]
    text: str
    active: bool
    acknowledged: bool


class Alarms(Schema):
    """All alarms that are active or not acknowledged yet, the worst first."""

    type: Literal["alarms"] = "alarms"
    alarms: list[Alarm]


class Discs(Schema):
    """Round obstacles: x, y, vx, vy, radius, safe distance."""

    type: Literal["discs"] = "discs"
    rows: list[tuple[float, float, float, float, float, float]]


class Line(Schema):
    """A line on the map; replaces the earlier of its kind."""

    type: Literal["line"] = "line"
    what: Literal["reference", "detour", "waypoints"]
    points: list[Point]


class Dock(Schema):
    """A place to dock at."""

    name: str
    pose: Where
    """Of the docked robot."""
    approach_m: float
    """Length of the straight approach that ends there."""


class Docks(Schema):
    """The docks of the site; replaces the earlier ones."""

    type: Literal["docks"] = "docks"
    docks: list[Dock]


class Link(Schema):
    """Quality of the link to the robot; four times a second."""

    type: Literal["link"] = "link"
    connected: bool
    name: str
    """Name of the link."""
    why: str
    """Why it is not connected; empty while it is."""
    round_trip_ms: float | None
    loss: float | None
    """Share of our datagrams that were lost."""
    command_age_ms: float | None
    """Age of commands when the robot used them."""
    offset_ms: float | None
    """Offset of the robot's clock from the station's."""
    late_ms: float | None
    """Worst lateness of a step on the robot in the last second."""
    battery: float | None
    faults: list[str]


class RecordFile(Schema):
    """A record on the robot, to be downloaded from /records/."""

    name: str
    bytes: int


class Records(Schema):
    """The records that can be downloaded, newest first."""

    type: Literal["records"] = "records"
    files: list[RecordFile]


class Playing(Schema):
    """Playback position of a replay."""

    type: Literal["playing"] = "playing"
    at_s: float
    """Since the start of the record."""
    playing: bool
    speed: float


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
    what: str
    why: str


ToPage = (
    Beat | Welcome | Robot | State | Who | Alarms | Discs | Line | Docks | Link | Records | Playing
    | Checked | Refused
)  # fmt: skip
"""All text messages from the server."""
