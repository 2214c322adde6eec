"""What was seen from the places before: one that is thought of only now must fit it as well."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from cohelm.core.frames import compose, inverse
from cohelm.core.types import Floats, Pose

NEAR = 0.15
"""What was seen from nearer by than this [m], or half of it in rad, says nothing more."""
_HERE = Pose(0.0, 0.0, 0.0)


class PastView(NamedTuple):
    """A scan from where the robot was, `back` from where it is now: points in the body frame then,
    the whole scan's ranges, and its time [s]."""

    back: Pose
    points: Floats
    ranges: Floats
    stamp: float


@dataclass
class LastMetres:
    """Views some way apart, for as long as the robot may be anywhere, the newest last."""

    apart: float
    most: int
    views: list[PastView] = field(default_factory=list[PastView])
    used: list[PastView] = field(default_factory=list[PastView])
    """Those by which a search goes, beside the view that it began with."""

    def led_on(self, step: Pose) -> None:
        """The robot has moved by a step, by its odometry."""
        turn = inverse(step)
        self.views = [view._replace(back=compose(turn, view.back)) for view in self.views]

    def add(self, points: Floats, ranges: Floats, stamp: float) -> None:
        """The newest view, if none is near."""
        last = self.views[-1].back if self.views else None
        if not (last and math.hypot(last.x, last.y) < self.apart and abs(last.psi) < self.apart):
            self.views.append(PastView(_HERE, points, ranges, stamp))
        self.views = self.views[-self.most :]

    def use(self) -> list[PastView]:
        """A search begins: it goes by those that say something of their own."""
        self.used = [
            view for view in self.views
            if math.hypot(view.back.x, view.back.y) + 0.5 * abs(view.back.psi) > NEAR
        ]  # fmt: skip
        return self.used

    def forget(self) -> None:
        """The robot knows where it is."""
        self.views, self.used = [], []


class _Past(NamedTuple):
    back: Pose
    ranges: Floats
    share: float


@dataclass
class SinceLost:
    """Scans since the robot is lost, from places some way apart, and what each says of its own."""

    most: int
    ranges: Floats
    """Of the scan before."""
    leg: Pose = _HERE
    """On from where the last was kept,"""
    way: float = 0.0
    turned: float = 0.0
    """as far as all are apart [m, rad];"""
    views: int = 0
    weight: float = 0.0
    """so many, and how many of them tell something of their own,"""
    share: float = 0.0
    """the last as much of it."""
    _kept: list[_Past] = field(default_factory=list[_Past])

    def led_on(self, step: Pose) -> float:
        """The robot has moved by a step. How far it is from where the last was kept [m]."""
        self.leg, back = compose(self.leg, step), inverse(step)
        self._kept = [one._replace(back=compose(back, one.back)) for one in self._kept]
        return self.off

    @property
    def off(self) -> float:
        """From where the last was kept, half of what it is turned counted as well [m]."""
        return math.hypot(self.leg.x, self.leg.y) + 0.5 * abs(self.leg.psi)

    def keep(self, step: Pose, share: float) -> None:
        """The scan before the newest step was another view. share: of it that is new."""
        self.share = share
        self._kept = [*self._kept, _Past(inverse(step), self.ranges, share)][-self.most :]
        self.views += 1
        self.weight += share

    def go_on(self) -> None:
        """The next view begins here."""
        self.way += math.hypot(self.leg.x, self.leg.y)
        self.turned += abs(self.leg.psi)
        self.leg = _HERE

    def likely(self, pose: Pose, log: Callable[[Pose, Floats], float]) -> float:
        """How likely all of them are, had the robot come to this pose. log: of one at a pose."""
        seen = [one.share * log(compose(pose, one.back), one.ranges) for one in self._kept]
        whole = sum(one.share for one in self._kept)
        return sum(seen) * self.weight / whole if seen else 0.0
