"""What operator and robot tell each other: types, whose annotations say what bytes they take.

Two ways to travel. *Datagrams*, at most `wire.LARGEST` bytes, newest wins: `Command` up; `Status`,
`ScanPart` and `Discs` down. *Bulk*, over a reliable stream that can never delay a datagram: what is
in `bulk_messages`. Down, a number that is NaN is not known; up, every number is finite and in its
range.

The operator's deflection and its validity are two things: a stick that vanished is not a stick
that is centred. What must happen once (stop, mode, lease...) is a numbered `Request`; it is
repeated until the robot has answered its number, and done once.

A number without a word on its size is an `f` that may be NaN, an enumeration or a flag a byte, a
tuple its fields in order; `codec` has the rest. A new field stands here, or there, and nowhere else
in `link`.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Pose, Stick, Twist
from cohelm.link.codec import UpTo, array, real, record, text, whole

MOST_BEAMS = 500
"""Beams in one ScanPart."""

Byte = Annotated[int, whole("B")]
Short = Annotated[int, whole("H")]
Long = Annotated[int, whole("I")]
Time = Annotated[float, real("d")]
Reason = Annotated[str, text(128)]
"""Why the robot stands or slows: a sentence, as long as a datagram has room for."""
Words = Annotated[str, text(64)]
Name = Annotated[str, text(24)]
_DEFLECTION = real("f", -1.0, 1.0)


class Mode(IntEnum):
    """Who the robot listens to. The guard is on in all of them."""

    HOLD = 0
    """Stand."""
    SHARED = 1
    """Automatic along the path; the person takes over as far as the stick is deflected."""
    AUTOMATIC = 2
    """Automatic, without a stick."""
    MANUAL = 3
    """The stick alone; centred, the robot stands."""


class Device(IntEnum):
    """What the person steers with."""

    NONE = 0
    KEYBOARD = 1
    GAMEPAD = 2
    TOUCH = 3
    FORCE_STICK = 4
    SCRIPT = 5


CENTRE = 0.1
"""Deflections up to this are centred, for every end of the link: a stick is armed by them."""


def is_centred(stick: Stick) -> bool:
    """Whether a stick that waits is armed by this."""
    return max(abs(stick.x), abs(stick.psi)) <= CENTRE


class Arming(IntEnum):
    """How far a stick is believed."""

    ABSENT = 0
    """No stick, or its readings are not to be believed."""
    WAITING = 1
    """There, but it has not been centred since it came: it does not steer."""
    ARMED = 2
    """It steers."""


class Ask(IntEnum):
    """What can be asked for once; `Request.value` where a number goes with it."""

    STOP = 0
    """Brake and stay: anyone may."""
    RESET = 1
    """Let go of the stop, when its cause has gone: the driver may."""
    ACKNOWLEDGE = 2
    """Alarm `value` has been seen (0: all); anyone may."""
    MODE = 3
    """Mode `value`; the driver may."""
    TAKE = 4
    """The lease, please."""
    GIVE = 5
    """The driver gives the lease back; to client `value`, or to nobody (0)."""
    REFUSE = 6
    """The driver keeps the lease although it was asked for."""
    RECORD = 7
    """Record (value 1) or stop recording (0)."""
    DOCK = 8
    """Dock at dock `value`, as `Docks` has them, from 1; 0: the one it is at; the driver may."""
    UNDOCK = 9
    """Back out of dock `value`; 0: the one it is at; the driver may."""


class Request(NamedTuple):
    """Something to be done once."""

    number: Long
    """Counts up from 1 within a session; the robot does each number once, in order."""
    what: Ask
    value: Short
    """0..65535, as `Ask` says."""
    made: Time
    """The operator's clock when it was asked [s]; what is asked for too late is not done."""


class Command(NamedTuple):
    """Up, at 50 Hz: what the person wants now."""

    stick: Annotated[Stick, record(Stick, _DEFLECTION, _DEFLECTION)]
    valid: bool
    """The deflection was read from a working device just now; else it means nothing."""
    armed: bool
    """The station's part of arming: a person has chosen this device and it was centred."""
    device: Device
    speed_scale: Annotated[float, real("f", 0.0, 1.0)]
    """Share of the robot's speed the person allows, in [0, 1]."""
    requests: Annotated[tuple[Request, ...], UpTo(8)]
    """Those not answered yet, oldest first, at most 8."""


class Answer(NamedTuple):
    """What became of a request or of a proposal."""

    number: Long
    granted: bool
    reason: Words
    """Why not, or what follows; may be empty."""


class Severity(IntEnum):
    """How much an alarm matters."""

    NOTICE = 0
    WARNING = 1
    ALARM = 2


class Alarm(NamedTuple):
    """Something the person must know; latched until acknowledged and gone."""

    number: Short
    """Which alarm it is, > 0; the same thing happening again is a new number."""
    severity: Severity
    active: bool
    """Its cause is still there."""
    acknowledged: bool
    text: Words


class DockPhase(IntEnum):
    """How the robot stands to a dock."""

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
    """How well the robot knows where it is."""

    UNKNOWN = 0
    EXACT = 1
    """Given, not estimated (simulation)."""
    GOOD = 2
    POOR = 3
    LOST = 4


class ReportedVerdict(IntEnum):
    """What the filter did with the wish. Numbers of the link, not those of `law.verdict`."""

    UNTOUCHED = 0
    SHAPED = 1
    BRAKING = 2
    STANDING = 3
    INVALID = 4


class Lease(NamedTuple):
    """Who drives."""

    you: Short
    """This client's number, > 0."""
    driver: Short
    """The driver's number; 0: nobody."""
    driver_name: Name
    asking: Short
    """Who asks for the lease; 0: nobody."""
    asking_name: Name
    left: float
    """Until it is given to who asks, if the driver says nothing [s]; NaN where nobody asks."""


class Guarding(NamedTuple):
    """What the filter says of the last step."""

    verdict: ReportedVerdict
    clearance: float
    """Smallest clearance of the outline to anything [m]."""
    limiting: tuple[float, float]
    """Where in the map the thing is that held the command back; NaN: nothing did."""
    h: float
    """Least value of the paper's barrier (22) [m^2]."""


class TimingReport(NamedTuple):
    """How well the robot keeps time, and hears this client."""

    late: float
    """Worst lateness of a step in the last second [s]."""
    overruns: Long
    """Steps that took longer than a period, since the start."""
    command_age: float
    """Age of the command at its last use [s]."""
    round_trip: float
    """[s]"""
    lost: float
    """Share of this client's datagrams lost in the last seconds."""
    dropped: Long
    """Commands of this client not used: too old, out of order, not understood."""


class Status(NamedTuple):
    """Down, at 50 Hz: what the robot does, and why."""

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
    odometry: Pose
    """In the odometry frame, which is smooth."""
    twist: Twist
    """Measured."""
    nominal: Twist
    """What person and automatic ask for together, before the filter."""
    applied: Twist
    """What the wheels get."""
    why: Reason
    """Why applied differs from nominal; empty where it does not."""
    guarding: Guarding
    e_p: float
    """Tracking error E_P of the paper."""
    reference: Pose
    """Where the path wants the robot to be."""
    progress: float
    """Share of the path done, in [0, 1]."""
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
    alarms: Annotated[tuple[Alarm, ...], UpTo(4)]
    """The worst first, at most 4."""
    answers: Annotated[tuple[Answer, ...], UpTo(3)]
    """To the newest requests, oldest first, at most 3. A number up to the last one is done."""
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
