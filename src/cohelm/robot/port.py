"""The robot port: the interface of every robot, be it twin, simulator, record or hardware.

One clock: `now()` is the robot's own, monotonic, in seconds; every stamp is of that clock. Wall
time is only ever used to label records.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.model import RobotModel


class Odometry(NamedTuple):
    """Pose and twist by wheels and gyro [m, rad, m/s, rad/s]; the pose drifts.

        >>> import cohelm
        >>> ahead = cohelm.Odometry(0.1, cohelm.Pose(0.05, 0.0, 0.0), cohelm.Twist(0.5, 0.0))
        >>> ahead.twist.v
        0.5

    `Robot.odometry` makes it, with its stamp.
    """

    stamp: float
    """Time of the measurement [s]."""
    pose: Pose
    """In the odometry frame, which is smooth and has any origin."""
    twist: Twist
    """Measured, in the body frame."""


class Scan(NamedTuple):
    """One turn of a planar LiDAR, as `robot.sensors.LidarModel` describes it.

        >>> import cohelm, numpy
        >>> scan = cohelm.Scan(0.1, 0, numpy.array([2.0, math.inf, 2.1]), duration=0.05)
        >>> int(numpy.isfinite(scan.ranges).sum())  # returns
        2

    `Robot.scan` makes it, with stamp and number.
    """

    stamp: float
    """When the first beam was measured [s]."""
    number: int
    """Counts up from 0 by one; a gap is a lost scan."""
    ranges: Floats
    """(n,), counter-clockwise [m]; inf for no return, -inf for too near (REP-117)."""
    duration: float
    """From the first beam to the last [s]; 0 for all at one instant."""
    sensor: str = ""
    """Name of the LiDAR that it is of, as the robot's model has it."""
    edges: NDArray[np.bool_] | None = None
    """(n,), whether a beam ends where expected floor is missing (an edge, which can not move).
    None: no beam does."""


class Contact(NamedTuple):
    """A reading of a bumper or cliff sensor."""

    stamp: float
    """Time of the reading [s]."""
    sensor: str
    """Its name, as the robot's model has it."""
    on: bool
    """Whether it is pressed, or sees no floor."""


class Frame(NamedTuple):
    """One picture of the camera."""

    stamp: float
    """When it was taken [s]."""
    number: int
    """Counts up from 0 by one."""
    pixels: NDArray[np.uint8]
    """(height, width, 3), RGB."""


class Encoded(NamedTuple):
    """One picture of a camera that encodes it itself."""

    stamp: float
    """When it was taken [s]."""
    number: int
    """Counts up from 0 by one."""
    data: bytes
    """A file of JPEG or another kind that is common."""


class FailedCall(NamedTuple):
    """A call of a robot's driver that failed."""

    call: str
    """read, send, stop or close."""
    why: str


class Health(NamedTuple):
    """The robot's own report of its state."""

    stamp: float
    battery: float
    """Share of its charge, NaN if not known."""
    faults: tuple[str, ...]
    """Faults, a sentence each; the robot does not drive while there is one."""
    failed: FailedCall | None = None
    """The call that the first of them is of; None: the robot reports it itself."""


class Readings(NamedTuple):
    """The newest of everything; None for what has not come yet, or is not there.

        >>> import cohelm
        >>> still = cohelm.Odometry(0.1, cohelm.Pose(0.0, 0.0, 0.0), cohelm.Twist(0.0, 0.0))
        >>> cohelm.Readings(odometry=still).scan is None
        True

    What `Robot.read` returns.
    """

    odometry: Odometry | None = None
    """The newest odometry."""
    scan: Scan | None = None
    """One turn of the LiDAR; of several, of the first."""
    frame: Frame | None = None
    """One picture of the camera."""
    health: Health | None = None
    """The robot's report of its own state."""
    further: tuple[Scan, ...] = ()
    """Of each further LiDAR that has given one, the newest scan."""
    contacts: tuple[Contact, ...] = ()
    """The newest reading of each bumper and cliff sensor."""
    outline: Floats | None = None
    """The robot's own, convex, counter-clockwise, (k, 2) in the body frame [m]; None: as its model
    has it."""

    def of_lidar(self, name: str) -> Scan | None:
        """The newest scan of a further LiDAR."""
        return next((scan for scan in self.further if scan.sensor == name), None)


AHEAD = 0.02
"""Clocks agree to this [s]: a reading that is stamped later than now by more is from the future."""


def untouched(model: RobotModel, now: float) -> tuple[Contact, ...]:
    """All its bumpers and cliff sensors, none of them on. now: the robot's clock [s]."""
    return tuple(Contact(now, one.name, False) for one in model.contacts)


class RobotPort(Protocol):
    """The port. All calls come from one thread and return at once, but for `wait`."""

    @property
    def model(self) -> RobotModel:
        """Outline, limits, sensors."""
        ...

    def now(self) -> float:
        """The robot's monotonic clock [s]."""
        ...

    def wait(self, until: float) -> None:
        """Return when `now()` has reached `until`; a simulated robot moves on meanwhile."""
        ...

    def read(self) -> Readings:
        """The newest readings. Reading twice gives the same again."""
        ...

    def send(self, twist: Twist) -> Twist:
        """Ask for a twist until the next call; returns what the robot will try to do.

        A twist that is not finite, or beyond the limits, is changed, as the return value shows.
        Without a call for its own time-out the robot stops by itself.
        """
        ...

    def stop(self) -> None:
        """Brake to standing, now. May be called at any time and any number of times."""
        ...

    def close(self) -> None:
        """Stop, and release everything. Calls after this raise `CohelmError`."""
        ...


@runtime_checkable
class DrawnCamera(Protocol):
    """A robot whose pictures cost what others need: it draws those that somebody uses."""

    def draw_at(self, rate: float) -> None:
        """Draw at most so many pictures a second from now on; 0: none, and none is read [Hz]."""
        ...


@runtime_checkable
class Traced(Protocol):
    """A robot with code of its user's, whose exceptions become faults."""

    def traceback(self) -> str:
        """Where the newest exception of another kind or place was raised, once; empty: none."""
        ...
