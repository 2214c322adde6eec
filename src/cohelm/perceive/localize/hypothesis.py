"""Hypotheses of the robot's pose, and the pose at which it became lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.localization_map import Judgement
from cohelm.perceive.localize.map_errors import MapErrorCosts
from cohelm.perceive.match.odometry_covariance import predict


@dataclass
class Hypothesis:
    """A pose that the robot may have."""

    pose: Pose
    covariance: Floats
    """(3, 3)"""
    log: float
    """Log likelihood of all earlier scans, from separate views, weighted."""
    latest: float
    """Log likelihood of the newest scan."""
    judged: Judgement
    prior: float = 0.0
    """Log prior given the last known pose."""
    keyframe_log: float = 0.0
    """Log likelihood of the newest scan given the keyframe from before the alarm."""
    age: int = 0
    """Scans since it was judged."""
    stale: bool = False
    """Whether others have been judged in this view, and this one not yet."""
    led: bool = False
    """Whether it is the odometry prediction, matched with its covariance as prior."""
    charges: MapErrorCosts = field(default_factory=MapErrorCosts)
    """Map errors that it implies; at a cold start only."""

    @property
    def total(self) -> float:
        """Log posterior."""
        return self.log + self.latest + self.prior + self.keyframe_log

    @property
    def explained(self) -> float:
        """Number of beams that agree with the map."""
        return self.judged.agree * self.judged.beam_count


def same(a: Pose, b: Pose) -> bool:
    """Whether two poses are the same place."""
    return math.hypot(a.x - b.x, a.y - b.y) < 0.25 and abs(wrap(a.psi - b.psi)) < 0.2


class Departure(NamedTuple):
    """The pose at which the robot became lost, moved on by odometry since then.

    joint: covariance of it and of the odometry errors. odds: log odds that it was not moved; 0
    after contradicting scans. was_known: whether the pose was known.
    """

    pose: Pose
    joint: Floats
    odds: float
    was_known: bool

    def led_on(self, step: Pose) -> Departure:
        """The robot has moved by a step, by its odometry."""
        pose, joint = predict(self.pose, self.joint, step)
        return self._replace(pose=pose, joint=joint)

    def mahalanobis(self, hypothesis: Hypothesis) -> float:
        """Squared Mahalanobis distance of a hypothesis from this pose."""
        at, here = hypothesis.pose, self.pose
        off = np.array([at.x - here.x, at.y - here.y, wrap(at.psi - here.psi)])
        spread = self.joint[:3, :3] + hypothesis.covariance + np.diag([0.1, 0.1, 0.05]) ** 2
        return float(off @ np.linalg.solve(spread, off))

    def held(self, hypothesis: Hypothesis) -> bool:
        """Whether a hypothesis is consistent with this pose (3 sigma)."""
        return self.mahalanobis(hypothesis) < 9.0

    def stays(self, hypothesis: Hypothesis) -> bool:
        """Whether it is consistent, and no scan shows that the robot was moved."""
        return self.odds > 0.0 and self.held(hypothesis)

    def known(self, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis fused with this pose: along a wall, a match alone is uncertain."""
        if hypothesis.led:  # already matched with it as prior
            return hypothesis
        own, led, at, here = hypothesis.covariance, self.joint[:3, :3], hypothesis.pose, self.pose
        off = np.array([here.x - at.x, here.y - at.y, wrap(here.psi - at.psi)])
        gain = own @ np.linalg.inv(own + led)
        x, y, psi = (gain @ off).tolist()
        pose = Pose(at.x + x, at.y + y, at.psi + psi)
        return replace(hypothesis, pose=pose, covariance=own - gain @ own)

    def away(self, pose: Pose) -> float:
        """Distance of a pose from this one [m]."""
        return math.hypot(pose.x - self.pose.x, pose.y - self.pose.y)


def sigma(hypothesis: Hypothesis) -> float:
    """Standard deviation of a position, in the least certain direction [m]."""
    return math.sqrt(float(np.linalg.eigvalsh(hypothesis.covariance[:2, :2])[-1]))


def twin(hypothesis: Hypothesis, own: Hypothesis) -> bool:
    """Whether a hypothesis is a turned look-alike of the robot's own place, as the other end of a
    symmetric hall: it fits the newest scan no better. A robot that is carried and turned is
    unlikely to be put down exactly there. Along a corridor, where the position is uncertain, it is
    no twin."""
    turned = abs(wrap(hypothesis.pose.psi - own.pose.psi)) > 2.0 * PARAMS.turned
    # better by more than one unmapped object
    better = hypothesis.latest - own.latest > 0.5 * PARAMS.margin
    return turned and not better and sigma(hypothesis) < PARAMS.sure
