"""Pose history, by odometry or by the commands sent; and motion on an arc."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from cohelm.core.types import Floats, Pose, Twist

KEPT = 1.5
"""Length of the history, at least [s]; older times get the oldest pose."""
GAP = 0.25
"""After so long without odometry the gate brakes, if it does not let readings be older [s]: its
watchdog runs out. From then on nobody knows where the robot is."""
_JUMP = 0.15  # tolerance of a step beyond what the robot's speed explains [m, rad]
_TOP = 50.0  # no robot is faster [m/s, rad/s]


def advanced(pose: Pose, twist: Twist, time: float) -> Pose:
    """The pose after holding a twist for a time [s], exactly on its arc."""
    turned, way = twist.omega * time, twist.v * time
    half = 0.5 * turned
    chord = way * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
    course = pose.psi + half
    return Pose(
        pose.x + chord * math.cos(course), pose.y + chord * math.sin(course), pose.psi + turned
    )


def between(before: Pose, after: Pose, time: float) -> Twist:
    """The twist that leads from one pose to the other in a time [s]; sideways motion counts as way.

    Positive if the robot drove forward, negative if backward.
    """
    dx, dy = after.x - before.x, after.y - before.y
    turned = after.psi - before.psi
    course = before.psi + 0.5 * turned
    ahead = dx * math.cos(course) + dy * math.sin(course)
    return Twist(math.copysign(math.hypot(dx, dy), ahead) / time, turned / time)


def jumped(
    before: tuple[Pose, Twist], after: tuple[Pose, Twist], time: float, top: Twist,
    stopping: float, gap: float,
) -> bool:  # fmt: skip
    """Whether no motion at up to half above the largest speeds leads from one reading to the other
    in a time [s]; or after a gap it begins at exactly its origin.

    stopping: from a command to stand until the robot does, from the largest speeds [s]. gap:
    without odometry for so long the gate brakes [s].
    """
    way = math.hypot(after[0].x - before[0].x, after[0].y - before[0].y)
    turn = abs(math.remainder(after[0].psi - before[0].psi, 2.0 * math.pi))
    far, angle = (
        1.5 * _farthest(abs(one), abs(other), min(most, _TOP), stopping, time, gap) + _JUMP
        for one, other, most in zip(before[1], after[1], top, strict=True)
    )
    anew = time > gap and after[0].x == after[0].y == 0.0 and way > 0.0
    return way > far or turn > angle or anew


def _farthest(
    before: float, after: float, top: float, stopping: float, time: float, gap: float
) -> float:
    """How far a robot moves at most between two readings with these speeds. After a gap without
    odometry the gate had stopped it, unless it still moved at its end."""
    if time <= gap:
        return top * time
    gained = top * min(gap / max(stopping, gap), 1.0)
    began, held = min(max(before, after) + gained, top), min(before, after)
    return min(began * (gap + 0.5 * stopping) + held * (time - gap), top * time)


def placed(points: Floats, x: Floats, y: Floats, psi: Floats) -> Floats:
    """Points of the body frame at poses, one each or one for all, in the frame of the poses."""
    c, s = np.cos(psi), np.sin(psi)
    there = np.empty_like(points)
    there[:, 0] = x + c * points[:, 0] - s * points[:, 1]
    there[:, 1] = y + s * points[:, 0] + c * points[:, 1]
    return there


def placed_at(x: float, y: float, pose: Pose) -> tuple[float, float]:
    """One point of the body frame at a pose, in the frame of the pose."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    return pose.x + c * x - s * y, pose.y + s * x + c * y


def seen_from(points: Floats, pose: Pose) -> Floats:
    """Points of a pose's frame, in the body frame there."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    return (points - (pose.x, pose.y)) @ np.array(((c, -s), (s, c)))


class PoseHistory:
    """Poses at increasing times, each with the twist from then on. Linear in between; after
    the last one it goes on with its twist."""

    def __init__(self, kept: float = KEPT) -> None:
        """kept: its length [s]."""
        self._kept = kept
        self._stamps: list[float] = []
        self._poses: list[Pose] = []
        self._twists: list[Twist] = []

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def stamp(self) -> float:
        """Time of the last pose [s]; -inf before the first."""
        return self._stamps[-1] if self._stamps else -math.inf

    @property
    def pose(self) -> Pose:
        """The last one. There must be one."""
        return self._poses[-1]

    @property
    def twist(self) -> Twist:
        """The twist from the last pose on; zero before the first."""
        return self._twists[-1] if self._twists else Twist(0.0, 0.0)

    def add(self, stamp: float, pose: Pose, twist: Twist) -> None:
        """Append a pose later than the last one; its heading is unwrapped."""
        if self._poses:
            before = self._poses[-1].psi
            pose = pose._replace(psi=before + math.remainder(pose.psi - before, 2.0 * math.pi))
        self._stamps.append(stamp)
        self._poses.append(pose)
        self._twists.append(twist)
        while self._stamps[0] < stamp - self._kept:
            del self._stamps[0], self._poses[0], self._twists[0]

    def clear(self) -> None:
        """Forget all of it."""
        self._stamps.clear()
        self._poses.clear()
        self._twists.clear()

    def at(self, stamp: float) -> Pose:
        """The pose at a time, past or predicted. There must be a pose."""
        if stamp >= self.stamp:
            return advanced(self.pose, self.twist, stamp - self.stamp)
        i = bisect_right(self._stamps, stamp)
        if i == 0:
            return self._poses[0]
        before, after = self._poses[i - 1], self._poses[i]
        share = (stamp - self._stamps[i - 1]) / (self._stamps[i] - self._stamps[i - 1])
        return Pose(*(a + share * (b - a) for a, b in zip(before, after, strict=True)))

    def during(self, stamps: Floats) -> tuple[Floats, Floats, Floats]:
        """x, y and heading at times in any order, at least one, (n,) each. There must be a pose."""
        first, last = float(stamps.min()), float(stamps.max())
        inner = slice(bisect_right(self._stamps, first), bisect_left(self._stamps, last))
        known = np.array([first, *self._stamps[inner], last])
        rows = np.array([self.at(first), *self._poses[inner], self.at(last)])
        x, y, psi = (np.interp(stamps, known, rows[:, i]) for i in range(3))
        return x, y, psi

    def twists(self, since: float, until: float) -> list[Twist]:
        """All twists held from one time to another [s], including the one at the beginning."""
        first = max(bisect_right(self._stamps, since) - 1, 0)
        return self._twists[first : bisect_right(self._stamps, until)]

    def mean_twist(self, over: float) -> Twist:
        """From the poses alone: between the last one and one at least `over` earlier [s].

        Zero where there is none.
        """
        for stamp, pose in zip(reversed(self._stamps), reversed(self._poses), strict=True):
            if self.stamp - stamp >= over:
                return between(pose, self.pose, self.stamp - stamp)
        return Twist(0.0, 0.0)
