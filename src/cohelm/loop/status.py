"""Makes a period's row and status message."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from cohelm.core.flat import named
from cohelm.core.frames import compose
from cohelm.core.row import MEANINGS
from cohelm.core.types import Floats, Pose, Twist
from cohelm.link.messages import (
    MOST_BEAMS,
    Discs,
    DockPhase,
    Lease,
    Localised,
    Mode,
    ScanPart,
    Status,
    TimingReport,
)
from cohelm.link.operator import Operator
from cohelm.link.recorded_status import StatusWords
from cohelm.link.scans import millimetres
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.stick import StickState
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.step import Decision
from cohelm.robot.kinematics import arc
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings, Scan
from cohelm.robot.sensors import Lidar

_POOR_SIGMA = 0.1
"""A larger standard deviation counts as poor localisation [m]."""
AHEAD, AHEAD_STEP = 12, 0.15
"""Points of the predicted path, and the time from one to the next [s]."""
DONE = "the route is done"
_TOLERANCE = 0.03  # smaller differences between nominal and applied do not count [m/s, rad/s]
_IN_WORDS = tuple(name for name in StatusWords._fields if name in Status._fields)
"""Fields that a status has as the words have them."""


def _columns(name: str, kind: Any) -> tuple[str, ...]:
    """The fields of the row of which a field of the status is made; none for one that is not."""
    found = tuple(f"{name}_{part}" for part in getattr(kind, "_fields", ())) or (name,)
    made = isinstance(kind, type) and name not in _IN_WORDS and set(found) <= set(MEANINGS)
    return found if made else ()


_IN_ROW = [
    (name, kind, columns)
    for name, kind in get_type_hints(Status).items()
    if (columns := _columns(name, kind))
]
"""Fields that a status has as the row has them: name, type, and what it is made of."""


_UNKNOWN = Twist(math.nan, math.nan)
_NONE_DECIDED = ("nominal_v", "nominal_omega", "safe_v", "safe_omega")
"""Numbers of a decision that are 0 where nothing was decided."""


class PeriodReport(NamedTuple):
    """What the loop knows of a period once its command is sent."""

    now: float
    """When the readings were taken [s]."""
    readings: Readings
    seen: Seen
    stick_state: StickState
    decision: Decision | None
    applied: Twist
    measures: bool
    """Whether the odometry is valid; else the twist of `seen` is an old one..."""
    sees: bool
    """... and whether the scans are, too; else its obstacles only grow by what they may do."""


def period_fields(r: PeriodReport) -> dict[str, Any]:
    """A report's numbers, by the names of `core.row.FIELDS`."""
    d, seen, stick_state = r.decision, r.seen, r.stick_state
    odometry, scan = r.readings.odometry, r.readings.scan
    fields: dict[str, Any] = dict.fromkeys(_NONE_DECIDED, 0.0)
    if d is not None:
        fields = named(d) | {f"{name}_d": part for name, part in d.desired._asdict().items()}
    at = (math.nan, math.nan) if d is None else limiting(d, seen)
    measured = seen.twist if r.measures else _UNKNOWN
    return fields | {
        "t": r.now, "x": seen.pose.x, "y": seen.pose.y, "psi": seen.pose.psi,
        "sigma": sigma(seen.covariance), "share": seen.share, "lost": seen.lost,
        "measured_v": measured.v, "measured_omega": measured.omega,
        "limiting_x": at[0], "limiting_y": at[1],
        "stick_x": stick_state.stick.x, "stick_psi": stick_state.stick.psi,
        "stick_age": stick_state.received.age,
        "arming": stick_state.arming, "applied_v": r.applied.v, "applied_omega": r.applied.omega,
        "odometry_age": r.now - odometry.stamp if odometry else math.nan,
        "scan_age": r.now - scan.stamp - scan.duration if scan else math.nan,
    }  # fmt: skip


def status(
    row: NDArray[np.void] | np.void, words: StatusWords, has_map: bool,
    ahead: tuple[tuple[float, float], ...],
) -> Status:  # fmt: skip
    """The status message of a period, live or recorded.

    row: its numbers. has_map: whether its pose is on a map. ahead: predicted path. Lease, answers
    and the link's part of the timing are filled in by the link.
    """

    def f(name: str) -> float:
        return float(row[name])

    def made(kind: Any, columns: tuple[str, ...]) -> Any:
        if issubclass(kind, int):
            return kind(max(int(row[columns[0]]), 0))  # -1: not known
        return kind(*map(f, columns))

    return Status(
        **{name: made(kind, columns) for name, kind, columns in _IN_ROW},
        **{name: getattr(words, name) for name in _IN_WORDS},
        lease=Lease(0, words.driver, words.driver_name, 0, "", math.nan),
        authority=min(f("authority_x"), f("authority_psi")),
        pose=Pose(f("x"), f("y"), f("psi")),
        limiting=(f("limiting_x"), f("limiting_y")),
        reference=Pose(f("x_d"), f("y_d"), f("psi_d")),
        localised=_localised(bool(row["lost"]), f("sigma"), has_map),
        recording=False,
        timing=TimingReport(f("late"), int(row["overruns"]), f("stick_age"), math.nan, math.nan, 0),
        answers=(),
        ahead=ahead,
        ahead_step=AHEAD_STEP,
    )


def predicted(pose: Pose, twist: Twist) -> tuple[tuple[float, float], ...]:
    """The predicted path at constant twist, in the map [m]."""
    points: list[tuple[float, float]] = []
    for k in range(1, AHEAD + 1):
        there = arc(pose, twist, k * AHEAD_STEP)
        points.append((there.x, there.y))
    return tuple(points)


def scan_parts(scan: Scan, lidar: Lidar, body: Pose, which: int = 0) -> tuple[ScanPart, ...]:
    """A scan for the operator's map, in parts, as if taken from one pose. which: index of the
    LiDAR."""
    sensor = compose(body, lidar.mount)
    ranges = millimetres(scan.ranges)
    n = len(ranges)
    return tuple(
        ScanPart(
            scan.number, which, scan.stamp, sensor, n, start, lidar.first, lidar.step,
            ranges[start : start + MOST_BEAMS],
        )
        for start in range(0, n, MOST_BEAMS)
    )  # fmt: skip


def sigma(covariance: Floats) -> float:
    """Standard deviation of a position, in its worst direction [m]."""
    a, b, c = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    return math.sqrt(max(0.5 * (a + c) + math.hypot(0.5 * (a - c), b), 0.0))


def limiting(d: Decision, seen: Seen) -> tuple[float, float]:
    """Position in the map of the limiting obstacle [m]; NaN where there is none, and of a zone."""
    if d.limiting < 0:
        return (math.nan, math.nan)
    discs, points = seen.obstacles.discs, seen.obstacles.points[: seen.unobserved.stop]
    moving = len(discs)
    things = discs if d.limiting < moving else points
    row = d.limiting if d.limiting < moving else d.limiting - moving
    if row >= len(things):
        return (math.nan, math.nan)
    return (float(things[row, 0]), float(things[row, 1]))


def hidden_reason(r: PeriodReport, nominal: Twist) -> str:
    """Why the guard holds the robot back for nothing visible: unobserved space, or a keep-out zone;
    empty: it does not."""
    d, seen, applied = r.decision, r.seen, r.applied
    discs, unobserved = len(seen.obstacles.discs), seen.unobserved
    if d is None or d.limiting < discs + unobserved.start:
        return ""
    if abs(nominal.v - applied.v) < _TOLERANCE and abs(nominal.omega - applied.omega) < _TOLERANCE:
        return ""
    if d.limiting >= discs + unobserved.stop:
        return "limited: keep-out zone"
    return "limited: unobserved space"


def _localised(lost: bool, sigma: float, has_map: bool) -> Localised:
    if lost:
        return Localised.LOST
    if not has_map:
        return Localised.UNKNOWN
    return Localised.POOR if sigma > _POOR_SIGMA else Localised.GOOD


_MAX_STATUS_RATE = 50.0  # statuses a second, at most
_MAX_DISCS = 40  # shown, at most
_NO_DISCS: Floats = np.empty((0, 6))


class Reporter:
    """Sends each period of a loop to the recorder, the live view and the operator."""

    def __init__(
        self, log: DriveLog, operator: Operator, driver: Driver, model: RobotModel, has_map: bool,
        period: float,
    ) -> None:  # fmt: skip
        """has_map: whether poses are those of a map. period: [s]."""
        self._log, self._operator, self.driver = log, operator, driver
        self._has_map, self._period = has_map, period
        self._lidars = {
            one.name if k else "": (k, one.lidar()) for k, one in enumerate(model.lidars)
        }
        """Index and LiDAR by the name of its scans; the first one's is empty."""
        self._last_status = -math.inf
        self.held = ""
        """Why the guard holds the robot back for nothing visible; empty: it does not."""

    def report(
        self, report: PeriodReport, loop_fields: Mapping[str, Any], words: StatusWords, late: float
    ) -> None:
        """Send new scans and discs, the period's row, and a status where one is due.

        loop_fields: what the loop adds to the row. words: without `held`. late: worst recent
        lateness [s].
        """
        self._show_scans(report)
        clearance = self.driver.clearance(report.seen) if report.sees else math.nan
        row = self._log.period({
            **period_fields(report), "progress": self._progress(), "dropped": self._log.dropped,
            "clearance_seen": clearance, **loop_fields,
        })  # fmt: skip
        if report.now - self._last_status < 1.0 / _MAX_STATUS_RATE - 0.25 * self._period:
            return
        self._last_status = report.now
        nominal = Twist(float(row["nominal_v"]), float(row["nominal_omega"]))
        self.held = hidden_reason(report, nominal)
        words = words._replace(why=words.why or self.held or self._done(row, words.mode))
        self._log.words(words)
        made = status(row, words, self._has_map, predicted(report.seen.pose, report.applied))
        timing = made.timing._replace(late=late)
        self._operator.send_status(made._replace(recording=self._log.open, timing=timing))

    def _show_scans(self, report: PeriodReport) -> None:
        readings, seen = report.readings, report.seen
        new = self._log.readings(readings)
        for scan in new:
            which, lidar = self._lidars.get("" if scan is readings.scan else scan.sensor, (0, None))
            if lidar is not None:
                self._operator.show(*scan_parts(scan, lidar, seen.pose, which))
        if new and new[0] is readings.scan:
            known = seen.obstacles.discs if report.sees else _NO_DISCS
            discs = Discs(new[0].number, _nearest(known, seen.pose))
            self._operator.show(discs)
            self._log.show(discs)

    def _done(self, row: NDArray[np.void], mode: Mode) -> str:
        """Why nothing is commanded at the end of the route; empty: something is, or the robot is
        not there."""
        docks = int(row["docking"]) in (DockPhase.DOCKING, DockPhase.UNDOCKING)
        follows = mode in (Mode.AUTOMATIC, Mode.SHARED) and self.driver.arrived and not docks
        still = abs(row["nominal_v"]) < _TOLERANCE and abs(row["nominal_omega"]) < _TOLERANCE
        return DONE if follows and still else ""

    def _progress(self) -> float:
        pilot = self.driver.pilot
        if pilot is None:
            return math.nan
        return pilot.state.row / max(len(pilot.planner.route.line) - 1, 1)


def _nearest(discs: Floats, pose: Pose) -> NDArray[np.float32]:
    """The nearest of the round obstacles, (n, 6) as in `core.types`."""
    far = np.hypot(discs[:, 0] - pose.x, discs[:, 1] - pose.y)
    return discs[np.argsort(far)[:_MAX_DISCS]].astype(np.float32)
