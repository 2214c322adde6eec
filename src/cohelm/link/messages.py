"""Messages between operator and robot: types, whose annotations define their bytes.

Two transports. *Datagrams*, at most `wire.LARGEST` bytes, newest wins: `Uplink` up; `Status`,
`ScanPart` and `Discs` down. *Bulk*, over a reliable stream that never delays a datagram: see
`bulk_messages`. Down, NaN means "not known"; up, every number is finite and in its range.

Deflection and validity are separate: a lost stick is not a centred stick. What must happen once
(stop, mode, lease...) is a numbered `Request`, repeated until the robot has answered its number,
and executed once.

By default a number is an `f` that may be NaN, an enumeration or a flag a byte, a tuple its fields
in order; `codec` has the rest. A new field is added here, or there, and nowhere else in `link`.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import CENTRED, Pose, Stick, Twist
from cohelm.law.verdict import Verdict
from cohelm.link.codec import UpTo, array, real, record, text, whole

VERSION = 15
"""Raised with every change of a message's bytes, here or in `bulk_messages`."""
MOST_BEAMS = 500
"""Beams in one ScanPart."""
MOST_ANSWERS = 1
"""Answers in one Status."""
MOST_ALARMS = 3
"""Alarms in one Status; each takes 71 bytes of it."""

Byte = Annotated[int, whole("B")]
Short = Annotated[int, whole("H")]
Long = Annotated[int, whole("I")]
Time = Annotated[float, real("d")]
Reason = Annotated[str, text(128)]
"""Why the robot stands or slows: a sentence that fits into a datagram. The reason of a stop is an
alarm's too, which the station has whole."""
Refusal = Annotated[str, text(200)]
"""Why not: as a rule whole, since `reset first: ...` has another reason in it."""
Words = Annotated[str, text(64)]
Name = Annotated[str, text(32)]
"""A station's: as long as the longest."""
_DEFLECTION = real("f", -1.0, 1.0)


class Mode(IntEnum):
    """Driving mode. The guard is on in all of them."""

    HOLD = 0
    """Stand."""
    SHARED = 1
    """Automatic along the path; the operator takes over as far as the stick is deflected."""
    AUTOMATIC = 2
    """Automatic, without a stick."""
    MANUAL = 3
    """The stick alone; centred, the robot stands."""


class Device(IntEnum):
    """The operator's input device."""

    NONE = 0
    KEYBOARD = 1
    GAMEPAD = 2
    TOUCH = 3
    FORCE_STICK = 4
    SCRIPT = 5

    @classmethod
    def _missing_(cls, value: object) -> Device | None:
        """The device of a name, as pages write it."""
        return cls.__members__.get(value.upper()) if isinstance(value, str) else None


CENTRE = 0.1
"""Deflections up to this count as centred everywhere; they arm a stick."""


def is_centred(stick: Stick) -> bool:
    """Whether a stick is centred, which arms a waiting one."""
    return max(abs(stick.x), abs(stick.psi)) <= CENTRE


class Arming(IntEnum):
    """State of the stick."""

    ABSENT = 0
    """No stick, or its readings are not valid."""
    WAITING = 1
    """Valid, but not centred since it came: it does not steer."""
    ARMED = 2
    """It steers."""


class RequestKind(IntEnum):
    """Kind of a request; `Request.value` where it has a number."""

    STOP = 0
    """Brake and stay: anyone may."""
    RESET = 1
    """Clear the stop, when its cause has gone: the driver may."""
    ACKNOWLEDGE = 2
    """Alarm `value` has been seen (0: all); anyone may."""
    MODE = 3
    """Mode `value`; the driver may."""
    TAKE = 4
    """Request the lease."""
    GIVE = 5
    """The driver gives the lease back; to client `value`, or to nobody (0)."""
    REFUSE = 6
    """The driver keeps the lease although it was requested."""
    RECORD = 7
    """Record (value 1) or stop recording (0)."""
    DOCK = 8
    """Dock at dock `value`, as `Docks` has them, from 1; 0: the one it is at; the driver may."""
    UNDOCK = 9
    """Back out of dock `value`; 0: the one it is at; the driver may."""


class Request(NamedTuple):
    """A request, to be executed once."""

    number: Long
    """Counts up from 1 within a session; each number is executed once, in order."""
    what: RequestKind
    value: Short
    """0..65535, as `RequestKind` says."""
    made: Time
    """The operator's clock when it was made [s]; a late one is not executed."""


class Command(NamedTuple):
    """The operator's command: the same from the page, or the stick's driver, to the loop."""

    stick: Annotated[Stick, record(Stick, _DEFLECTION, _DEFLECTION)]
    """Fore-aft and left-right, forward and left positive."""
    valid: bool
    """The deflection was just read from a working device; else it is ignored. A lost stick is not
    a centred one."""
    armed: bool
    """The station's part of arming: the operator chose this device and it was centred."""
    device: Device
    speed_scale: Annotated[float, real("f", 0.0, 1.0)] = 1.0
    """Share of the robot's speed that the operator allows, in [0, 1]."""


class Uplink(NamedTuple):
    """Up, at 50 Hz: the operator's command and requests."""

    command: Command
    requests: Annotated[tuple[Request, ...], UpTo(8)] = ()
    """Those not answered yet, oldest first, at most 8."""


NO_STICK = Command(CENTRED, False, False, Device.NONE)


class Answer(NamedTuple):
    """The result of a request or of a proposal."""

    number: Long
    granted: bool
    reason: Refusal
    """Why not, or what follows; may be empty."""


class Severity(IntEnum):
    """Severity of an alarm."""

    NOTICE = 0
    WARNING = 1
    ALARM = 2


class AlarmKind(IntEnum):
    """What an alarm is about, where a screen has to know."""

    OTHER = 0
    LOST = 1
    """Where the robot is on its map; the text says `lost: ...`."""


class Alarm(NamedTuple):
    """An alarm, latched until acknowledged and gone."""

    number: Short
    """Which alarm it is, > 0; the same one raised again has a new number."""
    severity: Severity
    active: bool
    """Its cause is still there."""
    acknowledged: bool
    text: Words
    kind: AlarmKind = AlarmKind.OTHER


class DockPhase(IntEnum):
    """The robot's state relative to a dock."""

    AWAY = 0
    """It is at none."""
    STAGED = 1
    """At the beginning of one's approach: it could dock."""
    DOCKING = 2
    DOCKED = 3
    """It could undock."""
    UNDOCKING = 4
    BETWEEN = 5
    """Somewhere on an approach: it could do either."""


class Localised(IntEnum):
    """Quality of localisation."""

    UNKNOWN = 0
    """There is no map: the pose is the odometry's."""
    EXACT = 1
    """Given, not estimated (simulation)."""
    GOOD = 2
    POOR = 3
    LOST = 4


class Lease(NamedTuple):
    """Who drives."""

    you: Short
    """This client's number, > 0."""
    driver: Short
    """The driver's number; 0: nobody."""
    driver_name: Name
    requester: Short
    """Client that requests the lease; 0: none."""
    requester_name: Name
    left: float
    """Time until it is handed over without an answer [s]; NaN where it is not requested, and 0
    where the driver sends nothing: whoever requests it has it at once."""


class TimingReport(NamedTuple):
    """Timing of the robot's loop, and of the link to this client."""

    late: float
    """Worst lateness of a step in the last second [s]."""
    overruns: Long
    """Steps that took longer than a period, since the start."""
    command_age: float
    """Age of this client's newest command, if it drives [s]; else NaN."""
    round_trip: float
    """[s]"""
    lost: float
    """Share of this client's datagrams lost in the last seconds."""
    dropped: Long
    """Commands of this client not used: too old, out of order, not understood."""


class Status(NamedTuple):
    """Down, at 50 Hz: the robot's state.

    What a record has too is called as there: as a field of `core.row`, where a tuple is one for
    each part (`nominal_v`, `nominal_omega`), or of `recorded_status.StatusWords`.
    """

    lease: Lease
    mode: Mode
    stopped: Reason
    """Why it is stopped; empty: it is not. Latched until RESET."""
    arming: Arming
    stick: Stick
    """The deflection in use."""
    authority: float
    """The automatic part's share of the command, exp(-V_h) (34), in [0, 1]."""
    pose: Pose
    """In the map."""
    measured: Twist
    """By the odometry."""
    nominal: Twist
    """The blend of operator and controller, before the filter."""
    applied: Twist
    """What the wheels get."""
    why: Reason
    """Why applied differs from nominal; empty where it does not."""
    verdict: Verdict
    """What the filter did with the nominal command."""
    clearance_seen: float
    """Smallest clearance of the outline to anything [m]."""
    limiting: tuple[float, float]
    """Position of the limiting obstacle in the map; NaN: none."""
    h: float
    """Least value of the paper's barrier (22) [m^2]."""
    e_p: float
    """Tracking error E_P of the paper."""
    reference: Pose
    """The desired pose on the path."""
    speed_cap: float
    """[m/s]; infinite where there is none."""
    cap_reason: Words
    localised: Localised
    sigma: float
    """Standard deviation of the position [m]."""
    recording: bool
    docking: DockPhase
    dock: Byte
    """At which dock, as `Docks` has them, from 1; 0: at none."""
    timing: TimingReport
    alarms: Annotated[tuple[Alarm, ...], UpTo(MOST_ALARMS)]
    """The worst first, at most `MOST_ALARMS` and cut; the station adds the others, whole."""
    answers: Annotated[tuple[Answer, ...], UpTo(MOST_ANSWERS)]
    """To requests that this client repeats, by turns where there are more than `MOST_ANSWERS`;
    without any, to the newest. A stop up to the largest number is done."""
    ahead: Annotated[tuple[tuple[float, float], ...], UpTo(12)]
    """Predicted path in the map, from now on in equal steps of time, at most 12 [m]."""
    ahead_step: float
    """Time between two of its points [s]."""


class ScanPart(NamedTuple):
    """Down: a piece of a LiDAR scan, at most `MOST_BEAMS` beams."""

    number: Long
    """Of the scan."""
    lidar: Byte
    """Which of the robot's LiDARs; the first is 0."""
    taken: Time
    """The robot's clock when its first beam was measured [s]."""
    sensor: Pose
    """Of the sensor in the map, then."""
    beams: Long
    """Beams of the whole scan."""
    start: Long
    """The whole scan's number of this part's first beam."""
    first: float
    """Bearing of the whole scan's beam 0 [rad]."""
    step: float
    """[rad]"""
    ranges: Annotated[NDArray[np.uint16], array("u2", 0, MOST_BEAMS)]
    """(n,) [mm]; 65535: no return, 0: too near."""


class Discs(NamedTuple):
    """Down: round obstacles, the nearest 40."""

    number: Long
    rows: Annotated[NDArray[np.float32], array("f4", 6, 40)]
    """(n, 6): x, y, vx, vy, radius, safe distance r_i, in the map, as `core.types`."""
