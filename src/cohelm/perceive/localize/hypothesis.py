"""A place where the robot may be, and what is known of it; where the robot was when it got lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.localization_map import Judgement
from cohelm.perceive.localize.map_errors import Charges
from cohelm.perceive.match.odometry_covariance import moved


@dataclass
class Hypothesis:
    """A place where the robot may be."""

    pose: Pose
    covariance: Floats
    """(3, 3)"""
    log: float
    """Likelihood of all scans before, from places some way apart, weighed."""
    latest: float
    """And of the newest."""
    judged: Judgement
    prior: float = 0.0
    """What where the robot was says to it."""
    witnessed: float = 0.0
    """And what was seen before scans began to contradict each other."""
    age: int = 0
    """Scans since it was judged."""
    stale: bool = False
    """Whether it has not been judged from here, where others have."""
    led: bool = False
    """Whether it is where odometry leads, matched as that is known."""
    charges: Charges = field(default_factory=Charges)
    """What the map would have wrong; for a robot that may be anywhere."""

    @property
    def total(self) -> float:
        """Likelihood of all scans, and of its having come there."""
        return self.log + self.latest + self.prior + self.witnessed

    @property
    def explained(self) -> float:
        """Beams of the scan that end where the map lets them, as many as it tells about."""
        return self.judged.agree * self.judged.told


def same(a: Pose, b: Pose) -> bool:
    """Whether two hypotheses are one place."""
    return math.hypot(a.x - b.x, a.y - b.y) < 0.25 and abs(wrap(a.psi - b.psi)) < 0.2


class Departure(NamedTuple):
    """Where a robot left off when it became lost, led on by odometry since then.

    joint: covariance of that and of what the wheels get wrong. odds: log odds that it is still
    there; none where scans contradicted each other. knew: whether it knew that place.
    """

    pose: Pose
    joint: Floats
    odds: float
    knew: bool

    def led_on(self, step: Pose) -> Departure:
        """The robot has moved by a step, by its odometry."""
        pose, joint = moved(self.pose, self.joint, step)
        return self._replace(pose=pose, joint=joint)

    def strayed(self, one: Hypothesis) -> float:
        """How far a place is from where the robot would be had nobody moved it, as squared
        sigmas."""
        at, here = one.pose, self.pose
        off = np.array([at.x - here.x, at.y - here.y, wrap(at.psi - here.psi)])
        spread = self.joint[:3, :3] + one.covariance + np.diag([0.1, 0.1, 0.05]) ** 2
        return float(off @ np.linalg.solve(spread, off))

    def held(self, one: Hypothesis) -> bool:
        """Whether a place is where the robot would be had nobody moved it."""
        return self.strayed(one) < 9.0

    def stays(self, one: Hypothesis) -> bool:
        """Whether it is such a place, and no scan shows that somebody moved it."""
        return self.odds > 0.0 and self.held(one)

    def known(self, one: Hypothesis) -> Hypothesis:
        """A place where the robot left off, as well as its match and odometry tell it together:
        along a wall, a match tells nothing."""
        if one.led:  # it was matched so
            return one
        own, led, at, here = one.covariance, self.joint[:3, :3], one.pose, self.pose
        off = np.array([here.x - at.x, here.y - at.y, wrap(here.psi - at.psi)])
        gain = own @ np.linalg.inv(own + led)
        x, y, psi = (gain @ off).tolist()
        pose = Pose(at.x + x, at.y + y, at.psi + psi)
        return replace(one, pose=pose, covariance=own - gain @ own)

    def away(self, pose: Pose) -> float:
        """How far off a place is [m]."""
        return math.hypot(pose.x - self.pose.x, pose.y - self.pose.y)


def sigma(one: Hypothesis) -> float:
    """Standard deviation of a place, in the direction that is least known [m]."""
    return math.sqrt(float(np.linalg.eigvalsh(one.covariance[:2, :2])[-1]))


def twin(one: Hypothesis, own: Hypothesis, caution: Caution) -> bool:
    """Whether a place is turned from where the robot was, and looks no more like the newest scan
    than that does, as the other end of a hall. Who carries a robot and turns it round puts it down
    just there by a chance of a few centimetres and degrees among metres; not where a place is not
    one, but all along a corridor."""
    turned = abs(wrap(one.pose.psi - own.pose.psi)) > 2.0 * caution.turned
    better = one.latest - own.latest > 0.5 * caution.margin  # than by one thing that the map lacks
    return turned and not better and sigma(one) < caution.sure
