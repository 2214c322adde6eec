"""Earlier views, which a hypothesis that is found later must fit as well."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from cohelm.core.frames import compose, inverse
from cohelm.core.types import Floats, Pose

NEAR = 0.15
"""Views nearer to each other than this, half the angle [rad] added, are not independent [m]."""
_HERE = Pose(0.0, 0.0, 0.0)


class PastView(NamedTuple):
    """An earlier scan, whose body pose is `back` as seen from now: points in the body frame then,
    ranges of the whole scan, and its stamp [s]."""

    back: Pose
    points: Floats
    ranges: Floats
    stamp: float


@dataclass
class LastMetres:
    """Separate views during a cold start, the newest last."""

    apart: float
    most: int
    views: list[PastView] = field(default_factory=list[PastView])
    used: list[PastView] = field(default_factory=list[PastView])
    """Those used by a search, beside the view that it began with."""

    def led_on(self, step: Pose) -> None:
        """The robot has moved by a step, by its odometry."""
        turn = inverse(step)
        self.views = [view._replace(back=compose(turn, view.back)) for view in self.views]

    def add(self, points: Floats, ranges: Floats, stamp: float) -> None:
        """Add the newest view, if none is near."""
        last = self.views[-1].back if self.views else None
        if not (last and math.hypot(last.x, last.y) < self.apart and abs(last.psi) < self.apart):
            self.views.append(PastView(_HERE, points, ranges, stamp))
        self.views = self.views[-self.most :]

    def use(self) -> list[PastView]:
        """The independent views, for a search that begins."""
        self.used = [
            view for view in self.views
            if math.hypot(view.back.x, view.back.y) + 0.5 * abs(view.back.psi) > NEAR
        ]  # fmt: skip
        return self.used

    def forget(self) -> None:
        """The robot is localized."""
        self.views, self.used = [], []


class _Past(NamedTuple):
    back: Pose
    ranges: Floats
    share: float


@dataclass
class SinceLost:
    """Scans since the robot became lost, from separate places, with their weights."""

    most: int
    ranges: Floats
    """Of the scan before."""
    leg: Pose = _HERE
    """Step since the last one kept,"""
    way: float = 0.0
    turned: float = 0.0
    """distance and angle over all [m, rad];"""
    views: int = 0
    weight: float = 0.0
    """their number, and sum of their weights,"""
    share: float = 0.0
    """weight of the last."""
    _kept: list[_Past] = field(default_factory=list[_Past])

    def led_on(self, step: Pose) -> float:
        """Apply an odometry step. Returns the distance from the last one kept [m]."""
        self.leg, back = compose(self.leg, step), inverse(step)
        self._kept = [one._replace(back=compose(back, one.back)) for one in self._kept]
        return self.off

    @property
    def off(self) -> float:
        """Distance from the last one kept, half of the angle added [m]."""
        return math.hypot(self.leg.x, self.leg.y) + 0.5 * abs(self.leg.psi)

    def keep(self, step: Pose, share: float) -> None:
        """Keep the scan before the newest step. share: its weight."""
        self.share = share
        self._kept = [*self._kept, _Past(inverse(step), self.ranges, share)][-self.most :]
        self.views += 1
        self.weight += share

    def go_on(self) -> None:
        """Begin the next view here."""
        self.way += math.hypot(self.leg.x, self.leg.y)
        self.turned += abs(self.leg.psi)
        self.leg = _HERE

    def likely(self, pose: Pose, log: Callable[[Pose, Floats], float]) -> float:
        """Log likelihood of all of them for this pose now. log: of one at a pose."""
        seen = [one.share * log(compose(pose, one.back), one.ranges) for one in self._kept]
        whole = sum(one.share for one in self._kept)
        return sum(seen) * self.weight / whole if seen else 0.0
