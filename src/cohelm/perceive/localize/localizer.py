"""Localizes the robot on a map by scan matching; detects being lost, and recovers.

*Tracking*: odometry foretells, matching corrects, and the whole scan is judged against the map.
What the wheels measure wrongly is estimated on the way (`match.odometry_covariance`): along a
corridor without features that error alone would add up.
*Lost*, when scans disagree with the map: it is looked for on all of it (`hypotheses`). The alarm
that it may have been moved is raised without the map (`kidnap_alarm`), and whether a pose stands
up to other places that fit is decided in `pose_check`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.hypotheses import Hypotheses
from cohelm.perceive.localize.hypothesis import Departure
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.localize.pose_check import PoseCheck
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.match.odometry_covariance import (
    UNKNOWN,
    Wheels,
    inverted,
    joined,
    moved,
    updated,
)
from cohelm.perceive.match.scan_matching import align, independent
from cohelm.perceive.match.surfaces import facing, normals
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar


class Localization(NamedTuple):
    """pose: of the body in the map at the sweep's instant. covariance: (3, 3). share: of beams
    that agree with the map. reason: why it is lost, empty if it is not."""

    pose: Pose
    covariance: Floats
    share: float
    lost: bool
    reason: str


@dataclass
class Localizer:
    """Follows one robot on one map. `start` None: it may be anywhere."""

    known: LocalizationMap
    lidar: Lidar
    start: Pose | None = None
    caution: Caution = field(default_factory=Caution)

    def __post_init__(self) -> None:
        c = self.caution
        self._judge = ScanJudge(self.known, self.lidar, c)
        self._alarm = KidnapAlarm(self.lidar, c)
        self._hypotheses = Hypotheses(
            self.known, self.lidar, c, self._judge, self._alarm, self.start is None
        )
        self._check = PoseCheck(c, self._judge, self._alarm, self._hypotheses)
        self._odometry: Pose | None = None
        self._told = self.start is not None  # whether somebody has just said where it is
        self._doubts = 0  # scans in a row that do not fit,
        self._odd = 0  # and that are less likely than usual
        self._likely = 0.0  # log likelihood of the believed pose
        pose = self.start or Pose(0.0, 0.0, 0.0)
        lost = self.start is None
        wide = np.diag([0.1, 0.1, 0.05]) ** 2 if self.start else np.diag([1e3, 1e3, 10.0])
        reason = "looking for the robot on the map" if lost else ""
        self._wheels = Wheels()
        self._joint: Floats = joined(wide, UNKNOWN)
        self._told_joint: Floats = self._joint  # of what errs independently only: what is told
        self.located = Localization(pose, wide, 0.0, lost, reason)

    def place(self, pose: Pose, sigma: float = 0.3) -> None:
        """Somebody says where the robot is, within about sigma [m].

        It is believed, and checked at once against the places near by. Where the LiDAR contradicts
        it, what was believed before needs no proof but to fit.
        """
        wide = np.diag([sigma, sigma, 0.5 * sigma]) ** 2
        before, usual = None, self._judge.usual
        if not self.located.lost:
            before = Departure(self.located.pose, self._joint, 0.0, self._check.knew)
        self._forget()
        self._odometry = None
        self._believe(pose, wide, 0.0, 0.0)
        self._hypotheses.before, self._judge.usual, self._told = before, usual, True

    def correct(self, sweep: DeskewedScan, odometry: Pose, stamp: float) -> Localization:
        """Take in a sweep. odometry: the odometry pose at its instant, `stamp` [s]."""
        step = between(self._odometry, odometry) if self._odometry else Pose(0.0, 0.0, 0.0)
        self._odometry = odometry
        step = self._wheels.corrected(step)
        self._hypotheses.led_on(step)
        self._check.led_on(step)
        points, across = normals(sweep.points, sweep.beams, self.lidar.step)
        every = max(1, -(-len(points) // self.caution.points))
        # contiguous whatever `every` is: other strides are another function to compile
        points = np.ascontiguousarray(points[::every])
        mount = self.lidar.mount
        across = facing(points, np.ascontiguousarray(across[::every]), mount.x, mount.y)
        self._hypotheses.look_back(step, sweep, stamp)
        self._alarm.compare(
            odometry, stamp, sweep.ranges, step, self.located.pose, self.located.lost
        )
        self._hypotheses.compared()
        if self.located.lost:
            self._follow(step, sweep, points, across)
        else:
            self._track(step, sweep, points, across)
        return self.located

    def think(self) -> Localization:
        """Use a moment for the search, where one is going on; about 3 ms."""
        if self._hypotheses.think(self.located.lost):
            self._settle()
            if self.located.lost:
                self._hypotheses.widen()
        return self.located

    def _track(self, step: Pose, sweep: DeskewedScan, points: Floats, across: Floats) -> None:
        """Foretell with the odometry, correct by matching, and see whether the whole scan fits."""
        check, care = self._check, self._judge.care
        foretold, joint = moved(self.located.pose, self._joint, step)
        _, told = moved(self.located.pose, self._told_joint, step)
        self._hypotheses.carried(step, joint)
        spread = joint[:3, :3]
        prior = inverted(spread)
        fit = align(self.known.surfaces, points, across, foretold, prior, care)
        judged = self._judge.judge(fit.pose, sweep.ranges)
        c, way = self.caution, math.hypot(step.x, step.y)
        movable = check.movable
        fits = self._judge.fits(judged, self._alarm.raised)
        if movable and not fits:
            loose = np.diag([4.0, 4.0, 16.0])
            wider = care._replace(reach=0.6)
            other = align(self.known.surfaces, points, across, foretold, loose, wider)
            again = self._judge.judge(other.pose, sweep.ranges)
            if again.log > judged.log + 1.0 and self._judge.fair(again, c.good):
                fit, judged = other, again
                fits = self._judge.fits(again, self._alarm.raised)
        check.held(fits, way)
        astray = check.astray
        doubtful = astray and not self._judge.fair(judged, c.poor)
        if movable and not fits:
            doubtful = check.fitting < c.proven or self._alarm.refuted(fit.pose)
        self._doubts = self._doubts + 1 if not fits and doubtful else 0
        innovation = np.array([
            fit.pose.x - foretold.x, fit.pose.y - foretold.y, wrap(fit.pose.psi - foretold.psi),
        ])  # fmt: skip
        own = independent(self.known.surfaces, points, across, fit.pose, care, fit.rms)
        off = innovation @ own @ np.linalg.solve(np.eye(3) + told[:3, :3] @ own, innovation)
        # moved from where it was, or put elsewhere than was said: the place that fits is one of
        # those that may
        jumped = movable and off > c.refused
        if jumped and check.started:
            told = self._loosened(told)
        if self._doubts >= c.patience or jumped:
            self._forget()
            self._hypotheses.everywhere = False
            why = "what the LiDAR sees is not what the map shows here"
            self._hypotheses.left = Departure(foretold, told, check.trust, check.knew)
            self._joint = self._told_joint = joint
            self.located = Localization(foretold, told[:3, :3].copy(), judged.agree, True, why)
            self._seek(points, across, sweep)
            if jumped:
                self._hypotheses.add(fit.pose)
            return
        if not movable and off > c.refused:
            self._joint, self._told_joint = joint, told
            self.located = Localization(foretold, told[:3, :3].copy(), judged.agree, False, "")
        else:
            self._wheels = self._wheels.learnt(joint, innovation)
            self._judge.learn_surfaces(fit, way)
            self._joint = updated(joint, fit.information)
            new = 1.0 if self._told else min(1.0, max(way / care.correlated, 0.02))
            self._told_joint = updated(told, new * own)
            self.located = Localization(
                fit.pose, self._told_joint[:3, :3].copy(), judged.agree, False, ""
            )
        self._alarm.fall(judged.log)
        odd = self._judge.learn(judged, movable)
        self._likely = self._judge.weighed(judged)
        self._odd = self._odd + 1 if odd else 0
        check.passed(way)
        due = self._odd >= c.patience and self._odd % c.pause == c.patience
        shaken = self._alarm.shaken
        if (due or self._told or astray or shaken) and not self._hypotheses.searching:
            self._hypotheses.everywhere = astray
            check.begin(shaken, self._likely)
            self._seek(points, across, sweep)
            self._told = self._told and not self._hypotheses.searching

    def _follow(self, step: Pose, sweep: DeskewedScan, points: Floats, across: Floats) -> None:
        """Lost: lead on by odometry, and see which of the places that were found still hold."""
        pose, self._joint = moved(self.located.pose, self._joint, step)
        self.located = self.located._replace(pose=pose, covariance=self._joint[:3, :3].copy())
        self._hypotheses.follow(step, sweep, points, across, self._joint)
        if self._hypotheses.answered:
            self._settle()
        if self.located.lost and self._hypotheses.tired:
            self._seek(points, across, sweep)

    def _seek(self, points: Floats, across: Floats, sweep: DeskewedScan) -> None:
        """Begin a search with a sweep, where it tells enough."""
        if len(points) < 20:
            if self.located.lost:
                self.located = self.located._replace(reason="the LiDAR sees too little")
            self._check.on = False
            return
        self._hypotheses.seek(points, across, sweep, self.located.pose, self._joint)

    def _settle(self) -> None:
        """Drop what is refuted; believe one if no other is near it; else go on, or look again."""
        kept = self._hypotheses.ranked()
        if self._check.on and self._holds():
            return
        best, lead, proven, why = self._hypotheses.verdict(kept)
        if best is None:
            self.located = self.located._replace(lost=True, reason=why)
        elif why:
            self.located = Localization(best.pose, best.covariance, best.judged.agree, True, why)
        else:
            self._forget()
            self._believe(best.pose, best.covariance, best.judged.agree, lead, proven)

    def _holds(self) -> bool:
        """Whether the believed pose stands up to what a check of it has found; that ends it."""
        check, pose = self._check, self.located.pose
        check.on = False
        if self._hypotheses.everywhere:
            left = given_up = check.given_up_on_the_map(pose)
        else:
            given_up = check.given_up(pose, self.located.covariance, self._likely)
            left = given_up and check.movable
        if left:
            joint = self._loosened(self._told_joint) if check.started else self._told_joint
            odds = check.lead if check.started else 0.0
            self._hypotheses.left = Departure(pose, joint, odds, check.knew)
        if not given_up:
            self._hypotheses.drop()
        return not given_up

    def _loosened(self, joint: Floats) -> Floats:
        """The covariance of a start that was told, where it does not look so (`Caution.put`)."""
        put = self.caution.put
        wide = np.diag([put, put, 0.5 * put]) ** 2
        return joined(joint[:3, :3] + wide, joint[3:, 3:])

    def _believe(
        self, pose: Pose, covariance: Floats, share: float, lead: float, proven: bool = False
    ) -> None:
        """Track from here on. lead: by which it was likelier than any other place. proven: nothing
        else on the map comes near it."""
        self._joint = joined(covariance, self._joint[3:, 3:])
        self._told_joint = self._joint
        self._alarm.reset()
        self._hypotheses.believed()
        self._check.believed(lead, proven)
        self.located = Localization(pose, covariance, share, False, "")

    def _forget(self) -> None:
        self._hypotheses.forget()
        self._judge.usual = -math.inf
        self._doubts, self._odd, self._check.on, self._told = 0, 0, False, False
