"""Decides whether the likeliest hypothesis can be believed, and if not, why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from cohelm.core.types import Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.hypothesis import Departure, Hypothesis, same, sigma
from cohelm.perceive.localize.scan_judge import ScanJudge


class SearchContext(NamedTuple):
    """State of the search.

    cold: without a start pose. whole: all of the map was searched. complete: no place that fits as
    well was left out. everywhere: the whole map is being searched. moved: a check has found a place
    that fits as the pose did before. vain: way by which what the map has not explained, up to now,
    outweighs what it has, if the likeliest place is right [m]. views: number of separate views;
    driven: these are far enough apart. left: the pose at which it became lost. before: the pose
    believed before one was set.
    """

    cold: bool
    whole: bool
    complete: bool
    everywhere: bool
    moved: bool
    vain: float
    views: int
    driven: bool
    left: Departure | None
    before: Pose | None

    @property
    def odds(self) -> float:
        """Log odds that the robot was not moved."""
        return self.left.odds if self.left else 0.0


class PlaceVerdict(NamedTuple):
    """best: the likeliest hypothesis, None where none fits. lead: its log odds against the others.
    proven: no other on the map comes near it. why: it is not believed; empty if it is."""

    best: Hypothesis | None
    lead: float
    proven: bool
    why: str


@dataclass
class Belief:
    """Decides for one robot; remembers for how long a hypothesis has led."""

    judge: ScanJudge

    def __post_init__(self) -> None:
        self._leading: Hypothesis | None = None  # the likeliest
        self._led = 0  # scans in which it led well

    def forget(self) -> None:
        """No hypothesis leads."""
        self._led = 0

    def verdict(self, kept: list[Hypothesis], context: SearchContext) -> PlaceVerdict:
        """Whether the best of the ranked hypotheses can be believed."""
        fair = self.judge.fair
        kept = rivals(kept, context.left)
        best = kept[0] if kept else None
        unsure = context.cold or not context.whole
        if best is None or not fair(best.judged, PARAMS.fair if unsure else PARAMS.poor):
            return PlaceVerdict(
                None, 0.0, False, "no place on the map looks like what the LiDAR sees"
            )
        lead = _lead(best, kept[1:] if context.cold else kept[1:2])
        back = _nearest(kept, context.before) if context.before else None
        if back is not None and best.total - back.total < PARAMS.margin:
            led = _lead(back, [h for h in kept if h is not back])
            best, lead, required = back, math.inf, 0.0  # it needs no proof, and gives none
        else:
            led, required = lead, self._required_lead(best, lead, context)
        far = self._far(best.pose, context)
        # the map may be wrong here, where all of it has been searched and nothing comes near
        only = context.whole and not far and lead >= 2.0 * PARAMS.margin
        # or the robot was not moved, and nothing found elsewhere outweighs that; a standing robot
        # gains nothing from more scans
        steady = lead >= PARAMS.margin or (lead >= required and self._led >= PARAMS.steady)
        stayed = steady and self._stays(best, context)
        if context.left and context.left.stays(best):
            best = context.left.known(best)
        if context.cold and self._disputed(kept):
            lead = led = 0.0
        why = ""
        if lead < required or (far and (context.views < PARAMS.views or not context.complete)):
            some = f"{len(kept)}" if context.complete else "many"
            why = f"{some} places on the map look alike: drive on a little"
            if context.moved:
                why = "the robot was moved, or something new stands here"
            elif lead >= required and context.complete:
                why = "one view is not enough to be sure: drive on a little"
        elif not self._explains(
            best, lead, far, stayed, only or (stayed and context.whole), context
        ):
            why = "too much of what the LiDAR sees is not on the map"
        elif context.vain > 0.0 and best is not back:
            why = (
                "for long no place on the map looked like what the LiDAR saw: is it the map of "
                f"this building? It must fit for {context.vain:.0f} m more"
            )
        elif best is not back and sigma(best) > PARAMS.sure:
            why = "too few features are in view to say where along them"
        return PlaceVerdict(best, led, only or stayed, why)

    def _explains(
        self, best: Hypothesis, lead: float, far: bool, stayed: bool, poor: bool,
        context: SearchContext,
    ) -> bool:  # fmt: skip
        """Whether a hypothesis explains enough of the scan. poor: the map may be wrong there."""
        judged = best.judged
        strange = far or context.odds > 0.0
        return (
            self.judge.fair(judged, PARAMS.poor if poor else PARAMS.good)
            and judged.agree >= (PARAMS.whole if far else PARAMS.poor if poor else PARAMS.seen)
            and (
                judged.log >= PARAMS.least
                or stayed
                or (not strange and lead >= 3.0 * PARAMS.margin)
            )
            and (judged.beam_count >= 0.5 * len(self.judge.lidar.beams) or stayed)
            # a map may miss a wall, and people occlude; no error shows what is behind two walls
            and (judged.passed < 2 or not context.cold)
        )

    def _disputed(self, kept: list[Hypothesis]) -> bool:
        """Whether the current view is better explained by another than the first: one missing piece
        of wall may have separated them."""
        now = [self.judge.weighed(h.judged) for h in kept]
        return max(now) > now[0] + 0.5 * PARAMS.margin

    def _stays(self, hypothesis: Hypothesis, context: SearchContext) -> bool:
        """Whether it is where the robot became lost, and plausibly so: no scan has contradicted
        another since the place was known, or by one object only and the whole map was searched."""
        left = context.left
        if left is None or not left.held(hypothesis):
            return False
        if left.stays(hypothesis):
            return True
        alike = (
            hypothesis.judged.agree >= PARAMS.seen
            and hypothesis.keyframe_log > 2.0 * PARAMS.contradicted
        )
        return left.was_known and context.whole and alike

    def _far(self, pose: Pose, context: SearchContext) -> bool:
        """Whether the robot can hardly have been moved there."""
        if context.cold:
            return True
        near = [p for p in (context.left.pose if context.left else None, context.before) if p]
        reach = PARAMS.near + 0.5
        return bool(near) and all(math.hypot(p.x - pose.x, p.y - pose.y) > reach for p in near)

    def _required_lead(self, best: Hypothesis, lead: float, context: SearchContext) -> float:
        """The lead in log likelihood that is required to believe the best hypothesis."""
        half = 0.5 * PARAMS.margin
        self._led = (self._led + 1 if best is self._leading else 1) if lead >= half else 0
        self._leading = best
        if context.moved:
            return half if self._led >= PARAMS.settled else math.inf
        if context.cold:
            return PARAMS.certain
        enough = context.driven or self._led >= PARAMS.steady or not context.everywhere
        return half if enough else PARAMS.margin


def rivals(kept: list[Hypothesis], left: Departure | None) -> list[Hypothesis]:
    """The ranked hypotheses that compete with the place where the robot became lost, while no scan
    shows that it was moved. Those elsewhere that explain less of the scan do not: where the map is
    unknown, little contradicts a place. Nor do those that fuse with odometry to the same pose."""
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
    """The nearest hypothesis at a pose, if any; along a corridor there may be two."""

    def off(h: Hypothesis) -> float:
        return math.hypot(h.pose.x - pose.x, h.pose.y - pose.y)

    return min((h for h in kept if same(h.pose, pose)), key=off, default=None)


def _lead(best: Hypothesis, others: list[Hypothesis]) -> float:
    """Log odds of a hypothesis against the others together: of many, one fits by chance."""
    odds = sum(math.exp(min(h.total - best.total, 0.0)) for h in others)
    return -math.log(odds) if odds > 0.0 else math.inf
