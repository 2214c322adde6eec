"""Raises the alarm that the robot may have been moved, and keeps what was seen before it.

Scans that contradict the keyframe from a moment ago raise it (`keyframe`), and a map that fits
much worse all at once does: along a corridor, scans before and after a push agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cohelm.core.frames import between, compose
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.keyframe import Keyframe, agreement, usable
from cohelm.robot.sensors import Lidar


@dataclass
class KidnapAlarm:
    """Of one robot; it asks no map."""

    lidar: Lidar
    caution: Caution

    def __post_init__(self) -> None:
        self._ranges: Floats  # of the newest scan
        self._there = Pose(0.0, 0.0, 0.0)  # the believed pose at the keyframe
        self._aged = 0  # scans since then
        self.reset()

    def reset(self) -> None:
        """A pose is believed anew: nothing that was seen before says anything."""
        self._keyframe: Keyframe | None = None
        self._older: tuple[Keyframe, Pose] | None = None  # the one before, and its pose
        self._witness: tuple[Keyframe, Pose] | None = None  # both as they were before the alarm
        self._left = 0  # scans for which the alarm lasts
        self._jolts = 0  # scans in a row that contradict the keyframe
        self.carried = 0.0  # how long nothing shows that the robot was not being moved [s]
        self._stamp = math.nan  # of the newest scan [s]
        self._fallen = 0  # scans in a row that are much less likely on the map than those before,
        self._level = -math.inf  # and the log likelihood of those

    @property
    def raised(self) -> bool:
        """Whether the robot may have been moved a moment ago."""
        return self._left > 0

    @property
    def shaken(self) -> bool:
        """Whether scans go on to contradict what was seen, or the map since all at once."""
        return self._jolts >= self.caution.settled or self._fallen >= self.caution.patience

    @property
    def jolted(self) -> bool:
        """Whether the newest scan contradicts what was seen."""
        return self._jolts > 0

    def compare(
        self, odometry: Pose, stamp: float, ranges: Floats, moved_by: Pose, pose: Pose, lost: bool
    ) -> None:  # fmt: skip
        """Ask whether this scan contradicts the keyframe; take a newer one where it does not.
        moved_by: since the scan before. pose: that was believed there."""
        self._ranges = ranges
        key, c = self._keyframe, self.caution
        step = between(key.odometry, odometry) if key else Pose(0.0, 0.0, 0.0)
        if key is not None:
            log = agreement(self.lidar, key.ranges, ranges, step)
            self._jolts = self._jolts + 1 if log < c.contradicted else 0
            if not self._left and self._jolts >= c.jolts:
                # where a lost robot is, nobody knows: what it saw there is no witness
                self._witness = None if lost else (key, self._there)
            elif not self._left and not lost:
                self._witness = None
            self._left = c.alarmed if self._jolts >= c.jolts else max(self._left - 1, 0)
        self._carry(stamp, lost)
        self._aged += 1
        near = math.hypot(step.x, step.y) < 0.3 and abs(step.psi) < 0.3
        gone = key is None or not near or self._aged > c.aged
        held = 0 < self._jolts < c.frozen
        if gone and not held and usable(self.lidar, ranges):
            self._older = (key, self._there) if key is not None else None
            self._keyframe = Keyframe(odometry, ranges)
            self._there = compose(pose, moved_by)
            self._jolts = self._aged = 0

    def _carry(self, stamp: float, lost: bool) -> None:
        """Whoever is carried sees scans that contradict each other, nothing, or has no scans."""
        gap = 0.0 if math.isnan(self._stamp) else stamp - self._stamp
        self._stamp = stamp
        if self._jolts or gap > self.caution.gap or not usable(self.lidar, self._ranges):
            self.carried += gap
        elif not self.raised and not lost:
            self.carried = 0.0

    def fall(self, log: float) -> None:
        """Scans that are much less likely on the map, all at once: a robot that was moved along a
        corridor sees no contradiction. What was seen before decides as after others. log: the
        newest scan's log likelihood at the tracked pose."""
        c = self.caution
        key = self._keyframe
        least = self._level - c.margin * (0.5 if self._level > c.odd else 2.0)
        self._fallen = self._fallen + 1 if log < least else 0
        if self._fallen > c.patience or self._level == -math.inf:
            self._level = log
        elif self._fallen == 0:
            self._level += 0.1 * (log - self._level)
        elif self._fallen == c.patience:
            if not self._left and key is not None:
                self._witness = (key, self._there) if self._aged > c.patience else self._older
            self._left = c.alarmed
            self.carried = math.inf  # it may have been pushed for long, along what looks alike

    def refuted(self, pose: Pose) -> bool:
        """Whether the newest scan contradicts what was seen before the alarm, at a pose; nobody
        knows where that is not known. What does not was not moved: it is the map that is wrong.
        """
        return self._witness is None or self.witnessed(pose) < self.caution.contradicted

    def witnessed(self, pose: Pose) -> float:
        """What was seen before the alarm says to the newest scan, had the robot been moved to this
        pose, as log likelihood: it stood there without the map, however poor that is."""
        if self._witness is None:
            return 0.0
        key, there = self._witness
        return agreement(self.lidar, key.ranges, self._ranges, between(there, pose))

    def gained(self, pose: Pose, here: Pose) -> float:
        """By how much likelier the newest scan is after what was seen before the alarm, had the
        robot been moved to this pose, than `here`, where it takes itself to be."""
        if not self.raised:
            return 0.0
        return self.witnessed(pose) - self.witnessed(here)
