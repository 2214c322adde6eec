"""Earlier views, which a hypothesis that is found later must fit as well."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from cohelm.core.frames import compose, inverse
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import NO_SWEEP, DeskewedScan

NEAR = 0.15
"""Views nearer to each other than this, half the angle [rad] added, are not independent [m]."""
_HERE = Pose(0.0, 0.0, 0.0)


def travel(step: Pose) -> float:
    """How far a step leads to another view: distance, half of the angle added [m]."""
    return math.hypot(step.x, step.y) + 0.5 * abs(step.psi)


class PastView(NamedTuple):
    """An earlier scan, whose body pose is `back` as seen from now, and its weight."""

    back: Pose
    sweep: DeskewedScan
    share: float = 1.0


def _led_on(views: list[PastView], step: Pose) -> list[PastView]:
    """As seen from where the robot is after a step, by its odometry."""
    back = inverse(step)
    return [view._replace(back=compose(back, view.back)) for view in views]


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
        self.views = _led_on(self.views, step)

    def add(self, sweep: DeskewedScan) -> None:
        """Add the newest view, if none is near."""
        last = self.views[-1].back if self.views else None
        if not (last and math.hypot(last.x, last.y) < self.apart and abs(last.psi) < self.apart):
            self.views.append(PastView(_HERE, sweep))
        self.views = self.views[-self.most :]

    def use(self) -> list[PastView]:
        """The independent views, for a search that begins."""
        self.used = [view for view in self.views if travel(view.back) > NEAR]
        return self.used

    def forget(self) -> None:
        """The robot is localized."""
        self.views, self.used = [], []


@dataclass
class SinceLost:
    """Scans since the robot became lost, from separate places, with their weights."""

    most: int
    before: DeskewedScan = NO_SWEEP
    """The newest scan before this one."""
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
    _kept: list[PastView] = field(default_factory=list[PastView])

    def led_on(self, step: Pose) -> float:
        """Apply an odometry step. Returns the distance from the last one kept [m]."""
        self.leg, self._kept = compose(self.leg, step), _led_on(self._kept, step)
        return self.off

    @property
    def off(self) -> float:
        """`travel` since the last one kept [m]."""
        return travel(self.leg)

    @property
    def all_travel(self) -> float:
        """`travel` over all [m]."""
        return self.way + 0.5 * self.turned + self.off

    def keep(self, step: Pose, share: float) -> None:
        """Keep the scan before the newest step. share: its weight."""
        self.share = share
        self._kept = [*self._kept, PastView(inverse(step), self.before, share)][-self.most :]
        self.views += 1
        self.weight += share

    def go_on(self) -> None:
        """Begin the next view here."""
        self.way += math.hypot(self.leg.x, self.leg.y)
        self.turned += abs(self.leg.psi)
        self.leg = _HERE

    def likely(self, pose: Pose, log: Callable[[Pose, Floats], float]) -> float:
        """Log likelihood of all of them for this pose now. log: of one at a pose."""
        seen = [one.share * log(compose(pose, one.back), one.sweep.ranges) for one in self._kept]
        whole = sum(one.share for one in self._kept)
        return sum(seen) * self.weight / whole if seen else 0.0
