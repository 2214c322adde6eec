"""Says whether the likeliest of some places can be believed, and if not, why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from cohelm.core.types import Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.hypothesis import Departure, Hypothesis, same, sigma
from cohelm.perceive.localize.scan_judge import ScanJudge


class Circumstances(NamedTuple):
    """Under which places are followed.

    cold: the robot may be anywhere. whole: all of the map was searched. complete: no place that
    fits as well was left out. everywhere: it is the whole map that is searched now. moved: a check
    has found a place that fits as it used to. views: from so many places some way apart these were
    judged; driven: these are some way apart. left: where the robot was. before: where it believed
    to be until somebody said where it is.
    """

    cold: bool
    whole: bool
    complete: bool
    everywhere: bool
    moved: bool
    views: int
    driven: bool
    left: Departure | None
    before: Pose | None

    @property
    def odds(self) -> float:
        """Log odds that the robot is where it left off."""
        return self.left.odds if self.left else 0.0


class PlaceVerdict(NamedTuple):
    """best: the likeliest place, None where none fits. lead: by which it is likelier than the
    next. proven: nothing else on the map comes near it. why: it is not believed; empty if it is."""

    best: Hypothesis | None
    lead: float
    proven: bool
    why: str


@dataclass
class Belief:
    """Of one robot; it remembers for how long a place has led."""

    caution: Caution
    judge: ScanJudge
    beams: int

    def __post_init__(self) -> None:
        self._leading: Hypothesis | None = None  # the likeliest
        self._led = 0  # scans in which it led well

    def forget(self) -> None:
        """Nothing leads."""
        self._led = 0

    def verdict(self, kept: list[Hypothesis], about: Circumstances) -> PlaceVerdict:
        """Whether the best of those that are ranked can be believed."""
        c, fair = self.caution, self.judge.fair
        kept = rivals(kept, about.left)
        best = kept[0] if kept else None
        unsure = about.cold or not about.whole
        if best is None or not fair(best.judged, c.fair if unsure else c.poor):
            return PlaceVerdict(
                None, 0.0, False, "no place on the map looks like what the LiDAR sees"
            )
        lead = _lead(best, kept[1:] if about.cold else kept[1:2])
        back = _nearest(kept, about.before) if about.before else None
        if back is not None and best.total - back.total < c.margin:
            led = _lead(back, [h for h in kept if h is not back])
            best, lead, wanted = back, math.inf, 0.0  # that needs no proof, and is none
        else:
            led, wanted = lead, self._wanted(best, lead, about)
        far = self._far(best.pose, about)
        # the map may be wrong here, where all of it has been searched and nothing comes near
        only = about.whole and not far and lead >= 2.0 * c.margin
        # or nobody moved it, and nothing that was found elsewhere makes up for that; to one that
        # stands no scan tells more
        steady = lead >= c.margin or (lead >= wanted and self._led >= c.steady)
        stayed = steady and self._stays(best, about)
        if about.left and about.left.stays(best):
            best = about.left.known(best)
        if about.cold and self._disputed(kept):
            lead = led = 0.0
        why = ""
        if lead < wanted or (far and (about.views < c.views or not about.complete)):
            some = f"{len(kept)}" if about.complete else "many"
            why = f"{some} places on the map look alike: drive on a little"
            if about.moved:
                why = "the robot was moved, or something new stands here"
            elif lead >= wanted and about.complete:
                why = "one view is not enough to be sure: drive on a little"
        elif not self._explains(best, lead, far, stayed, only or (stayed and about.whole), about):
            why = "too much of what the LiDAR sees is not on the map"
        elif best is not back and sigma(best) > c.sure:
            why = "too few features are in view to say where along them"
        return PlaceVerdict(best, led, only or stayed, why)

    def _explains(
        self, best: Hypothesis, lead: float, far: bool, stayed: bool, poor: bool,
        about: Circumstances,
    ) -> bool:  # fmt: skip
        """Whether a place explains enough of the scan. poor: the map may be wrong there."""
        c, judged = self.caution, best.judged
        strange = far or about.odds > 0.0
        return (
            self.judge.fair(judged, c.poor if poor else c.good)
            and judged.agree >= (c.whole if far else c.poor if poor else c.seen)
            and (judged.log >= c.least or stayed or (not strange and lead >= 3.0 * c.margin))
            and (judged.told >= 0.5 * self.beams or stayed)
            # a map may lack a wall, and people hide some; nobody shows what is behind two
            and (judged.passed < 2 or not about.cold)
        )

    def _disputed(self, kept: list[Hypothesis]) -> bool:
        """Whether what was seen speaks for the first, and what is seen now for another: one piece
        of wall that the map lacks there may have told them apart."""
        now = [self.judge.weighed(h.judged) for h in kept]
        return max(now) > now[0] + 0.5 * self.caution.margin

    def _stays(self, one: Hypothesis, about: Circumstances) -> bool:
        """Whether it is where the robot left off, and that can be: no scan has contradicted another
        since it knew that place, or none of it but a thing, and then the whole map was searched."""
        left, c = about.left, self.caution
        if left is None or not left.held(one):
            return False
        if left.stays(one):
            return True
        alike = one.judged.agree >= c.seen and one.witnessed > 2.0 * c.contradicted
        return left.knew and about.whole and alike

    def _far(self, pose: Pose, about: Circumstances) -> bool:
        """Whether the robot can hardly have been moved there: then nothing else speaks for it."""
        if about.cold:
            return True
        near = [p for p in (about.left.pose if about.left else None, about.before) if p]
        reach = self.caution.near + 0.5
        return bool(near) and all(math.hypot(p.x - pose.x, p.y - pose.y) > reach for p in near)

    def _wanted(self, best: Hypothesis, lead: float, about: Circumstances) -> float:
        """The lead in log likelihood that makes the best hypothesis believed."""
        c = self.caution
        half = 0.5 * c.margin
        self._led = (self._led + 1 if best is self._leading else 1) if lead >= half else 0
        self._leading = best
        if about.moved:
            return half if self._led >= c.settled else math.inf
        if about.cold:
            return c.certain
        enough = about.driven or self._led >= c.steady or not about.everywhere
        return half if enough else c.margin


def rivals(kept: list[Hypothesis], left: Departure | None) -> list[Hypothesis]:
    """Of those that are ranked, without any elsewhere that explains less of the scan than the place
    where the robot left off, while no scan shows that it was moved: where the map knows little,
    little speaks against a place. And without any that its match and odometry together take to
    where they take the likeliest of those where it left off."""
    own = next((h for h in kept if left is not None and left.stays(h)), None)
    if left is None or own is None:
        return kept
    at = left.known(own).pose

    def another(h: Hypothesis) -> bool:
        if left.held(h):
            return not same(left.known(h).pose, at)
        return h.explained >= own.explained

    return [h for h in kept if h is own or another(h)]


def _nearest(kept: list[Hypothesis], pose: Pose) -> Hypothesis | None:
    """The one that is a place, if any is; along a corridor there may be two that nearly are."""

    def off(h: Hypothesis) -> float:
        return math.hypot(h.pose.x - pose.x, h.pose.y - pose.y)

    return min((h for h in kept if same(h.pose, pose)), key=off, default=None)


def _lead(best: Hypothesis, others: list[Hypothesis]) -> float:
    """Log odds of a place against others together: of many, one fits as well by chance."""
    odds = sum(math.exp(min(h.total - best.total, 0.0)) for h in others)
    return -math.log(odds) if odds > 0.0 else math.inf
