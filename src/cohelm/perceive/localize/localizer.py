"""Localizes the robot on a map by scan matching; detects being lost, and recovers.

*Tracking*: odometry predicts, scan matching corrects, and the whole scan is judged against the map.
The odometry scale is estimated too (`match.odometry_covariance`), since its error would accumulate
along a featureless corridor. *Lost*, when scans disagree with the map: the pose is searched for on
all of it (`hypotheses`). `kidnap_alarm` detects without the map that the robot may have been moved,
and `pose_check` decides whether a pose is kept beside other places that fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.hypotheses import Hypotheses
from cohelm.perceive.localize.hypothesis import Departure
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.localize.past_views import travel
from cohelm.perceive.localize.pose_check import PoseCheck
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.match.odometry_covariance import (
    UNKNOWN,
    OdometryErrors,
    inverted,
    joined,
    predict,
    updated,
)
from cohelm.perceive.match.scan_matching import align, independent
from cohelm.perceive.match.surfaces import FlatPoints, flat_points
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar


class Localization(NamedTuple):
    """pose: of the body in the map at the sweep's stamp. covariance: (3, 3). share: of the beams
    that agree with the map. reason: why it is lost, empty if it is not."""

    pose: Pose
    covariance: Floats
    share: float
    lost: bool
    reason: str


@dataclass
class Localizer:
    """Localizes one robot on one map. `start` None: its pose is searched for."""

    known: LocalizationMap
    lidar: Lidar
    start: Pose | None = None

    def __post_init__(self) -> None:
        self._judge = ScanJudge(self.known, self.lidar)
        self._alarm = KidnapAlarm()
        self._hypotheses = Hypotheses(self.known, self._judge, self._alarm, self.start is None)
        self._check = PoseCheck(self._judge, self._alarm, self._hypotheses)
        self._odometry: Pose | None = None
        self._pose_set = self.start is not None  # whether the pose has just been set
        self._doubts = 0  # scans in a row that do not fit,
        self._odd = 0  # and that are less likely than usual
        self._log_likelihood = 0.0  # of the believed pose
        self._trust = PARAMS.trust  # way that the map explained, less what it did not [m]
        pose = self.start or Pose(0.0, 0.0, 0.0)
        lost = self.start is None
        wide = np.diag([0.1, 0.1, 0.05]) ** 2 if self.start else np.diag([1e3, 1e3, 10.0])
        reason = "looking for the robot on the map" if lost else ""
        self._wheels = OdometryErrors()
        self._joint: Floats = joined(wide, UNKNOWN)
        self._reported_joint: Floats = self._joint  # of independent errors only: reported
        self.located = Localization(pose, wide, 0.0, lost, reason)

    def place(self, pose: Pose, sigma: float = 0.3) -> None:
        """Set the pose, as a person does, within about sigma [m].

        It is believed, and checked at once against the places near by. If the LiDAR contradicts
        it, the earlier pose only has to fit.
        """
        wide = np.diag([sigma, sigma, 0.5 * sigma]) ** 2
        before, usual = None, self._judge.usual
        if not self.located.lost:
            before = Departure(self.located.pose, self._joint, 0.0, self._check.was_known)
        self._trust = max(self._trust, PARAMS.trust)
        self._reset_search()
        self._odometry = None
        self._accept(pose, wide, 0.0, 0.0)
        self._hypotheses.before, self._judge.usual, self._pose_set = before, usual, True

    def correct(self, sweep: DeskewedScan) -> Localization:
        """Process a sweep."""
        step = between(self._odometry, sweep.pose) if self._odometry else Pose(0.0, 0.0, 0.0)
        self._odometry = sweep.pose
        step = self._wheels.corrected(step)
        self._hypotheses.led_on(step)
        self._check.led_on(step)
        flat = flat_points(sweep.points, sweep.beams, self.lidar)
        every = max(1, -(-len(flat.points) // PARAMS.points))
        # contiguous: other strides would compile another specialization
        flat = FlatPoints(*(np.ascontiguousarray(part[::every]) for part in flat))
        self._hypotheses.keep_view(step, sweep)
        self._alarm.compare(sweep, step, self.located.pose, self.located.lost)
        self._hypotheses.alarm_updated()
        if self.located.lost:
            self._relocalize(step, sweep, flat)
        else:
            self._track(step, sweep, flat)
        return self.located

    def search_step(self) -> Localization:
        """One slice of the search, if any; about 3 ms."""
        if self._hypotheses.search_step(self.located.lost):
            self._decide()
            if self.located.lost:
                self._hypotheses.widen()
        return self.located

    def _track(self, step: Pose, sweep: DeskewedScan, flat: FlatPoints) -> None:
        """Predict by odometry, correct by matching, and check whether the whole scan fits."""
        check, match_params = self._check, self._judge.match_params
        predicted, joint = predict(self.located.pose, self._joint, step)
        _, reported = predict(self.located.pose, self._reported_joint, step)
        self._hypotheses.carried(step, joint)
        spread = joint[:3, :3]
        prior = inverted(spread)
        fit = align(self.known.surfaces, flat, predicted, prior, match_params)
        judged = self._judge.judge(fit.pose, sweep.ranges)
        distance = math.hypot(step.x, step.y)
        may_have_moved = check.may_have_moved
        fits, pushed = self._judge.fits(judged, self._alarm.raised), False
        weak_prior = np.diag([4.0, 4.0, 16.0])
        if may_have_moved and not fits:
            wider = match_params._replace(reach=0.6)
            wider_fit = align(self.known.surfaces, flat, predicted, weak_prior, wider)
            wider_judged = self._judge.judge(wider_fit.pose, sweep.ranges)
            if wider_judged.log > judged.log + 1.0 and self._judge.fair(wider_judged, PARAMS.good):
                fit, judged, pushed = wider_fit, wider_judged, True
                fits = self._judge.fits(wider_judged, self._alarm.raised)
        check.held(fits, distance)
        trust = self._trust + (distance if fits else -distance)
        self._trust = min(max(trust, -PARAMS.most_trust), PARAMS.most_trust)
        long_unfitted = check.long_unfitted
        doubtful = long_unfitted and not self._judge.fair(judged, PARAMS.poor)
        if may_have_moved and not fits:
            doubtful = check.fitted < PARAMS.proven or self._alarm.refuted(fit.pose)
        self._doubts = self._doubts + 1 if not fits and doubtful else 0
        innovation = np.array([
            fit.pose.x - predicted.x, fit.pose.y - predicted.y, wrap(fit.pose.psi - predicted.psi),
        ])  # fmt: skip
        information = independent(self.known.surfaces, flat, fit.pose, match_params, fit.rms)
        both = np.eye(3) + reported[:3, :3] @ information
        off = innovation @ information @ np.linalg.solve(both, innovation)
        # moved, or started elsewhere than stated: the place that fits is one candidate
        jumped = may_have_moved and off > PARAMS.refused
        if jumped and check.started:
            reported = self._widened(reported)
        if self._doubts >= PARAMS.patience or jumped:
            self._reset_search()
            self._hypotheses.whole_map = False
            why = "what the LiDAR sees is not what the map shows here"
            self._hypotheses.left = Departure(predicted, reported, check.log_odds, check.was_known)
            self._joint = self._reported_joint = joint
            self.located = Localization(predicted, reported[:3, :3].copy(), judged.agree, True, why)
            self._begin_search(flat, sweep)
            if jumped:
                self._hypotheses.add(fit.pose)
            return
        if not may_have_moved and off > PARAMS.refused:
            self._joint, self._reported_joint = joint, reported
            self.located = Localization(predicted, reported[:3, :3].copy(), judged.agree, False, "")
        else:
            if pushed:  # the wheels do not know of it, and the prediction does not limit it
                joint = reported = joined(inverted(weak_prior), joint[3:, 3:])
            else:
                self._wheels = self._wheels.updated_by(joint, innovation)
            self._judge.learn_surfaces(fit, distance)
            self._joint = updated(joint, fit.information)
            afresh = self._pose_set or pushed
            new = 1.0 if afresh else min(1.0, max(distance / match_params.correlated, 0.02))
            self._reported_joint = updated(reported, new * information)
            self.located = Localization(
                fit.pose, self._reported_joint[:3, :3].copy(), judged.agree, False, ""
            )
        odd = self._judge.learn(judged, may_have_moved)
        self._alarm.fall(judged.log, odd)
        self._log_likelihood = self._judge.weighed(judged)
        self._odd = self._odd + 1 if odd else 0
        check.passed(distance)
        due = self._odd >= PARAMS.patience and self._odd % PARAMS.pause == PARAMS.patience
        persistent = self._alarm.persistent
        due = due or self._pose_set or long_unfitted or persistent
        if due and not self._hypotheses.searching:
            self._hypotheses.whole_map = long_unfitted
            check.begin(persistent, self._log_likelihood)
            self._begin_search(flat, sweep)
            self._pose_set = self._pose_set and not self._hypotheses.searching

    def _relocalize(self, step: Pose, sweep: DeskewedScan, flat: FlatPoints) -> None:
        """Lost: predict by odometry, and update the hypotheses."""
        pose, self._joint = predict(self.located.pose, self._joint, step)
        self.located = self.located._replace(pose=pose, covariance=self._joint[:3, :3].copy())
        self._hypotheses.follow(step, sweep, flat, self._joint)
        self._trust -= travel(step)  # unless a place is found that has held for some of it
        if self._hypotheses.has_results:
            self._decide()
        if self.located.lost and self._hypotheses.search_due:
            self._begin_search(flat, sweep)

    def _begin_search(self, flat: FlatPoints, sweep: DeskewedScan) -> None:
        """Begin a search with a sweep, if it has enough points."""
        if len(flat.points) < 20:
            if self.located.lost:
                self.located = self.located._replace(reason="the LiDAR sees too little")
            self._check.on = False
            return
        self._hypotheses.begin_search(flat, sweep, self.located.pose, self._joint)

    def _decide(self) -> None:
        """Drop refuted hypotheses; believe one if no other comes near it; else continue."""
        kept = self._hypotheses.ranked()
        if self._check.on and self._pose_holds():
            return
        trust = self._trust + 2.0 * self._hypotheses.held  # if what has held is right
        best, lead, proven, why = self._hypotheses.verdict(kept, -trust)
        if best is None:
            self.located = self.located._replace(lost=True, reason=why)
        elif why:
            self.located = Localization(best.pose, best.covariance, best.judged.agree, True, why)
        else:
            self._trust = min(trust, PARAMS.most_trust)
            self._reset_search()
            self._accept(best.pose, best.covariance, best.judged.agree, lead, proven)

    def _pose_holds(self) -> bool:
        """Whether the believed pose is kept after a check, which ends."""
        check, pose = self._check, self.located.pose
        check.on = False
        if self._hypotheses.whole_map:
            left = given_up = check.given_up_on_the_map(pose)
        else:
            given_up = check.given_up(pose, self.located.covariance, self._log_likelihood)
            left = given_up and check.may_have_moved
        if left:
            joint = self._widened(self._reported_joint) if check.started else self._reported_joint
            odds = check.lead if check.started else 0.0
            self._hypotheses.left = Departure(pose, joint, odds, check.was_known)
        if not given_up:
            self._hypotheses.drop()
        return not given_up

    def _widened(self, joint: Floats) -> Floats:
        """The covariance of a start pose that does not fit (`LocalizerParams.put`)."""
        put = PARAMS.put
        wide = np.diag([put, put, 0.5 * put]) ** 2
        return joined(joint[:3, :3] + wide, joint[3:, 3:])

    def _accept(
        self, pose: Pose, covariance: Floats, share: float, lead: float, proven: bool = False
    ) -> None:
        """Track from this pose on. lead: its log odds against other places. proven: no other on the
        map comes near it."""
        self._joint = joined(covariance, self._joint[3:, 3:])
        self._reported_joint = self._joint
        self._alarm.reset()
        self._hypotheses.believed()
        self._check.believed(lead, proven)
        self.located = Localization(pose, covariance, share, False, "")

    def _reset_search(self) -> None:
        self._hypotheses.forget()
        self._judge.usual = -math.inf
        self._doubts, self._odd, self._check.on, self._pose_set = 0, 0, False, False
