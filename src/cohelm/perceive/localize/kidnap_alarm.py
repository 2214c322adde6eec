"""Raises the alarm that the robot may have been moved (kidnapped), and keeps the keyframe before
it.

Scans that contradict the keyframe raise it (`keyframe`), and a sudden drop of the likelihood on the
map does: along a corridor, scans before and after a push agree.
"""

from __future__ import annotations

import math

from cohelm.core.frames import between, compose
from cohelm.core.types import Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.keyframe import agreement, usable
from cohelm.perceive.scan.deskew import DeskewedScan


class KidnapAlarm:
    """The alarm of one robot; it needs no map."""

    def __init__(self) -> None:
        self._newest: DeskewedScan
        self._keyframe_pose = Pose(0.0, 0.0, 0.0)  # the believed pose at the keyframe
        self._aged = 0  # scans since then
        self.reset()

    def reset(self) -> None:
        """A new pose is believed: forget all earlier scans."""
        self._keyframe: DeskewedScan | None = None
        self._older: tuple[DeskewedScan, Pose] | None = None  # the one before, and its pose
        # from before scans were odd on the map
        self._sound: tuple[DeskewedScan, Pose] | None = None
        self._odd = 0  # scans in a row that are odd on the map
        self._log = 0.0  # log likelihood on the map: of the newest scan,
        self._keyframe_log = self._sound_log = 0.0  # of the keyframe, and before scans were odd
        # both as they were before the alarm
        self._reference: tuple[DeskewedScan, Pose] | None = None
        self._left = 0  # scans for which the alarm lasts
        self._jolts = 0  # scans in a row that contradict the keyframe
        self.carried = 0.0  # how long nothing shows that the robot was not being moved [s]
        self._stamp = math.nan  # of the newest scan [s]
        self._unlikely = 0  # scans in a row that are much less likely on the map than those before,
        self._usual_log = -math.inf  # and the log likelihood of those

    @property
    def raised(self) -> bool:
        """Whether the robot may have been moved a moment ago."""
        return self._left > 0

    @property
    def persistent(self) -> bool:
        """Whether scans keep contradicting the keyframe, or the likelihood stays low."""
        return self._jolts >= PARAMS.settled or self._unlikely >= PARAMS.patience

    @property
    def contradicting(self) -> bool:
        """Whether the newest scan contradicts the keyframe."""
        return self._jolts > 0

    def compare(self, sweep: DeskewedScan, moved_by: Pose, pose: Pose, lost: bool) -> None:
        """Compare this scan with the keyframe, and replace that where they agree. moved_by:
        odometry step since the scan before. pose: believed pose at that scan."""
        self._newest = sweep
        key = self._keyframe
        step = between(key.pose, sweep.pose) if key else Pose(0.0, 0.0, 0.0)
        if key is not None:
            log = agreement(sweep.lidar, key.ranges, sweep.ranges, step)
            self._jolts = self._jolts + 1 if log < PARAMS.contradicted else 0
            if not self._left and self._jolts >= PARAMS.jolts:
                # the pose of a lost robot is unknown, so its keyframe is no reference
                self._reference = None if lost else self._before_the_fall(key)
            elif not self._left and not lost:
                self._reference = None
            self._left = PARAMS.alarmed if self._jolts >= PARAMS.jolts else max(self._left - 1, 0)
        self._update_carried(sweep, lost)
        self._aged += 1
        near = math.hypot(step.x, step.y) < 0.3 and abs(step.psi) < 0.3
        gone = key is None or not near or self._aged > PARAMS.aged
        held = 0 < self._jolts < PARAMS.frozen
        if gone and not held and usable(sweep):
            self._older = (key, self._keyframe_pose) if key is not None else None
            self._keyframe = sweep
            self._keyframe_pose = compose(pose, moved_by)
            self._jolts = self._aged = 0

    def _before_the_fall(self, key: DeskewedScan) -> tuple[DeskewedScan, Pose] | None:
        """The keyframe from before the alarm. Where scans became odd on the map before one
        contradicted the newest, and most of the fall was before that was taken, it shows where the
        robot was moved to: along a corridor, that contradicts nothing at first."""
        before, since = self._sound_log - self._keyframe_log, self._keyframe_log - self._log
        if self._odd >= self._jolts and before > since and self._sound is not None:
            return self._sound
        return key, self._keyframe_pose

    def _update_carried(self, sweep: DeskewedScan, lost: bool) -> None:
        """While carried, the robot has contradicting scans, empty ones, or none."""
        gap = 0.0 if math.isnan(self._stamp) else sweep.stamp - self._stamp
        self._stamp = sweep.stamp
        if self._jolts or gap > PARAMS.gap or not usable(sweep):
            self.carried += gap
        elif not self.raised and not lost:
            self.carried = 0.0

    def fall(self, log: float, odd: bool) -> None:
        """Raise the alarm for a sudden drop of the scan likelihood: a robot moved along a corridor
        has no contradicting scans. log: the newest scan's log likelihood at the tracked pose. odd:
        whether it is less likely than usual."""
        key = self._keyframe
        settled = self._older
        if key and self._aged > PARAMS.patience:
            settled = (key, self._keyframe_pose)
        self._odd = self._odd + 1 if odd else 0
        self._log = log
        if self._aged == 0:
            self._keyframe_log = log
        if not odd:
            self._sound, self._sound_log = settled, log
        least = self._usual_log - PARAMS.margin * (0.5 if self._usual_log > PARAMS.odd else 2.0)
        self._unlikely = self._unlikely + 1 if log < least else 0
        if self._unlikely > PARAMS.patience or self._usual_log == -math.inf:
            self._usual_log = log
        elif self._unlikely == 0:
            self._usual_log += 0.1 * (log - self._usual_log)
        elif self._unlikely == PARAMS.patience:
            if not self._left and key is not None:
                self._reference = settled
            self._left = PARAMS.alarmed
            self.carried = math.inf  # it may have been pushed far along a uniform corridor

    def refuted(self, pose: Pose) -> bool:
        """Whether the newest scan at a pose contradicts the keyframe before the alarm, or there is
        none. If not, the robot was not moved, and the map is wrong."""
        return self._reference is None or self.keyframe_log(pose) < PARAMS.contradicted

    def keyframe_log(self, pose: Pose) -> float:
        """Log likelihood of the newest scan at a pose given the keyframe before the alarm, without
        the map."""
        if self._reference is None:
            return 0.0
        key, there = self._reference
        return agreement(key.lidar, key.ranges, self._newest.ranges, between(there, pose))

    def gained(self, pose: Pose, here: Pose) -> float:
        """By how much likelier the newest scan is at a pose than `here`, at the believed one, given
        the keyframe before the alarm."""
        if not self.raised:
            return 0.0
        return self.keyframe_log(pose) - self.keyframe_log(here)
