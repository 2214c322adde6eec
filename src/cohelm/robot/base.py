"""The base class of a user's robot: three methods to write, and what it supplies for them."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cohelm.core.arrays import floats
from cohelm.core.errors import CohelmError
from cohelm.core.obstacles import check_in_metres
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.clock import sleep_until
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Contact, Odometry, Readings, Scan
from cohelm.robot.sensors import of_sensor


class Robot(ABC):
    """A user's robot. Write `read`, `send` and `stop`; `robot.adapter` supplies the rest.

        >>> import cohelm
        >>> class Cart(cohelm.Robot):
        ...     def read(self):
        ...         return cohelm.Readings(self.odometry(cohelm.Pose(0, 0, 0), cohelm.Twist(0, 0)))
        ...     def send(self, twist): ...
        ...     def stop(self): ...
        >>> Cart(cohelm.load_robot("jackal")).model.name
        'jackal'

    Supplied around it: limits (no twist beyond the model's speeds is sent, none that is not
    finite), the time-out (without a command for `timeout` it is stopped), scan numbers, stamps,
    health, and that an exception becomes a fault with its sentence.

    It is made in a process of its own, which calls it from one thread at a time; only a `stop` may
    come from another while a call hangs. No call may take longer than a few milliseconds: read what
    has arrived, do not wait for it.
    """

    timeout = 0.5
    """Time without a command after which it is stopped [s]. The hardware needs a time-out of its
    own, too: this one dies with the process."""
    real_time = True
    """Whether time passes by itself; False for a simulator that overrides `now` and `wait`."""

    def __init__(self, model: RobotModel) -> None:
        """model: outline, limits, sensors, delay; `load_robot("my.yaml")`."""
        self.model = model
        self._begun = time.monotonic()
        self._scans: dict[str, int] = {}

    @abstractmethod
    def read(self) -> Readings:
        """The newest readings: at least odometry; a scan, frame or health only if it is new.

        Stamps are those of `now()`; `odometry` and `scan` below make them.
        """

    @abstractmethod
    def send(self, twist: Twist) -> None:
        """Command a twist [m/s, rad/s], within the model's speeds, until the next."""

    @abstractmethod
    def stop(self) -> None:
        """Brake to standing. Called every 0.1 s while the robot has to stand."""

    def close(self) -> None:  # noqa: B027  # there is not always anything to release
        """Release the hardware; it has been stopped. Override where there is anything."""

    def now(self) -> float:
        """The robot's monotonic clock [s]."""
        return time.monotonic() - self._begun

    def wait(self, until: float) -> None:
        """Return when `now()` has reached `until` [s]."""
        sleep_until(until, self.now)

    def odometry(self, pose: Pose, twist: Twist, age: float = 0.0) -> Odometry:
        """An odometry reading: pose in a continuous frame with any origin [m, m, rad], measured
        twist [m/s, rad/s], and its age [s]. Raises CohelmError for what is none."""
        try:
            at, measured = Pose(*map(float, pose)), Twist(*map(float, twist))
        except (TypeError, ValueError) as error:
            raise CohelmError(
                "odometry takes pose (x, y, psi) and twist (v, omega), each of numbers, got "
                f"{pose!r} and {twist!r}"
            ) from error
        return Odometry(self.now() - _aged(age), at, measured)

    def scan(
        self, ranges: ArrayLike, age: float = 0.0, duration: float = 0.0, sensor: str | None = None,
        edges: NDArray[np.bool_] | None = None,
    ) -> Scan:  # fmt: skip
        """One new scan of the LiDAR, counter-clockwise as the model describes it; call it once for
        each.

        ranges: (beams,) [m]; those below the LiDAR's least range become -inf, those above its
        largest, inf (REP-117). age: of its last beam [s]. duration: from its first beam to its last
        [s]. sensor: name of one of several LiDARs, by default the first; scans of the others go
        into `Readings.further`. edges: (beams,), as in `Scan`.
        Raises CohelmError for another number of beams, ranges in millimetres or centimetres, or an
        unknown LiDAR.
        """
        known = {lidar.name: lidar for lidar in self.model.lidars}
        if not known:
            raise CohelmError(f"{self.model.name} has no LiDAR: describe it in the robot's YAML")
        name = next(iter(known)) if sensor is None else sensor
        if name not in known:
            raise CohelmError(
                f"{self.model.name} has no LiDAR {name!r}: choose {', '.join(map(repr, known))}, "
                "or describe it in the robot's YAML"
            )
        lidar = known[name]
        made: Floats = floats("ranges", ranges).copy()
        if made.shape != (lidar.beams,):
            raise CohelmError(of_sensor(
                name, f"a scan of {self.model.name} has {lidar.beams} beams, got shape "
                f"{made.shape}: set lidar.beams in the robot's YAML"
            ))  # fmt: skip
        measured = made[np.isfinite(made) & (made >= lidar.range_min_m)]
        if len(measured):  # the largest may be what this driver gives for no return
            check_in_metres(measured[measured < measured.max()], lidar.range_max_m)
        made[made < lidar.range_min_m] = -math.inf
        made[made > lidar.range_max_m] = math.inf
        made.flags.writeable = False
        number = self._scans.get(name, 0)
        self._scans[name] = number + 1
        try:
            lasted = float(duration)
        except (TypeError, ValueError) as error:
            raise CohelmError(f"duration is a scan's in seconds, got {duration!r}") from error
        if edges is not None:
            edges = np.asarray(edges, dtype=np.bool_)
            if edges.shape != made.shape:
                raise CohelmError(f"edges need one of each beam, got shape {edges.shape}")
        return Scan(self.now() - _aged(age) - lasted, number, made, lasted, name, edges)

    def contact(self, sensor: str, on: bool, age: float = 0.0) -> Contact:
        """A reading of a bumper or cliff sensor, for `Readings.contacts`: give it repeatedly, as a
        sensor that is silent for its time-out stops the robot.

        on: whether it is pressed, or sees no floor. age: of the reading [s]. Raises CohelmError for
        an unknown sensor.
        """
        known = [one.name for one in self.model.contacts]
        if sensor not in known:
            there = f"choose {', '.join(known)}, or " if known else ""
            raise CohelmError(
                f"{self.model.name} has no bumper or cliff sensor {sensor!r}: {there}describe it "
                "in the robot's YAML"
            )
        if on is None:  # pyright: ignore[reportUnnecessaryComparison]
            raise CohelmError(f"{sensor} is pressed or is not, got None: give its last reading")
        return Contact(self.now() - _aged(age), sensor, bool(on))


OLDEST = 1e6
"""Older than this is no reading but a stamp's own number [s]."""


def _aged(age: float) -> float:
    """An age [s]. Raises CohelmError for what is none."""
    try:
        made = float(age)
    except (TypeError, ValueError) as error:
        raise CohelmError(f"age is how old a reading is in seconds, got {age!r}") from error
    if made > OLDEST:
        raise CohelmError(
            f"age is how old a reading is in seconds, got {made:.0f}: give the driver's clock of "
            "now less the stamp, not the stamp"
        )
    return made
