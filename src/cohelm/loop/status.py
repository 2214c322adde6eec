"""What is reported of a period: to the operator, and to the record."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.frames import compose
from cohelm.core.types import Floats, Pose, Twist, wrap
from cohelm.law import verdict as verdicts
from cohelm.link.latency_speed_limit import Cap
from cohelm.link.messages import (
    Alarm,
    Guarding,
    Lease,
    Localised,
    Mode,
    ScanPart,
    Status,
    Timing,
    Verdict,
)
from cohelm.link.wire import MOST_BEAMS
from cohelm.loop.stick_arming import Person
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.step import Decision
from cohelm.robot.kinematics import arc
from cohelm.robot.port import Readings, Scan
from cohelm.robot.sensors import Lidar

POOR = 0.1
"""A place with a larger standard deviation is poorly known [m]."""
_AHEAD, _AHEAD_STEP = 12, 0.15
_AS_ASKED = 0.03  # what differs by less is as asked [m/s, rad/s]
_NOBODY = Lease(0, 0, "", 0, "", math.nan)
VERDICTS = {
    verdicts.UNTOUCHED: Verdict.UNTOUCHED, verdicts.SHAPED: Verdict.SHAPED,
    verdicts.POWERLESS: Verdict.SHAPED, verdicts.INVALID: Verdict.INVALID,
    verdicts.BRAKING: Verdict.BRAKING, verdicts.STANDING: Verdict.STANDING,
}  # fmt: skip
"""What the link calls the verdicts of `law.verdict`."""


class Report(NamedTuple):
    """What the loop knows at the end of a period; status and record are made from it."""

    mode: Mode
    stopped: str
    person: Person
    seen: Seen
    has_map: bool
    decision: Decision | None
    applied: Twist
    why: str
    progress: float
    recording: bool
    late: float
    overruns: int
    alarms: tuple[Alarm, ...]
    cap: Cap
    clearance: float
    """Of the outline to anything that is seen [m]; inf: nothing is."""

    @property
    def e_p(self) -> float:
        """E_P, pose error (51); NaN where nothing is followed."""
        d, pose = self.decision, self.seen.pose
        if d is None:
            return math.nan
        return math.hypot(d.x_d - pose.x, d.y_d - pose.y, wrap(d.psi_d - pose.psi))


def known(said: Report, now: float, readings: Readings) -> dict[str, Any]:
    """What the record keeps of it, by the names of `core.row.FIELDS`."""
    d, seen, person = said.decision, said.seen, said.person
    odometry, scan = readings.odometry, readings.scan
    fields = {"nominal_v": 0.0, "nominal_omega": 0.0} if d is None else d._asdict()
    at = (math.nan, math.nan) if d is None else limiting(d, seen)
    return fields | {
        "t": now, "x": seen.pose.x, "y": seen.pose.y, "psi": seen.pose.psi,
        "sigma": sigma(seen.covariance), "share": seen.share, "lost": seen.lost,
        "measured_v": seen.twist.v, "measured_omega": seen.twist.omega,
        "e_p": said.e_p, "progress": said.progress, "limiting_x": at[0], "limiting_y": at[1],
        "clearance_seen": said.clearance,
        "stick_x": person.stick.x, "stick_psi": person.stick.psi, "stick_age": person.age,
        "arming": person.arming, "applied_v": said.applied.v, "applied_omega": said.applied.omega,
        "odometry_age": now - odometry.stamp if odometry else math.nan,
        "scan_age": now - scan.stamp - scan.duration if scan else math.nan,
    }  # fmt: skip


def status(said: Report, ahead: tuple[tuple[float, float], ...]) -> Status:
    """The message; lease, answers and the link's part of the timing are filled in by the link."""
    d, seen = said.decision, said.seen
    nan = math.nan
    nominal = Twist(d.nominal_v, d.nominal_omega) if d else Twist(0.0, 0.0)
    return Status(
        lease=_NOBODY,
        mode=said.mode,
        stopped=said.stopped,
        arming=said.person.arming,
        stick=said.person.stick,
        authority=min(d.authority_x, d.authority_psi) if d else nan,
        pose=seen.pose,
        odometry=seen.odometry,
        twist=seen.twist,
        nominal=nominal,
        applied=said.applied,
        why=said.why or _unseen(said, nominal),
        guarding=_guarding(said),
        e_p=said.e_p,
        reference=Pose(d.x_d, d.y_d, d.psi_d) if d else Pose(nan, nan, nan),
        progress=said.progress,
        speed_cap=said.cap.speed,
        cap_reason=said.cap.reason,
        localised=_localised(said),
        sigma=sigma(seen.covariance),
        recording=said.recording,
        timing=Timing(said.late, said.overruns, said.person.age, nan, nan, 0),
        alarms=said.alarms,
        answers=(),
        ahead=ahead,
        ahead_step=_AHEAD_STEP,
    )


def predicted(pose: Pose, twist: Twist) -> tuple[tuple[float, float], ...]:
    """Where the robot goes if it goes on as it does, in the map."""
    points: list[tuple[float, float]] = []
    for k in range(1, _AHEAD + 1):
        there = arc(pose, twist, k * _AHEAD_STEP)
        points.append((there.x, there.y))
    return tuple(points)


def scan_parts(scan: Scan, lidar: Lidar, body: Pose, which: int = 0) -> tuple[ScanPart, ...]:
    """A scan for the operator's map, in as many parts as it takes, as if taken from one pose.
    which: of the robot's LiDARs."""
    sensor = compose(body, lidar.mount)
    known = np.where(scan.ranges == -math.inf, 0.0, scan.ranges)
    far = ~np.isfinite(known)
    whole = np.round(1000.0 * np.where(far, 0.0, known))
    ranges = np.where(far, 65535, np.minimum(whole, 65534)).astype(np.uint16)
    n = len(ranges)
    return tuple(
        ScanPart(
            scan.number, which, scan.stamp, sensor, n, start, lidar.first, lidar.step,
            ranges[start : start + MOST_BEAMS],
        )
        for start in range(0, n, MOST_BEAMS)
    )  # fmt: skip


def sigma(covariance: Floats) -> float:
    """Standard deviation of a place, in its worst direction [m]."""
    a, b, c = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    return math.sqrt(max(0.5 * (a + c) + math.hypot(0.5 * (a - c), b), 0.0))


def limiting(d: Decision, seen: Seen) -> tuple[float, float]:
    """Where in the map the thing is that the guard acted for [m]; NaN where there is none."""
    if d.limiting < 0:
        return (math.nan, math.nan)
    moving = len(seen.mobile)
    things = seen.mobile if d.limiting < moving else seen.points
    row = d.limiting if d.limiting < moving else d.limiting - moving
    if row >= len(things):
        return (math.nan, math.nan)
    place = compose(seen.map_odom, Pose(float(things[row, 0]), float(things[row, 1]), 0.0))
    return (place.x, place.y)


def _guarding(said: Report) -> Guarding:
    d, clear = said.decision, said.clearance
    if d is None:
        return Guarding(Verdict.UNTOUCHED, clear, (math.nan, math.nan), math.nan)
    verdict = VERDICTS.get(d.verdict, Verdict.NO_FILTER)
    return Guarding(verdict, clear, limiting(d, said.seen), d.h)


def _unseen(said: Report, nominal: Twist) -> str:
    """That the guard holds the robot back for what nothing shows: ground that may hold anything, or
    a keep-out zone."""
    d, seen, applied = said.decision, said.seen, said.applied
    if d is None or d.limiting < len(seen.mobile) + len(seen.points) - seen.blind:
        return ""
    if abs(nominal.v - applied.v) < _AS_ASKED and abs(nominal.omega - applied.omega) < _AS_ASKED:
        return ""
    if d.limiting >= len(seen.mobile) + len(seen.points):
        return "held back: a keep-out zone"
    return "held back: nothing looks there, it may not be free"


def _localised(said: Report) -> Localised:
    if said.seen.lost:
        return Localised.LOST
    if not said.has_map:
        return Localised.UNKNOWN
    return Localised.POOR if sigma(said.seen.covariance) > POOR else Localised.GOOD
