"""A collision monitor: on the raw scan, it slows the robot and stops it before what it would hit.

It asks three ways how the robot moves, and takes the worst: as the odometry measures its twist, as
the odometry's poses change, and as it was sent. So a sense that lies about motion is not believed
alone. What it can not know is what the scan does not show.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.collision_monitor.fields import CRAWL, RESERVE, allowed, horizon
from cohelm.robot.collision_monitor.odometry import PoseHistory, seen_from
from cohelm.robot.collision_monitor.returns import Sensor, returns
from cohelm.robot.collision_monitor.runaway import Runaway
from cohelm.robot.collision_monitor.surroundings import (
    BESIDE,
    NOTHING,
    Surroundings,
    joined,
    of_scan,
    out_of_sight,
)  # fmt: skip
from cohelm.robot.collision_monitor.sweep import contact_times, fastest, leaving, outline
from cohelm.robot.gate.bounds import Bounds, needed
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.port import Odometry, Readings, Scan

AHEAD = 0.02
"""A stamp may be this far ahead of the clock [s]; more, and a clock has jumped."""
MISSED = 3.0
"""Scans that may be due and not there: two lost in a row are ordinary, three are not."""
INCREMENTS = 0.04
"""Motion is taken from poses so far apart [s]: two readings at 50 Hz, so that the steps of an
encoder do not make it jitter."""
LAG = 0.1
"""What the robot was sent within so long explains how it moves [s]: drives lag by some 50 ms, and
odometry is the mean over a reading and comes late."""
LASTS = 1.0
"""A reason is told in the same words until it has been away for so long [s]."""
_NONE = Twist(0.0, 0.0)


class Described(NamedTuple):
    """The robot, in plain numbers."""

    corners: Floats
    """Of its outline, convex, counter-clockwise, (k, 2), body frame [m]."""
    sensor: Sensor
    bounds: Bounds
    """By which the gate brakes it."""
    delay: float
    """From a command to the wheels [s]."""
    period: float
    """From one command to the next [s]."""


class Field(NamedTuple):
    """A motion, and what is in its way."""

    share: float
    """Of the motion, so much is allowed; may be above 1."""
    point: int
    """Which of the points allows the least; -1: none."""


class CollisionMonitor:
    """Watches one robot. See `robot.monitor.Monitor`."""

    def __init__(self, described: Described) -> None:
        self._robot, self._shape = described, outline(described.corners)
        sensor = described.sensor
        self._patience = MISSED / sensor.rate + sensor.sweep + sensor.latency
        bounds = described.bounds
        top = Twist(min(bounds.speed, bounds.wheel_speed), 0.0)
        spin = Twist(0.0, min(bounds.yaw_rate, 2.0 * bounds.wheel_speed / bounds.track))
        known = [needed(twist, bounds) for twist in (top, spin) if math.isfinite(sum(twist))]
        stopping = max(known, default=0.0)
        self._runaway = Runaway(described.delay + stopping)
        farthest = (top.v + spin.omega * self._shape.reach) * (stopping + described.delay)
        self._near = 2.0 * self._shape.reach + max(farthest, BESIDE)
        """Returns farther from the sensor than this can not matter [m]."""
        self._measured, self._commanded = PoseHistory(), PoseHistory()
        self._sent = -math.inf
        """When a twist was asked about, and so sent, last [s]."""
        self._scan: Scan | None = None
        self._by_odometry = NOTHING
        """Returns of the newest scan, in the frame of the odometry's poses, and remembered ones."""
        self._by_command = NOTHING
        """Those of the scan in the frame of the poses reckoned from what was sent."""
        self._wrong = ""
        """What is wrong with the readings; empty: nothing."""
        self._words: dict[str, tuple[str, float]] = {}
        """Of each kind of restriction: how it was told, and when last."""

    def observe(self, now: float, readings: Readings, applied: Twist) -> Restriction:
        """Take in odometry and scan; a fault where the robot moves and nobody wants it to."""
        self._reckon(now, applied)
        self._wrong = self._take(readings.odometry) or self._look(readings.scan)
        if not len(self._measured):
            return UNRESTRICTED
        speed = max(fastest(twist, self._shape) for twist in self._motions())
        if self._runaway.noticed(now, applied, speed):
            moves = f"the robot moves at {speed:.2f} m/s although it is told to stand"
            return Restriction(0.0, f"collision monitor: {moves}", fault=True)
        return UNRESTRICTED

    def restrict(self, now: float, twist: Twist) -> Restriction:
        """So much of a twist as the room ahead allows, and of what the robot does already."""
        self._sent = now
        if twist == _NONE or not math.isfinite(twist.v + twist.omega):
            return UNRESTRICTED  # nothing to take from; the gate knows what to do with no number
        wrong = self._wrong or self._stale(now)
        if wrong:
            return self._told(now, 0.0, "blind", wrong)
        effect = now + self._robot.delay
        things = joined(
            seen_by(self._by_odometry, self._measured.at(effect)),
            seen_by(self._by_command, self._commanded.at(effect)),
        )
        where = self._braking(now, things)
        if where:
            return self._told(now, 0.0, "stop", f"something {where} on the braking path")
        field = self._field(things, twist, self._robot.period, 1.0 - RESERVE)
        if field.share >= 1.0:
            return UNRESTRICTED
        where = self._where(things.points[field.point])
        if field.share > 0.0:
            return self._told(now, field.share, "slow", f"slower, something {where}")
        return self._told(now, 0.0, "stop", f"something {where} on the braking path")

    def _take(self, odometry: Odometry | None) -> str:
        """Remember where the robot says it is; what is wrong with that, or nothing."""
        if odometry is None:
            return "there is no odometry"
        if not all(map(math.isfinite, (odometry.stamp, *odometry.pose, *odometry.twist))):
            return "the odometry is no number"
        history = self._measured
        if odometry.stamp < history.stamp:
            history.clear()
            self._scan, self._by_odometry = None, NOTHING
        if odometry.stamp > history.stamp:
            history.add(odometry.stamp, odometry.pose, odometry.twist)
        return ""

    def _reckon(self, now: float, applied: Twist) -> None:
        """On with the poses that the robot has if it does what it is sent."""
        path = self._commanded
        effect = max(self._sent, now - self._robot.period) + self._robot.delay
        if not len(path):
            path.add(effect, Pose(0.0, 0.0, 0.0), applied)
        elif effect > path.stamp:
            path.add(effect, path.at(effect), applied)

    def _look(self, scan: Scan | None) -> str:
        """Take in a new scan; what is wrong with it, or nothing."""
        if scan is None:
            return "there is no scan"
        if scan is self._scan:
            return ""
        sensor = self._robot.sensor
        if len(scan.ranges) != len(sensor.bearings):
            return f"a scan of {len(scan.ranges)} beams, and not {len(sensor.bearings)}"
        if not math.isfinite(scan.stamp + scan.duration):
            return "the scan's time is no number"
        before = out_of_sight(
            self._by_odometry, scan.stamp, self._measured.at(scan.stamp), sensor, self._shape.reach
        )
        self._scan = scan
        found = returns(scan.ranges, sensor, self._near)
        self._by_odometry = joined(of_scan(found, scan, self._measured), before)
        self._by_command = of_scan(found, scan, self._commanded)
        return ""

    def _stale(self, now: float) -> str:
        """What is wrong with the newest scan's age, or nothing."""
        if self._scan is None:
            return "there is no scan"
        age = now - self._scan.stamp - self._scan.duration
        if age < -AHEAD:
            return "the scan comes from the future"
        if age > self._patience:
            return f"no scan for {1000.0 * age:.0f} ms"
        return ""

    def _motions(self) -> tuple[Twist, Twist]:
        """What the odometry's twist says, and what its poses say."""
        return self._measured.twist, self._measured.mean_twist(INCREMENTS)

    def _braking(self, now: float, things: Surroundings) -> str:
        """Where something is that the robot meets if it brakes one period from now; nothing where
        nothing is. What is no faster than a crawl can not do harm.

        things: seen from where the robot is when that takes effect. It moves then as it was sent
        last; but a measured motion that nothing explains that it was sent goes on until then.
        """
        robot, history = self._robot, self._measured
        field = self._stop(things, self._commanded.twist, robot.period)
        if field.share < 1.0:
            return self._where(things.points[field.point])
        here = seen_by(self._by_odometry, history.pose)
        reaction = max(now - history.stamp, 0.0) + robot.delay + robot.period
        for twist in self._motions():
            if self._unexplained(twist):
                field = self._stop(here, twist, reaction)
                if field.share < 1.0:
                    return self._where(here.points[field.point])
        return ""

    def _unexplained(self, twist: Twist) -> bool:
        """Whether a measured twist differs from all that the wheels were sent of late."""
        stamp = self._measured.stamp
        return all(
            fastest(Twist(twist.v - sent.v, twist.omega - sent.omega), self._shape) > CRAWL
            for sent in self._commanded.twists(stamp - LAG, stamp)
        )

    def _stop(self, things: Surroundings, twist: Twist, reaction: float) -> Field:
        """The stop field of a motion that goes on for a reaction time [s]."""
        if fastest(twist, self._shape) <= CRAWL:
            return Field(math.inf, -1)
        return self._field(things, twist, reaction, 1.0)

    def _field(self, things: Surroundings, twist: Twist, reaction: float, brakes: float) -> Field:
        """How much of a motion is allowed. brakes: share of the deceleration that is counted on.

        The stop field is the outline with the error of each return, and nothing may end in it;
        what is in it may be left. In the slow-down field, which has the margin, nothing is faster
        than a crawl.
        """
        speed = fastest(twist, self._shape)
        braking = needed(twist, self._robot.bounds) / brakes
        beyond = self._shape.reach + speed * horizon(reaction, braking)
        square = things.points[:, 0] ** 2 + things.points[:, 1] ** 2
        near = np.flatnonzero(square <= (beyond + things.margins) ** 2)
        if not len(near):
            return Field(math.inf, -1)
        points, errors, margins, _ = (column[near] for column in things)
        to_slow = contact_times(points, margins, twist, self._shape)
        met = np.flatnonzero(to_slow < math.inf)
        if not len(met):
            return Field(math.inf, -1)
        to_stop = contact_times(points[met], errors[met], twist, self._shape)
        to_stop[(to_stop == 0.0) & leaving(points[met], twist, self._shape)] = math.inf
        first, grazed = int(to_stop.argmin()), int(to_slow.argmin())
        stop = allowed(float(to_stop[first]), reaction, braking)
        slow = allowed(float(to_slow[grazed]), reaction, braking, min(CRAWL / speed, 1.0))
        return Field(stop, int(near[met[first]])) if stop < slow else Field(slow, int(near[grazed]))

    def _where(self, point: Floats) -> str:
        """In words: how far from the outline, and on which side."""
        shape = self._shape
        outside = shape.normals @ point - shape.offsets
        along = shape.normals[outside.argmax()]
        if abs(along[0]) >= abs(along[1]):
            side = "ahead" if along[0] > 0.0 else "behind"
        else:
            side = "left" if along[1] > 0.0 else "right"
        return f"{max(float(outside.max()), 0.0):.2f} m {side}"

    def _told(self, now: float, share: float, kind: str, because: str) -> Restriction:
        """A restriction, in the words in which it began: else every period would be a line."""
        words, last = self._words.get(kind, ("", -math.inf))
        if not now - last <= LASTS:
            words = f"collision monitor: {because}"
        self._words[kind] = words, now
        return Restriction(share, words)


def seen_by(things: Surroundings, pose: Pose) -> Surroundings:
    """In the body frame at a pose."""
    return things._replace(points=seen_from(things.points, pose))
