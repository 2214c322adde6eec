"""The collision monitor: slows and stops the robot before obstacles in the raw scans.

Three estimates of the motion, of which the worst counts: the odometry's twist, the change of its
poses, and the commands sent. So one wrong source is not enough to hide motion. In unobserved space
the robot crawls. It can not know what the scan does not show.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import compose, inverse
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.collision_monitor.contacts import NEVER, Met, met
from cohelm.robot.collision_monitor.fields import CRAWL, RESERVE, allowed, horizon
from cohelm.robot.collision_monitor.free_space import UNWATCHED, unknown_to_all
from cohelm.robot.collision_monitor.odometry import GAP, KEPT, PoseHistory, jumped
from cohelm.robot.collision_monitor.returns import TOO_NEAR, Sensor, returns
from cohelm.robot.collision_monitor.runaway import PATIENCE, Runaway
from cohelm.robot.collision_monitor.source import MISSED, MonitorSource
from cohelm.robot.collision_monitor.surroundings import (
    NOTHING,
    MonitorSurroundings,
    all_of,
    all_round,
    joined,
    seen_by,
    seen_by_both,
)  # fmt: skip
from cohelm.robot.collision_monitor.sweep import around, edge_distances, fastest, outline
from cohelm.robot.gate.bounds import Bounds, change_time
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.port import AHEAD, Odometry, Readings

INCREMENTS = 0.04
"""Baseline of the twist from poses [s]: two readings at 50 Hz, against encoder quantisation."""
LAG = 0.1
"""Commands within this time explain a measured motion [s]: drives lag by some 50 ms, and odometry
is averaged over a reading and late."""
LASTS = 1.0
"""A reason keeps its text until it has been absent for this long [s]."""
_NONE = Twist(0.0, 0.0)
_WHAT = {
    -math.inf: "unobserved ground", UNWATCHED: "unobserved floor",
    TOO_NEAR: "something closer than the minimum range",
}  # fmt: skip


class Described(NamedTuple):
    """The robot's description as plain numbers."""

    corners: Floats
    """Of its outline, convex, counter-clockwise, (k, 2), body frame [m]."""
    sensors: tuple[Sensor, ...]
    """All LiDARs, the first one first."""
    bounds: Bounds
    """The gate's braking limits."""
    delay: float
    """From a command to the wheels [s]."""
    period: float
    """From one command to the next [s]."""
    age: float
    """Of readings, at most, with which the gate passes anything [s]."""


class MonitoredMotion(NamedTuple):
    """The result of a motion check."""

    share: float
    """Allowed share of the motion; may be above 1."""
    point: int
    """Index of the limiting point; -1: none."""


FREE = MonitoredMotion(math.inf, -1)


class CollisionMonitor:
    """A `robot.monitor.Monitor` of one robot."""

    def __init__(self, described: Described) -> None:
        self._robot, self._shape = described, outline(described.corners)
        self._outline, self._free = self._shape.corners, False
        """The robot's newest outline; and whether the last motion passed."""
        bounds = described.bounds
        top = Twist(min(bounds.speed, bounds.wheel_speed), 0.0)
        spin = Twist(0.0, min(bounds.yaw_rate, 2.0 * bounds.wheel_speed / bounds.track))
        known = [change_time(twist, bounds) for twist in (top, spin) if math.isfinite(sum(twist))]
        stopping = max(known, default=0.0)
        self._runaway = Runaway(described.delay, stopping)
        self._stopping = stopping + described.delay
        self._top, self._gap = Twist(top.v, spin.omega), max(GAP, described.age)
        remembers = not any(
            all_round(sensor) and sensor.forgets == math.inf for sensor in described.sensors
        )
        self._sources = [
            MonitorSource(sensor, i == 0, self._shape, self._farthest(), remembers)
            for i, sensor in enumerate(described.sensors)
        ]
        oldest = max(one.sweep + one.latency + MISSED / one.rate for one in described.sensors)
        kept = max(KEPT, oldest)  # of a first beam, two lost scans later
        self._measured, self._commanded = PoseHistory(kept), PoseHistory(kept)
        self._frame: Pose | None = None
        """Where the odometry's frame lies in that of what is remembered, which goes on where the
        odometry jumps; None: it is the same."""
        self._reported = Pose(0.0, 0.0, 0.0), _NONE
        """The newest pose and twist of the odometry."""
        self._reckoned = Pose(0.0, 0.0, 0.0)
        """Where the commands sent had led by then."""
        self._clock = self._sent = -math.inf
        """The robot's, at the last look; and when a twist was last checked, and so sent [s]."""
        self._all = NOTHING
        """All returns, remembered ones too, and ground that no beam looks at or has looked at,
        in the odometry's frame."""
        self._by_command = NOTHING
        """Returns of the newest scans in the frame of the poses reckoned from what was sent."""
        self._wrong = ""
        """What is wrong with the readings; empty: nothing."""
        self._words: dict[str, tuple[str, float]] = {}
        """Text and last time of each kind of restriction."""
        self._warm_up()

    def observe(
        self, now: float, readings: Readings, applied: Twist, stopped: bool = False
    ) -> Restriction:
        """Take odometry and scans; a fault on uncommanded motion."""
        self._update_outline(readings.outline, applied)
        if now < self._clock:  # it was set back: what was to happen then is long ago
            self._commanded.clear()
            self._runaway.forget()
            self._sent = -math.inf
        self._clock = now
        self._reckon(now, applied)
        self._wrong = self._take(now, readings.odometry) or self._look(now, readings)
        fresh = now - self._measured.stamp <= PATIENCE
        speed = self._speed() if fresh else math.nan
        if self._runaway.noticed(now, applied, speed):
            moves = f"the robot moves at {speed:.2f} m/s although it is commanded to stand"
            return Restriction(0.0, f"collision monitor: {moves}", fault=True)
        return UNRESTRICTED

    def restrict(self, now: float, twist: Twist) -> Restriction:
        """The share of a twist that the free space ahead allows, the present motion considered."""
        found = self._restricted(now, twist)
        self._free = found == UNRESTRICTED and twist != _NONE
        return found

    def _restricted(self, now: float, twist: Twist) -> Restriction:
        self._sent = now
        if twist == _NONE or not math.isfinite(twist.v + twist.omega):
            return UNRESTRICTED  # nothing to take from; the gate knows what to do with no number
        wrong = self._wrong or self._stale(now)
        if wrong:
            return self._worded(now, 0.0, "blind", wrong)
        obstacles = self._obstacles(now + self._robot.delay, twist)
        met, sent = self._met(obstacles, twist), self._commanded.twist
        where = self._braking(now, obstacles, met if sent == twist else self._met(obstacles, sent))
        if where:
            return self._worded(now, 0.0, "stop", f"{where} on the braking path")
        field = self._field(met, twist, self._robot.period, 1.0 - RESERVE)
        if field.share >= 1.0:
            return UNRESTRICTED
        where = self._where(obstacles, field.point)
        if field.share > 0.0:
            return self._worded(now, field.share, "slow", f"slower, {where}")
        return self._worded(now, 0.0, "stop", f"{where} on the braking path")

    def _warm_up(self) -> None:
        """Compile all that is used, before the gate process is in use."""
        here, sensor = Pose(0.0, 0.0, 0.0), self._robot.sensors[0]
        found = returns(np.ones(len(sensor.bearings)), sensor, math.inf)
        seen = MonitorSurroundings(found.points, found.errors, found.margins, found.passed)
        met(seen_by(seen, here, math.inf), _NONE, self._shape)
        edge_distances(seen.points, self._shape)

    def _farthest(self) -> float:
        """Distance beyond the turning circle from which nothing matters [m]."""
        return (self._top.v + self._top.omega * self._shape.reach) * self._stopping

    def _update_outline(self, reported: Floats | None, applied: Twist) -> None:
        """Use another outline, together with the previous one until a motion passes with both, or
        the robot stands."""
        if reported is not None and not np.array_equal(reported, self._outline):
            self._outline, self._free = np.array(reported, dtype=np.float64), False
            self._become(around(np.vstack((self._shape.corners, reported))))
        elif self._shape.corners is not self._outline and (
            self._free or (applied == _NONE and self._speed() <= CRAWL)
        ):
            self._become(self._outline)

    def _become(self, corners: Floats) -> None:
        self._shape = outline(corners)
        for source in self._sources:
            source.reshape(self._shape, self._farthest())

    def _speed(self) -> float:
        """Measured speed of the fastest point of the outline [m/s]."""
        return max(fastest(twist, self._shape) for twist in self._motions())

    def _obstacles(self, when: float, twist: Twist) -> MonitorSurroundings:
        """Obstacles near enough to matter to a twist, or to the one sent last: by odometry and by
        the commands sent, in the body frame at that time."""
        robot, reach = self._robot, self._shape.reach
        within = reach + max(
            fastest(motion, self._shape) * horizon(robot.period, self._brakes(motion, brakes))
            for motion, brakes in ((twist, 1.0 - RESERVE), (self._commanded.twist, 1.0))
        )
        measured, commanded = self._measured.at(when), self._commanded.at(when)
        return seen_by_both(self._all, measured, self._by_command, commanded, within)

    def _take(self, now: float, odometry: Odometry | None) -> str:
        """Store the odometry; returns what is wrong with it, or ""."""
        if odometry is None:
            return "there is no odometry"
        if not all(map(math.isfinite, (odometry.stamp, *odometry.pose, *odometry.twist))):
            return "the odometry is not a number"
        if odometry.stamp > now + AHEAD:
            return "the odometry comes from the future"
        history = self._measured
        if odometry.stamp < history.stamp:
            history.clear()
            self._frame = None
            for source in self._sources:
                source.forget()
        if odometry.stamp > history.stamp:
            # as compiled code is made for
            pose, twist = Pose(*map(float, odometry.pose)), Twist(*map(float, odometry.twist))
            time = odometry.stamp - history.stamp
            jump = len(history) > 0 and jumped(
                self._reported, (pose, twist), time, self._top, self._stopping, self._gap
            )
            reckoned = self._commanded.at(odometry.stamp)
            if jump:
                driven = compose(inverse(self._reckoned), reckoned)
                self._frame = compose(compose(history.pose, driven), inverse(pose))
            self._reported, self._reckoned = (pose, twist), reckoned
            here = pose if self._frame is None else compose(self._frame, pose)
            history.add(odometry.stamp, here, twist)
            if jump:
                return "the odometry jumped"
        age = now - history.stamp
        return f"the odometry is {1000.0 * age:.0f} ms old" if age > self._gap else ""

    def _reckon(self, now: float, applied: Twist) -> None:
        """Extend the poses predicted from the commands sent."""
        path = self._commanded
        effect = max(self._sent, now - self._robot.period) + self._robot.delay
        if not len(path):
            path.add(effect, Pose(0.0, 0.0, 0.0), applied)
        elif effect > path.stamp:
            path.add(effect, path.at(effect), applied)

    def _look(self, now: float, readings: Readings) -> str:
        """Take new scans; returns what is wrong with any, or ""."""
        looks = [
            source.look(now, readings, self._measured, self._commanded) for source in self._sources
        ]
        for source, (new, _) in zip(self._sources, looks, strict=True):
            for other in self._sources if new else ():
                if other is not source:
                    other.forget_passed(source)
        if any(new for new, _ in looks):
            spaces = [source.ground for source in self._sources if source.ground is not None]
            floors = [source.floor for source in self._sources if source.floor is not None]
            returns = all_of([source.by_odometry for source in self._sources])
            unknown = joined(unknown_to_all(spaces), unknown_to_all(floors))
            self._all = joined(returns, unknown)
            self._by_command = all_of([source.by_command for source in self._sources])
        return next((wrong for _, wrong in looks if wrong), "")

    def _stale(self, now: float) -> str:
        """What is wrong with the age of any LiDAR's newest scan, or ""."""
        return next((text for source in self._sources if (text := source.stale(now))), "")

    def _motions(self) -> tuple[Twist, Twist]:
        """The measured twists: the odometry's, and that of its poses."""
        return self._measured.twist, self._measured.mean_twist(INCREMENTS)

    def _braking(self, now: float, obstacles: MonitorSurroundings, met: Met) -> str:
        """Where the obstacle is that the robot meets if it brakes one period from now; empty if
        there is none. Motion no faster than a crawl does no harm.

        obstacles: in the body frame when that takes effect. The robot then moves as the last twist
        sent, and meets `met`; but a measured motion that no command explains goes on until then.
        """
        robot, history = self._robot, self._measured
        field = self._stop(met, self._commanded.twist, robot.period)
        if field.share < 1.0:
            return self._where(obstacles, field.point)
        reaction = max(now - history.stamp, 0.0) + robot.delay + robot.period
        for twist in self._motions():
            if self._unexplained(twist):
                here = seen_by(self._all, history.pose, math.inf)
                field = self._stop(self._met(here, twist), twist, reaction)
                if field.share < 1.0:
                    return self._where(here, field.point)
        return ""

    def _unexplained(self, twist: Twist) -> bool:
        """Whether a measured twist differs from all recent commands."""
        stamp = self._measured.stamp
        return all(
            fastest(Twist(twist.v - sent.v, twist.omega - sent.omega), self._shape) > CRAWL
            for sent in self._commanded.twists(stamp - LAG, stamp)
        )

    def _stop(self, met: Met, twist: Twist, reaction: float) -> MonitoredMotion:
        """The stop field of a motion that goes on for a reaction time [s]."""
        if fastest(twist, self._shape) <= CRAWL:
            return FREE
        return self._field(met, twist, reaction, 1.0)

    def _field(self, met: Met, twist: Twist, reaction: float, brakes: float) -> MonitoredMotion:
        """How much of a motion is allowed. brakes: share of the deceleration that is counted on.

        The stop field is the outline with the error of each return, and nothing may end in it;
        what is in it may be left. In the slow-down field, which has the margin, nothing is faster
        than a crawl.
        """
        braking = self._brakes(twist, brakes)
        crawl = min(CRAWL / fastest(twist, self._shape), 1.0)
        stop = allowed(met.solid, reaction, braking)
        slow = allowed(met.anything, reaction, braking, crawl)
        if stop < slow:
            return MonitoredMotion(stop, met.solid_point)
        return MonitoredMotion(slow, met.point)

    def _brakes(self, twist: Twist, brakes: float) -> float:
        """Braking time of a motion with a share of the deceleration [s]."""
        return change_time(twist, self._robot.bounds) / brakes

    def _met(self, obstacles: MonitorSurroundings, twist: Twist) -> Met:
        if twist == _NONE:
            return NEVER
        return met(obstacles, Twist(float(twist.v), float(twist.omega)), self._shape)

    def _where(self, obstacles: MonitorSurroundings, which: int) -> str:
        """Description of a point: kind, distance from the outline, and side."""
        shape, point = self._shape, obstacles.points[which]
        what = _WHAT.get(float(obstacles.errors[which]), "something")
        outside = shape.normals @ point - shape.offsets
        along = shape.normals[outside.argmax()]
        if abs(along[0]) >= abs(along[1]):
            side = "ahead" if along[0] > 0.0 else "behind"
        else:
            side = "to the left" if along[1] > 0.0 else "to the right"
        return f"{what} {max(float(outside.max()), 0.0):.2f} m {side}"

    def _worded(self, now: float, share: float, kind: str, because: str) -> Restriction:
        """A restriction with the text with which it began: else every period would be logged."""
        words, last = self._words.get(kind, ("", -math.inf))
        if not 0.0 <= now - last <= LASTS:
            words = f"collision monitor: {because}"
        self._words[kind] = words, now
        return Restriction(share, words)
