"""Decides whether a tracked pose stands up to other places that fit: near by, or on all the map.

Without an alarm the map is taken to be wrong, not the pose: another place must fit much better,
again and again. After one, it must explain what was seen before as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.hypotheses import Hypotheses
from cohelm.perceive.localize.hypothesis import Hypothesis, same, twin
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.scan_judge import ScanJudge


@dataclass
class PoseCheck:
    """Of the pose of one robot."""

    caution: Caution
    judge: ScanJudge
    alarm: KidnapAlarm
    hypotheses: Hypotheses

    def __post_init__(self) -> None:
        self.on = False  # whether the search only checks a pose that is believed
        self.lead = self.caution.unmoved  # by which the believed pose was likelier than others
        self._start = True  # whether it is the start that was told
        self.fitting = self._unheld = 0.0  # ways since when the map has fitted, and has not [m]
        self._shaken = False  # whether scans contradicted each other when it began to be checked
        self._checked = 0.0  # log likelihood of the believed pose by the scan it is checked with
        self._rivals = 0
        self._rival, self._rivalled = Pose(0.0, 0.0, 0.0), 0.0
        self._elsewhere = 0  # searches of the whole map that found the same better place,
        self._other: Pose | None = None  # where the robot would be by now, had it been there

    def believed(self, lead: float, proven: bool) -> None:
        """A pose is believed. lead: by which it was likelier than any other place. proven: nothing
        else on the map comes near it."""
        self.lead, self._start = min(max(lead, 0.0), self.caution.unmoved), False
        self.fitting, self._unheld = self.caution.proven if proven else 0.0, 0.0
        self._rivals = self._elsewhere = 0
        self._other = None

    def led_on(self, step: Pose) -> None:
        """The robot has moved by a step, by its odometry."""
        self._other = compose(self._other, step) if self._other else None

    def held(self, fits: bool, way: float) -> None:
        """Whether the newest scan fits the tracked pose. way: since the scan before [m]."""
        self.fitting = self.fitting + way if fits else self.fitting
        self._unheld = 0.0 if fits else self._unheld + way

    def passed(self, way: float) -> None:
        """The pose was kept for another scan. way: since the scan before [m]."""
        self._rivalled += way

    def begin(self, shaken: bool, likely: float) -> None:
        """A search begins that checks the pose. likely: its log likelihood by the newest scan."""
        self.on, self._shaken, self._checked = True, shaken, likely

    @property
    def astray(self) -> bool:
        """Whether the map has not fitted for so long that all of it is to be searched."""
        return self._unheld > self.caution.unheld

    @property
    def knew(self) -> bool:
        """Whether the robot has shown that it knows its place, and the map has fitted lately."""
        return self.fitting >= self.caution.proven and not self.astray

    @property
    def started(self) -> bool:
        """Whether all that is known is the start that was told: it has not been held to it yet."""
        return self._start and self.fitting < self.caution.proven

    @property
    def movable(self) -> bool:
        """Whether the robot may have been moved, or has not yet shown that it knows its place."""
        return self.alarm.raised or self.fitting < self.caution.proven

    @property
    def trust(self) -> float:
        """Log odds that the robot is where it believes to be: none where scans contradict each
        other, and what it was believed for until it has fitted for some way."""
        c = self.caution
        return 0.0 if self.alarm.raised else c.unmoved if self.fitting >= c.proven else self.lead

    def given_up(self, pose: Pose, covariance: Floats, likely: float) -> bool:
        """Whether a pose does not stand up to what a check of it has found near by. covariance:
        (3, 3), its own. likely: its log likelihood by the newest scan."""
        c, found = self.caution, self.hypotheses.all
        if self.lead == 0.0 and self.fitting < c.proven and self._beside(pose, covariance, likely):
            return True

        def fits(h: Hypothesis) -> float:
            return h.latest + (self.alarm.gained(h.pose, pose) if self._shaken else 0.0)

        best = max(found, key=fits, default=None)
        if best is None or same(best.pose, pose):
            self._rivals = 0
            return False
        gained = self.alarm.gained(best.pose, pose)
        own = next((h for h in found if same(h.pose, pose)), None)
        lead = best.latest + gained - likely
        # one scan does not outweigh all that the pose was believed for; a start was only told
        better = lead > (c.margin if self.started else max(c.margin, self.trust))
        if own is not None and twin(best, own, c):  # it may be who walks about
            self._rivals = 0
            return False
        clearly = max(c.drop, self.trust)
        turned = abs(wrap(best.pose.psi - pose.psi)) > 2.0 * c.turned
        if turned and own is not None and self.judge.as_usual(own.judged):
            clearly = max(clearly, 0.5 * c.margin)  # it fits: it may be who walks about
        as_before = lead > clearly and self.judge.as_usual(best.judged)
        if self._shaken and lead > 0.5 * c.margin:
            as_before = self.judge.plausible(best.judged)
        if not self.movable:
            return lead > c.margin and self._rivals_again(best, pose, likely)
        lost = (gained > 0.0 or self._shaken or not self.alarm.raised) and (better or as_before)
        if lost:
            self.hypotheses.moved = as_before and not better
        return lost

    def _beside(self, pose: Pose, covariance: Floats, likely: float) -> bool:
        """Whether nothing but what somebody said tells a pose from another one near by, to which
        its covariance does not reach: matches make it sure of a place, not of which of two it is.
        What is said is as good as `Caution.put`."""
        c = self.caution
        told = np.diag(np.array([c.put, c.put, 0.5 * c.put]) ** -2.0)

        def rivals(h: Hypothesis) -> bool:
            off = np.array([h.pose.x - pose.x, h.pose.y - pose.y, wrap(h.pose.psi - pose.psi)])
            apart = float(off @ np.linalg.solve(covariance + h.covariance, off)) > 9.0
            lead = h.latest - likely - 0.5 * float(off @ told @ off)
            return apart and self.judge.plausible(h.judged) and lead > -0.5 * c.margin

        return any(rivals(h) for h in self.hypotheses.all if not same(h.pose, pose))

    def given_up_on_the_map(self, pose: Pose) -> bool:
        """Whether the same place of the whole map has fitted better twice, now that a pose has not
        for a while.

        Where the map is as wrong everywhere else, it is the map that is wrong; and where another
        place fits better each time, too: the robot would have gone on with the right one.
        """
        c, other = self.caution, self._other
        better = [
            h for h in self.hypotheses.all
            if h.latest > self._checked + c.margin and not same(h.pose, pose)
        ]  # fmt: skip
        if other and any(same(h.pose, other) for h in better):
            self._elsewhere += 1
        else:
            self._elsewhere = 1 if better else 0
            self._other = max(better, key=lambda h: h.latest).pose if better else None
        if self._elsewhere >= c.elsewhere:
            return True
        self._unheld = c.unheld - 1.0 if self._elsewhere else 0.0
        return False

    def _rivals_again(self, best: Hypothesis, pose: Pose, likely: float) -> bool:
        """Whether another place has been found better often enough, and for long enough: the same
        one, though now and then yet another may be better than that."""
        c = self.caution

        def off(other: Pose) -> float:
            seen = between(pose, other)
            return math.hypot(seen.x - self._rival.x, seen.y - self._rival.y)

        better = [h for h in self.hypotheses.all if h.latest > likely + c.margin]
        nearest = min(better, key=lambda h: off(h.pose), default=best)
        if self._rivals == 0 or off(nearest.pose) > 0.5:
            self._rivals, self._rivalled, nearest = 0, 0.0, best
        self._rival = between(pose, nearest.pose)
        self._rivals += 1
        return self._rivals >= c.rivals and self._rivalled >= c.rivalled
