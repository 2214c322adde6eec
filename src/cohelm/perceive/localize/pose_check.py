"""Decides whether a tracked pose is kept beside other places that fit, near by or on the map.

Without an alarm the map is taken to be wrong, not the pose: another place must fit much better, and
repeatedly. After an alarm, it must explain the keyframe from before as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.hypotheses import Hypotheses
from cohelm.perceive.localize.hypothesis import Hypothesis, same, twin
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.scan_judge import ScanJudge


@dataclass
class PoseCheck:
    """The check of one robot's pose."""

    judge: ScanJudge
    alarm: KidnapAlarm
    hypotheses: Hypotheses

    def __post_init__(self) -> None:
        self.on = False  # whether the search only checks a believed pose
        self.lead = PARAMS.unmoved  # log odds of the believed pose against others
        self._start = True  # whether it is the given start
        self.fitted = self._unheld = 0.0  # distances for which the map has fitted, and has not [m]
        self._persistent = False  # whether scans contradicted each other when the check began
        self._checked = 0.0  # log likelihood of the believed pose at the start of the check
        self._rivals = 0
        self._rival, self._rivalled = Pose(0.0, 0.0, 0.0), 0.0
        self._elsewhere = 0  # searches of the whole map that found the same better place,
        self._other: Pose | None = None  # that place, moved on by odometry

    def believed(self, lead: float, proven: bool) -> None:
        """A pose is believed. lead: its log odds against other places. proven: no other on the map
        comes near it."""
        self.lead, self._start = min(max(lead, 0.0), PARAMS.unmoved), False
        self.fitted, self._unheld = PARAMS.proven if proven else 0.0, 0.0
        self._rivals = self._elsewhere = 0
        self._other = None

    def led_on(self, step: Pose) -> None:
        """Apply an odometry step."""
        self._other = compose(self._other, step) if self._other else None

    def held(self, fits: bool, distance: float) -> None:
        """Record whether the newest scan fits the tracked pose. distance: since the scan before
        [m]."""
        self.fitted = self.fitted + distance if fits else self.fitted
        self._unheld = 0.0 if fits else self._unheld + distance

    def passed(self, distance: float) -> None:
        """The pose was kept for another scan. distance: since the scan before [m]."""
        self._rivalled += distance

    def begin(self, persistent: bool, likely: float) -> None:
        """Begin a check. likely: log likelihood of the pose by the newest scan."""
        self.on, self._persistent, self._checked = True, persistent, likely

    @property
    def long_unfitted(self) -> bool:
        """Whether the map has not fitted for so long that all of it has to be searched."""
        return self._unheld > PARAMS.unheld

    @property
    def was_known(self) -> bool:
        """Whether the pose was known: it has fitted for some distance, and the map recently."""
        return self.fitted >= PARAMS.proven and not self.long_unfitted

    @property
    def started(self) -> bool:
        """Whether the pose is still the given start, not yet confirmed."""
        return self._start and self.fitted < PARAMS.proven

    @property
    def may_have_moved(self) -> bool:
        """Whether the robot may have been moved, or its pose is not yet confirmed."""
        return self.alarm.raised or self.fitted < PARAMS.proven

    @property
    def log_odds(self) -> float:
        """Prior log odds of the believed pose: 0 after an alarm, and those with which it was
        believed until it has fitted for some distance."""
        if self.alarm.raised:
            return 0.0
        return PARAMS.unmoved if self.fitted >= PARAMS.proven else self.lead

    def given_up(self, pose: Pose, covariance: Floats, likely: float) -> bool:
        """Whether a pose is given up for what a check has found near by. covariance: (3, 3), its
        own. likely: its log likelihood by the newest scan."""
        found = self.hypotheses.all
        if (
            self.lead == 0.0
            and self.fitted < PARAMS.proven
            and self._ambiguous(pose, covariance, likely)
        ):
            return True

        def fits(h: Hypothesis) -> float:
            return h.latest + (self.alarm.gained(h.pose, pose) if self._persistent else 0.0)

        best = max(found, key=fits, default=None)
        if best is None or same(best.pose, pose):
            self._rivals = 0
            return False
        gained = self.alarm.gained(best.pose, pose)
        own = next((h for h in found if same(h.pose, pose)), None)
        lead = best.latest + gained - likely
        # one scan does not outweigh all that the pose was believed for; a start is only given
        better = lead > (PARAMS.margin if self.started else max(PARAMS.margin, self.log_odds))
        if own is not None and twin(best, own):  # may be walkers
            self._rivals = 0
            return False
        clearly = max(PARAMS.drop, self.log_odds)
        turned = abs(wrap(best.pose.psi - pose.psi)) > 2.0 * PARAMS.turned
        if turned and own is not None and self.judge.as_usual(own.judged):
            clearly = max(clearly, 0.5 * PARAMS.margin)  # the pose fits: may be walkers
        as_before = lead > clearly and self.judge.as_usual(best.judged)
        if self._persistent and lead > 0.5 * PARAMS.margin:
            as_before = self.judge.plausible(best.judged)
        # an alarm is no evidence for staying: what suffices without one suffices after it
        again = lead > PARAMS.margin and self._rivals_again(best, pose, likely)
        if not self.may_have_moved:
            return again
        if self.alarm.raised and not self._persistent and gained <= 0.0:
            # the keyframe does not speak for it. If it contradicts neither, being moved and not
            # are as likely as before, and one object decides, by the same scan for both
            usual = self.judge.as_usual(best.judged)
            by_one = best.latest - self._checked > 0.5 * PARAMS.margin
            better, as_before = False, gained == 0.0 and usual and by_one
        lost = better or as_before or again
        if lost:
            self.hypotheses.moved = as_before and not better
        return lost

    def _ambiguous(self, pose: Pose, covariance: Floats, likely: float) -> bool:
        """Whether only the set pose separates it from another place near by that its covariance
        does not reach: matches are certain of a place, not of which of two. A set pose has sigma
        `LocalizerParams.put`."""
        information = np.diag(np.array([PARAMS.put, PARAMS.put, 0.5 * PARAMS.put]) ** -2.0)

        def rivals(h: Hypothesis) -> bool:
            off = np.array([h.pose.x - pose.x, h.pose.y - pose.y, wrap(h.pose.psi - pose.psi)])
            apart = float(off @ np.linalg.solve(covariance + h.covariance, off)) > 9.0
            lead = h.latest - likely - 0.5 * float(off @ information @ off)
            return apart and self.judge.plausible(h.judged) and lead > -0.5 * PARAMS.margin

        return any(rivals(h) for h in self.hypotheses.all if not same(h.pose, pose))

    def given_up_on_the_map(self, pose: Pose) -> bool:
        """Whether the same place of the whole map has fitted better twice, after the pose has not
        fitted for a while.

        If no other place fits better, the map is wrong; so it is if it is another place each time,
        as the right one would have moved on with the odometry.
        """
        other = self._other
        better = [
            h for h in self.hypotheses.all
            if h.latest > self._checked + PARAMS.margin and not same(h.pose, pose)
        ]  # fmt: skip
        if other and any(same(h.pose, other) for h in better):
            self._elsewhere += 1
        else:
            self._elsewhere = 1 if better else 0
            self._other = max(better, key=lambda h: h.latest).pose if better else None
        if self._elsewhere >= PARAMS.elsewhere:
            return True
        self._unheld = PARAMS.unheld - 1.0 if self._elsewhere else 0.0
        return False

    def _rivals_again(self, best: Hypothesis, pose: Pose, likely: float) -> bool:
        """Whether the same other place has been better often enough and for long enough, though yet
        another may be better at times."""

        def off(other: Pose) -> float:
            seen = between(pose, other)
            return math.hypot(seen.x - self._rival.x, seen.y - self._rival.y)

        better = [h for h in self.hypotheses.all if h.latest > likely + PARAMS.margin]
        nearest = min(better, key=lambda h: off(h.pose), default=best)
        if self._rivals == 0 or off(nearest.pose) > 0.5:
            self._rivals, self._rivalled, nearest = 0, 0.0, best
        self._rival = between(pose, nearest.pose)
        self._rivals += 1
        return self._rivals >= PARAMS.rivals and self._rivalled >= PARAMS.rivalled
