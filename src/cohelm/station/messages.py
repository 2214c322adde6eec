"""What the page and the server say to each other; `typescript.py` makes the page's types of it.

Text messages are JSON objects with a `type`. What is large and frequent (map, scan, picture)
travels as bytes, see `binary.py`. SI units and radians, world frame, unless a name says
otherwise; None for what is not known, or infinite.
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
    """Where the stick is. Sent at 50 Hz while a page is open; it is the page's heartbeat too."""

    type: Literal["stick"] = "stick"
    n: Count
    """Counts up; one that is not newer than the last is dropped."""
    heard_ms: Annotated[float, Field(ge=0.0, le=1e15)]
    """`at_ms` of the newest beat heard: says how old this can be at most."""
    x: Deflection
    """Fore-aft, forward positive."""
    psi: Deflection
    """Left-right, left positive."""
    valid: bool
    """False where there is no stick to speak of: pad gone, tab hidden. Not the same as centred."""
    armed: bool
    """A person chose this device, and it was centred since."""
    device: DeviceName
    speed_scale: Share
    """Share of the robot's speed that the person allows."""


class Do(Schema):
    """Something to be done once."""

    type: Literal["do"] = "do"
    what: Request
    value: Annotated[int, Field(ge=0, le=65535)] = 0
    """Which alarm is acknowledged (0: all); which client is given the robot (0: nobody); at which
    dock, from 1 (0: where the robot is)."""
    heard_ms: Annotated[float, Field(ge=0.0, le=1e15)] | None = None
    """`at_ms` of the newest beat heard when the person pressed: what was pressed before a stop is
    not done after it, however long it was under way. Null: just now."""


class Waypoints(Schema):
    """A way for the robot to check and, unless it is only to be checked, to take."""

    type: Literal["waypoints"] = "waypoints"
    points: Annotated[list[Point], Field(min_length=1, max_length=200)]
    only_check: bool


class Got(Schema):
    """Credit: what was sent has been shown, and more may come."""

    type: Literal["got"] = "got"
    stream: Literal["state", "scan", "frame"]


class Play(Schema):
    """Whether a replay goes on, how fast, and where from; None: as it is."""

    type: Literal["play"] = "play"
    playing: bool | None = None
    speed: Annotated[float, Field(ge=0.05, le=100.0)] | None = None
    seek_s: Annotated[float, Field(ge=0.0, le=1e7)] | None = None


FromPage = Annotated[Stick | Do | Waypoints | Got | Play, Field(discriminator="type")]
"""Everything a page may say."""

_FROM_PAGE: TypeAdapter[FromPage] = TypeAdapter(FromPage)


def from_page(text: str) -> FromPage:
    """What a page said; pydantic's ValidationError where that is no message."""
    return _FROM_PAGE.validate_json(text, strict=True)


# --- to the page --------------------------------------------------------------------------------


class Beat(Schema):
    """The station lives; 25 times a second, whatever the robot does."""

    type: Literal["beat"] = "beat"
    at_ms: float
    """The station's clock."""
    page_ms: float | None
    """How long a beat and its stick took there and back."""


class Camera(Schema):
    """Where the camera looks from, to draw into its picture."""

    field_of_view_rad: float
    """Vertical."""
    mount_x_m: float
    mount_z_m: float
    tilt_rad: float


class Welcome(Schema):
    """First message on every connection."""

    type: Literal["welcome"] = "welcome"
    you: str
    """What the driver and the others see this page called."""
    key: str
    """What the page shows when it comes back, to be the same operator again."""
    version: str
    replay_s: float | None
    """Length of the record that is shown; None when it is a robot."""
    replay_from_s: float
    """The robot's clock at the record's beginning."""
    stale_s: float
    """A page that hears nothing for so long says so, and its stick counts as gone."""
    centre: float
    """Deflections up to this are centred: a gamepad that waits is armed by them."""


class Robot(Schema):
    """What robot this is."""

    type: Literal["robot"] = "robot"
    name: str
    outline: list[Point]
    """Corners, body frame [m]."""
    v_max: float
    omega_max: float
    watchdog_s: float
    on_loss: str
    camera: Camera | None


class State(Schema):
    """The robot now, up to 30 times a second."""

    type: Literal["state"] = "state"
    t_s: float
    """The robot's clock."""
    age_ms: float
    """How old this was when it left for the page."""
    pose: Where
    odometry: Where
    localised: Literal["unknown", "exact", "good", "poor", "lost"]
    sigma_m: float | None
    reference: Where | None
    twist: Motion
    """Measured."""
    nominal: Motion
    """What person and controller want together, before the filter."""
    applied: Motion
    """What the wheels get."""
    why: str
    """Why the two differ, or empty."""
    verdict: Literal["untouched", "shaped", "braking", "standing", "invalid"]
    stick: Motion
    """In use on the robot: fore-aft, left-right."""
    arming: Literal["absent", "waiting", "armed"]
    authority: float | None
    """e^{-V_h}: the controller's share."""
    e_p: float | None
    h_m2: float | None
    clearance_m: float | None
    """From the outline to the nearest thing."""
    limiting: Point | None
    """What held the wish back."""
    progress: float | None
    ahead: list[Point]
    """Predicted path, in steps of `ahead_step_s`."""
    ahead_step_s: float
    mode: ModeName
    stopped: str
    """Why it is stopped; empty: it is not."""
    speed_cap_mps: float | None
    cap_reason: str
    recording: bool
    docking: Literal["away", "staged", "docking", "docked", "undocking", "between"]
    dock: int
    """At which of the docks, from 1; 0: at none."""


class Who(Schema):
    """Who drives, and who would like to."""

    type: Literal["who"] = "who"
    you_drive: bool
    driver: str | None
    asking: str | None
    """Who asks the driver for the robot."""
    asking_client: int
    you_ask: bool
    left_s: float | None
    """Until it is given to who asks, if the driver says nothing."""
    operators: list[str]
    """All who are connected."""


class Alarm(Schema):
    """One thing a person must know."""

    number: int
    severity: Literal["notice", "warning", "alarm"]
    text: str
    active: bool
    acknowledged: bool


class Alarms(Schema):
    """All that are active or not acknowledged yet, the worst first."""

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
    """Length of the straight way that ends there."""


class Docks(Schema):
    """Where the robot can dock; replaces the earlier ones."""

    type: Literal["docks"] = "docks"
    docks: list[Dock]


class Link(Schema):
    """How good the link to the robot is; four times a second."""

    type: Literal["link"] = "link"
    connected: bool
    name: str
    """What the robot is reached by."""
    why: str
    """Why it is not connected; empty while it is."""
    round_trip_ms: float | None
    loss: float | None
    """Share of our datagrams that never came."""
    command_age_ms: float | None
    """How old commands were when the robot used them."""
    state_age_ms: float | None
    offset_ms: float | None
    """The robot's clock against the station's."""
    late_ms: float | None
    """Worst lateness of a step on the robot in the last second."""
    battery: float | None
    faults: list[str]


class RecordFile(Schema):
    """A record on the robot, to be fetched below /records/."""

    name: str
    bytes: int


class Records(Schema):
    """The records that can be fetched, newest first."""

    type: Literal["records"] = "records"
    files: list[RecordFile]


class Playing(Schema):
    """Where the replay is."""

    type: Literal["playing"] = "playing"
    at_s: float
    """Since the beginning of the record."""
    playing: bool
    speed: float


class Checked(Schema):
    """What the robot says to way-points."""

    type: Literal["checked"] = "checked"
    ok: bool
    only_check: bool
    why: str
    worst: int | None
    """Which one is to blame, from 0."""


class Refused(Schema):
    """Something the page asked for was not done, and why."""

    type: Literal["refused"] = "refused"
    what: str
    why: str


ToPage = (
    Beat | Welcome | Robot | State | Who | Alarms | Discs | Line | Docks | Link | Records | Playing
    | Checked | Refused
)  # fmt: skip
"""Everything the server says in text."""
