"""False sensor readings, finite and plausible at a glance; each begins at a set time.

What each is noticed by, and how soon, stands in `LIES`; `tests/drive/test_lies.py` holds it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Pose, Twist
from cohelm.drive.factory import Simulated
from cohelm.robot.port import Odometry, Readings, Scan
from tests.drive.wrapped import wrapped


class Lie(NamedTuple):
    """What is noticed of a lie that begins in motion."""

    within: float
    """The robot stands or is slowed, with a reason, after so long at most, while driven [s];
    infinite: it is not noticed, and does no harm."""
    about: str = ""
    """Some of the reason."""


UNSEEN = math.inf

LIES = {
    # the scan
    "frozen": Lie(0.2, "repeats"),
    "frozen, with new noise": Lie(0.5, ""),
    "all infinite": Lie(0.2, ""),
    "all 9.99 m": Lie(0.2, ""),
    "all 9.99 m, with noise": Lie(0.5, ""),
    "front quarter infinite": Lie(0.2, ""),
    "front quarter frozen": Lie(0.2, "repeats"),
    "front quarter at one value": Lie(0.2, ""),
    "0.3 s older than stamped": Lie(0.6, ""),
    "mounted 5 deg off": Lie(6.0, ""),
    "ten times the noise": Lie(0.4, "noisy"),
    "mirrored": Lie(UNSEEN, ""),
    "turned by a beam": Lie(UNSEEN),
    "turned by a quarter": Lie(0.5, ""),
    "ranges 10 % long": Lie(UNSEEN, ""),
    "ranges 10 % short": Lie(UNSEEN, ""),
    "half of the beams no number": Lie(0.5, "not a number"),
    "every other beam empty": Lie(0.5, "see nothing"),
    "number stays": Lie(0.15, "number"),
    "old scans again and again": Lie(0.2, "repeats"),
    "turned a beam on at each repeat": Lie(0.2, "repeats"),
    "a wall that is not there": Lie(UNSEEN),
    "shorter by half a metre": Lie(UNSEEN),
    "longer by half a metre": Lie(0.5, ""),
    "longer by 5 cm more every second": Lie(4.0, ""),  # 0.12 m in 2.4 s
    "stamped 0.2 s ago": Lie(0.6, ""),
    # odometry
    "odometry frozen": Lie(0.6, "odometry"),
    "odometry frozen at speed": Lie(0.6, "odometry"),
    "odometry 20 % short": Lie(UNSEEN, ""),
    "odometry 20 % long": Lie(UNSEEN, ""),
    "odometry backwards": Lie(0.6, "odometry"),
    "gyro off by 10 deg/s": Lie(1.0, ""),
    "odometry 0.2 s old": Lie(UNSEEN, ""),
    "odometry jumps by 0.1 m a second": Lie(1.1, "jump"),
    "speed half, pose right": Lie(2.0, "odometry"),  # 0.5 s above 0.4 m/s
    "pose half, speed right": Lie(0.6, "odometry"),
    "heading turned the wrong way": Lie(UNSEEN, ""),
}
"""The lies, each with when it is noticed."""


@dataclass(frozen=True)
class Lying(Simulated):
    """Tells one lie, from a time of the robot's clock on."""

    lie: str = ""
    at: float = math.inf

    def maker(self):
        return wrapped(super().maker(), Liar, self.lie, self.at, self.seed)


def lying(made: Simulated, lie: str, at: float) -> Lying:
    """A simulated robot that lies from a time of its clock on [s]."""
    return Lying(made.scenario, made.kind, made.real_time, made.seed, lie, at)


class Liar:
    """Another robot, as it says it is."""

    def __init__(self, robot, lie: str, at: float, seed: int) -> None:
        self._robot, self._lie, self._at = robot, lie, at
        self._random = np.random.default_rng((seed, 0x11E))
        self._before: Readings | None = None
        self._given: tuple[Scan, Scan] | None = None
        self._scans: deque[Scan] = deque(maxlen=40)
        self._odometry: deque[Odometry] = deque(maxlen=100)
        self._count = 0
        self.past: list[Scan] = []
        """The last five true scans."""
        self._made: tuple[Odometry, Odometry] | None = None

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def read(self) -> Readings:
        readings = self._robot.read()
        odometry, scan = readings.odometry, readings.scan
        if scan is not None and (not self._scans or scan.number != self._scans[-1].number):
            self._scans.append(scan)
        if odometry is not None and (not self._odometry or odometry != self._odometry[-1]):
            self._odometry.append(odometry)
        if not self._lie or self._robot.now() < self._at or scan is None or odometry is None:
            self._before = readings
            return readings
        if self._before is None:
            self._before = readings
        if not self.past:
            self.past = list(self._scans)[-5:]
        if self._given is None or self._given[0].number != scan.number:
            self._count += 1
            self._given = (scan, self._scan(scan))
        if self._made is None or self._made[0].stamp != odometry.stamp:
            self._made = (odometry, self._moved(odometry))
        return readings._replace(scan=self._given[1], odometry=self._made[1])

    def _scan(self, scan: Scan) -> Scan:
        told = _OF_SCAN.get(self._lie)
        return scan if told is None else told(self, scan)

    def _moved(self, odometry: Odometry) -> Odometry:
        told = _OF_ODOMETRY.get(self._lie)
        return odometry if told is None else told(self, odometry)

    # ---- what the lies need ------------------------------------------------------------

    @property
    def kept(self) -> Scan:
        """The last true scan."""
        return self._before.scan

    @property
    def held(self) -> Odometry:
        """The last true odometry."""
        return self._before.odometry

    def noise(self, n: int, sigma: float) -> np.ndarray:
        return sigma * self._random.standard_normal(n)

    def cut(self, ranges: np.ndarray) -> np.ndarray:
        """As the sensor would give them."""
        lidar = self._robot.model.lidar
        return np.where(
            np.isfinite(ranges), np.clip(ranges, lidar.range_min_m, lidar.range_max_m), ranges
        )

    def scan_at(self, t: float) -> Scan:
        old = [s for s in self._scans if s.stamp <= t]
        return old[-1] if old else self._scans[0]

    def odometry_at(self, t: float) -> Odometry:
        old = [o for o in self._odometry if o.stamp <= t]
        return old[-1] if old else self._odometry[0]


def _with(change: Callable) -> Callable:
    def told(liar: Liar, scan: Scan) -> Scan:
        return scan._replace(ranges=change(liar, scan.ranges.copy()))

    return told


def _front(liar: Liar, n: int) -> slice:
    """The beams up to 45 degrees to either side of ahead."""
    lidar = liar._robot.model.lidar
    per = (n - 1) / lidar.field_of_view_deg
    middle, half = (n - 1) / 2, 45.0 * per
    return slice(int(middle - half), int(middle + half) + 1)


def _in_front(value: Callable) -> Callable:
    def change(liar: Liar, ranges):
        where = _front(liar, len(ranges))
        ranges[where] = value(liar, ranges)[where]
        return ranges

    return _with(change)


def _every_other(value: float) -> Callable:
    def change(liar: Liar, ranges):
        ranges[::2] = value
        return ranges

    return _with(change)


def _shifted(beams: Callable[[Liar], float]) -> Callable:
    return _with(lambda liar, r: np.roll(r, round(beams(liar))))


def _per_deg(liar: Liar) -> float:
    lidar = liar._robot.model.lidar
    return (lidar.beams - 1) / lidar.field_of_view_deg


def _wall(liar: Liar, ranges):
    """Two metres ahead of where the robot is, across, going along with it."""
    lidar = liar._robot.model.lidar.lidar()
    ahead = lidar.beams[:, 0]
    with np.errstate(divide="ignore"):
        there = np.where(ahead > 0.7, 2.0 / ahead, math.inf)
    return np.minimum(ranges, liar.cut(there + liar.noise(len(ranges), lidar.noise)))


_OF_SCAN: dict[str, Callable] = {
    "frozen": lambda liar, s: s._replace(ranges=liar.kept.ranges),
    "frozen, with new noise": _with(
        lambda liar, r: liar.cut(liar.kept.ranges + liar.noise(len(r), 0.02))
    ),
    "all infinite": _with(lambda _, r: np.full(len(r), math.inf)),
    "all 9.99 m": _with(lambda _, r: np.full(len(r), 9.99)),
    "all 9.99 m, with noise": _with(lambda liar, r: 9.99 + liar.noise(len(r), 0.02)),
    "front quarter infinite": _in_front(lambda _, r: np.full(len(r), math.inf)),
    "front quarter frozen": _in_front(lambda liar, _: liar.kept.ranges),
    "front quarter at one value": _in_front(lambda _, r: np.full(len(r), 4.0)),
    "0.3 s older than stamped": lambda liar, s: s._replace(
        ranges=liar.cut(
            liar.scan_at(s.stamp - 0.3 + 1e-6).ranges + liar.noise(len(s.ranges), 0.005)
        )
    ),
    "mounted 5 deg off": _shifted(lambda liar: 5.0 * _per_deg(liar)),
    "ten times the noise": _with(lambda liar, r: liar.cut(r + liar.noise(len(r), 0.2))),
    "mirrored": _with(lambda _, r: r[::-1].copy()),
    "turned by a beam": _shifted(lambda _: 1),
    "turned by a quarter": _shifted(lambda liar: 90.0 * _per_deg(liar)),
    "ranges 10 % long": _with(lambda liar, r: liar.cut(1.1 * r)),
    "ranges 10 % short": _with(lambda liar, r: liar.cut(0.9 * r)),
    "half of the beams no number": _every_other(math.nan),
    "every other beam empty": _every_other(math.inf),
    "number stays": lambda liar, s: s._replace(number=liar.kept.number),
    "old scans again and again": lambda liar, s: s._replace(
        ranges=liar.past[liar._count % len(liar.past)].ranges
    ),
    "turned a beam on at each repeat": lambda liar, s: s._replace(
        ranges=np.roll(liar.kept.ranges, liar._count)
    ),
    "a wall that is not there": _with(_wall),
    "shorter by half a metre": _with(lambda liar, r: liar.cut(r - 0.5)),
    "longer by half a metre": _with(lambda liar, r: liar.cut(r + 0.5)),
    "longer by 5 cm more every second": lambda liar, s: s._replace(
        ranges=liar.cut(s.ranges + 0.05 * (s.stamp - liar.kept.stamp))
    ),
    "stamped 0.2 s ago": lambda _, s: s._replace(stamp=s.stamp - 0.2),
}


def _scaled(share: float) -> Callable:
    def told(liar: Liar, o: Odometry) -> Odometry:
        a, b = liar.held.pose, o.pose
        pose = Pose(a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), b.psi)
        return o._replace(pose=pose, twist=Twist(share * o.twist.v, o.twist.omega))

    return told


def _biased(liar: Liar, o: Odometry) -> Odometry:
    """As an odometer adds it up: the way is turned, too."""
    rate = math.radians(10.0)
    added = getattr(liar, "added", None) or [liar.held, liar.held.pose]
    last, pose = added
    dx, dy = o.pose.x - last.pose.x, o.pose.y - last.pose.y
    off = pose.psi - last.pose.psi
    c, s = math.cos(off), math.sin(off)
    turn = math.remainder(o.pose.psi - last.pose.psi, 2.0 * math.pi)
    psi = pose.psi + turn + rate * (o.stamp - last.stamp)
    pose = Pose(pose.x + c * dx - s * dy, pose.y + s * dx + c * dy, psi)
    liar.added = [o, pose]
    return o._replace(pose=pose, twist=Twist(o.twist.v, o.twist.omega + rate))


def _turned_wrong(liar: Liar, o: Odometry) -> Odometry:
    """The gyro's sign is wrong, and the way follows its heading."""
    added = getattr(liar, "added", None) or [liar.held, liar.held.pose]
    last, pose = added
    dx, dy = o.pose.x - last.pose.x, o.pose.y - last.pose.y
    turn = math.remainder(o.pose.psi - last.pose.psi, 2.0 * math.pi)
    off = (pose.psi - 0.5 * turn) - (last.pose.psi + 0.5 * turn)
    c, s = math.cos(off), math.sin(off)
    pose = Pose(pose.x + c * dx - s * dy, pose.y + s * dx + c * dy, pose.psi - turn)
    liar.added = [o, pose]
    return o._replace(pose=pose, twist=Twist(o.twist.v, -o.twist.omega))


def _jumping(liar: Liar, o: Odometry) -> Odometry:
    jumps = math.floor(o.stamp - liar._at) + 1
    return o._replace(pose=Pose(o.pose.x - 0.1 * jumps, o.pose.y, o.pose.psi))


_OF_ODOMETRY: dict[str, Callable] = {
    "odometry frozen": lambda liar, o: o._replace(pose=liar.held.pose, twist=Twist(0.0, 0.0)),
    "odometry frozen at speed": lambda liar, o: o._replace(
        pose=liar.held.pose, twist=liar.held.twist
    ),
    "odometry 20 % short": _scaled(0.8),
    "odometry 20 % long": _scaled(1.2),
    "odometry backwards": _scaled(-1.0),
    "gyro off by 10 deg/s": _biased,
    "odometry 0.2 s old": lambda liar, o: liar.odometry_at(
        o.stamp - min(0.2, 0.1 * (o.stamp - liar._at))
    )._replace(stamp=o.stamp),
    "odometry jumps by 0.1 m a second": _jumping,
    "speed half, pose right": lambda _, o: o._replace(twist=Twist(0.5 * o.twist.v, o.twist.omega)),
    "pose half, speed right": lambda liar, o: o._replace(pose=_scaled(0.5)(liar, o).pose),
    "heading turned the wrong way": _turned_wrong,
}


assert set(LIES) == set(_OF_SCAN) | set(_OF_ODOMETRY)
