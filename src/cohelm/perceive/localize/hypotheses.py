"""Searches the map for the robot's pose, and follows the hypotheses until one can be believed.

The map is searched nearest places first, a slice at a time. Each hypothesis found is followed as
the robot moves, and one is believed only when no other explains the scans nearly as well
(`verdict`): two equal rooms are not guessed between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cohelm.core.frames import compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.global_search import Search, candidates, search, search_blocks
from cohelm.perceive.localize.hypothesis import Departure, Hypothesis, same, twin
from cohelm.perceive.localize.keyframe import usable
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.localization_map import Judgement, LocalizationMap, free_at
from cohelm.perceive.localize.past_views import NEAR, LastMetres, SinceLost
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.localize.verdict import Belief, PlaceVerdict, SearchContext
from cohelm.perceive.match.odometry_covariance import UNKNOWN, inverted, joined, predict, updated
from cohelm.perceive.match.scan_matching import align, independent
from cohelm.perceive.match.surfaces import FlatPoints, moved
from cohelm.perceive.scan.deskew import DeskewedScan

_BESIDE: Floats = np.diag([0.1, 0.1, 0.03]) ** 2
"""Covariance of a match's error along a corridor, added at each match; at a cold start once only,
else hypotheses slide to where they fit better. A robot that was moved may be moved further."""
_NOWHERE = Pose(0.0, 0.0, 0.0)


@dataclass
class Hypotheses:
    """The hypotheses of one robot on one map. cold_start: without a start pose."""

    known: LocalizationMap
    judge: ScanJudge
    alarm: KidnapAlarm
    cold_start: bool

    def __post_init__(self) -> None:
        self.all: list[Hypothesis] = []
        self.whole_map = self.cold_start  # whether the whole map is searched
        self.before: Departure | None = None  # the pose before one was set
        self.moved = False  # whether a check has found one that fits as the pose did before
        self.left: Departure | None = None  # where it was when it became lost
        self._belief = Belief(self.judge)
        self._last = LastMetres(PARAMS.view, PARAMS.kept)
        self._since = SinceLost(PARAMS.remembered)
        self._search: Search | None = None
        self._searched: tuple[FlatPoints, DeskewedScan] | None = None
        self._candidates: list[tuple[Pose, Floats | None]] = []
        self._base = _NOWHERE  # odometry step since the sweep of the search
        self._answered = False  # whether `all` is the result of a complete search,
        self._whole = False  # and of the whole map,
        self._jolted = False  # and contradicting scans came since
        self._tried_logs: list[float] = []  # of all candidates that were matched
        self._full = False  # whether there may be more candidates
        self._left_out = -math.inf  # bound of the log likelihood of all that are not followed
        self._searched_again = False  # whether the search was repeated as the best explains little
        self._waited = 0  # scans since then

    def forget(self) -> None:
        """Drop all hypotheses and any search."""
        self._search, self._searched, self._candidates, self.all = None, None, [], []
        self._answered = False
        self.moved = False
        self._belief.forget()

    def drop(self) -> None:
        """A check has ended: drop its hypotheses."""
        self.all, self.before = [], None

    def believed(self) -> None:
        """A pose is believed: forget the earlier ones."""
        self.cold_start, self.before = False, None
        self.left = None
        self._last.forget()

    def add(self, pose: Pose) -> None:
        """Add a candidate to the current search."""
        if self.searching:
            self._candidates += [(pose, None)]

    @property
    def searching(self) -> bool:
        """Whether a search is running."""
        return self._searched is not None

    @property
    def has_results(self) -> bool:
        """Whether a complete search has left hypotheses."""
        return self._answered and bool(self.all)

    @property
    def search_due(self) -> bool:
        """Whether a new search is due."""
        if self.searching or (self.cold_start and self.all and self._complete(self.all)):
            return False  # all candidates are followed
        return not self.all or self._waited >= PARAMS.pause

    def led_on(self, step: Pose) -> None:
        """Apply an odometry step."""
        self._base = compose(self._base, step)
        self.before = self.before.led_on(step) if self.before else None
        self.left = self.left.led_on(step) if self.left else None

    def alarm_updated(self) -> None:
        """The alarm has been updated with the newest scan."""
        if self.left and self.alarm.raised:
            self.left = self.left._replace(odds=0.0)
        self._jolted = self._jolted or self.alarm.contradicting

    def carried(self, step: Pose, joint: Floats) -> None:
        """Predict the hypotheses of a check by odometry only. joint: covariance of the tracked pose
        and of the odometry errors."""
        for hypothesis in self.all:
            hypothesis.pose, own = predict(
                hypothesis.pose, joined(hypothesis.covariance, joint[3:, 3:]), step
            )
            hypothesis.covariance = own[:3, :3]

    def keep_view(self, step: Pose, sweep: DeskewedScan) -> None:
        """At a cold start, keep the views of the last metres: hypotheses found later must fit
        them."""
        if not self.cold_start:
            return
        self._last.led_on(step)
        if usable(sweep):
            self._last.add(sweep)

    def begin_search(
        self, flat: FlatPoints, sweep: DeskewedScan, here: Pose, joint: Floats
    ) -> None:  # fmt: skip
        """Begin a search, near by at first, then everywhere. here, joint: the predicted pose and
        its covariance."""
        places = self.known.places
        own = self.left.pose if self.left else here
        if not self.whole_map:
            # not around the likeliest hypothesis, which may be anywhere
            near = np.hypot(places[:, 0] - own.x, places[:, 1] - own.y) < PARAMS.near
            places = places[near]
        views = [sweep.points, *(moved(v.back, v.sweep.points, True) for v in self._last.use())]
        self._search = search(np.vstack(views), places, self.cold_start)
        # the predicted pose is a candidate too
        known = [] if self.cold_start else [here]
        known += [self.left.pose] if self.left else []
        self._candidates = [(pose, None) for pose in known]
        # with odometry as prior
        led = [(own, self.left.joint if self.left else joint)] if known else []
        led += [(self.before.pose, self.before.joint)] if self.before else []
        self._candidates += [(pose, inverted(sure[:3, :3])) for pose, sure in led]
        self._searched = (flat, sweep)
        self._tried_logs = []
        self._searched_again = self.cold_start and bool(self.all)
        self._base = _NOWHERE
        if not self.all:
            self._since = SinceLost(PARAMS.remembered, sweep)

    def search_step(self, lost: bool) -> bool:
        """One slice of the search, if any; about 3 ms. Returns whether that ended it."""
        if self._searched is None:
            return False
        flat, sweep = self._searched
        if self._search is not None:
            self._search = search_blocks(self._search, self.known, PARAMS.places)
            if self._search.over:
                most = PARAMS.everywhere if self.whole_map else PARAMS.hypotheses
                found = candidates(self._search, most)
                self._full = len(found) == most
                self._candidates += [(pose, None) for pose in found]
                self._search = None
            return False
        for pose, prior in self._candidates[:4]:
            self._tried_logs.append(self._consider(pose, prior, flat, sweep, lost))
        self._candidates = self._candidates[4:]
        if self._candidates:
            return False
        self._searched, self._answered, self._waited = None, True, 0
        # earlier hypotheses of the whole map remain, unless the robot may have been carried since
        self._whole = self.whole_map or (self._whole and bool(self.all) and not self._jolted)
        self._jolted = self._jolted and not self.whole_map
        if self.cold_start:
            self._since.views = max(self._since.views, len(self._last.used))
        # more candidates exist if the last ones tried fit as well as the best
        last = max(self._tried_logs[-PARAMS.last :]) if self._full else -math.inf
        best = max(self._tried_logs, default=-math.inf)  # none where no place sees a wall
        self._left_out = self._near(last, best)
        if self.cold_start and self.all:
            self._left_out -= max(self.all, key=lambda h: h.log).charges.closer
        return True

    def widen(self) -> None:
        """If no hypothesis is plausible, search near by and everywhere in turn."""
        if not any(self.judge.plausible(h.judged) for h in self.all):
            self.whole_map = self.cold_start or not self.whole_map

    def follow(
        self, step: Pose, sweep: DeskewedScan, flat: FlatPoints, joint: Floats
    ) -> None:  # fmt: skip
        """Lost: predict all hypotheses, and match and judge some. joint: predicted already."""
        since, match_params = self._since, self.judge.match_params
        off = since.led_on(step)
        # a scan from the same place adds no information
        fresh = off > NEAR and not any(h.stale for h in self.all)
        oldest = sorted(self.all, key=lambda h: -h.age)[: PARAMS.judged]
        # map errors are correlated over some distance
        share = min(1.0, off / match_params.correlated)
        if fresh and self.all:
            since.keep(step, share)
        since.before = sweep
        for hypothesis in self.all:
            hypothesis.age += 1
            if fresh:
                hypothesis.log, hypothesis.stale = hypothesis.log + share * hypothesis.latest, True
            predicted, own = predict(
                hypothesis.pose, joined(hypothesis.covariance, joint[3:, 3:]), step
            )
            hypothesis.pose, hypothesis.covariance = predicted, own[:3, :3].copy()
        for hypothesis in oldest:
            held = self.cold_start or hypothesis.led
            prior = inverted(hypothesis.covariance if held else hypothesis.covariance + _BESIDE)
            fit = align(self.known.surfaces, flat, hypothesis.pose, prior, match_params)
            own = joined(hypothesis.covariance, joint[3:, 3:])
            # each wall counts once, so that a hypothesis is not held to where it began
            information = independent(self.known.surfaces, flat, fit.pose, match_params, fit.rms)
            information = (since.share if hypothesis.stale else 0.0) * information
            hypothesis.pose, hypothesis.covariance = fit.pose, updated(own, information)[:3, :3]
            hypothesis.judged = self.judge.judge(fit.pose, sweep.ranges)
            if not self.cold_start:
                new = self.judge.weighed(hypothesis.judged)
                hypothesis.latest = (
                    new if hypothesis.stale else max(0.9 * hypothesis.latest + 0.1 * new, new)
                )
            elif hypothesis.stale:
                self.judge.charge(hypothesis.pose, sweep, hypothesis.charges)
                hypothesis.log = hypothesis.charges.log
            hypothesis.keyframe_log = self.alarm.keyframe_log(hypothesis.pose)
            hypothesis.age, hypothesis.stale = 0, False
        if fresh:
            since.go_on()
        self._waited += 1

    def ranked(self) -> list[Hypothesis]:
        """Drop refuted hypotheses; returns the others, the likeliest first."""
        stayed = [h for h in self.all if self.left is not None and self.left.held(h)]
        for hypothesis in self.all:
            own = next((h for h in stayed if twin(hypothesis, h)), None)
            hypothesis.prior = self._prior(hypothesis, own is not None)
            if own is not None:  # people near by contradict it no less than its twin
                hypothesis.keyframe_log = min(hypothesis.keyframe_log, own.keyframe_log)
        alive = [h for h in self.all if self._possible(h.pose, h.judged)]
        alive.sort(key=lambda h: -h.total)
        kept: list[Hypothesis] = []
        for hypothesis in alive:
            unlikely = kept and kept[0].total - hypothesis.total > PARAMS.refuted
            # people may contradict the earlier place, as long as the map fits there
            possible = not unlikely or any(hypothesis is own for own in stayed)
            if possible and not any(same(hypothesis.pose, other.pose) for other in kept):
                kept.append(hypothesis)
        if not kept:  # hypotheses found from now on have no views yet
            self._since.views, self._whole = 0, False
        self.all = kept[: PARAMS.followed]
        for hypothesis in kept[PARAMS.followed :][:1]:
            own = hypothesis.charges.most - kept[0].charges.closer
            self._left_out = max(self._left_out, own if self.cold_start else math.inf)
        return kept

    def _near(self, last: float, best: float) -> float:
        """Bound of the log likelihood of the candidates not tried, of which the last one tried has
        `last`. At a cold start costs only grow; else one that comes near may improve."""
        if self.cold_start:
            return last
        return math.inf if last >= best - 2.0 * PARAMS.margin else -math.inf

    def _complete(self, kept: list[Hypothesis]) -> bool:
        """Whether no place that is not followed comes near the best. At a cold start one may, if
        the best of the first search leaves more than some four objects unexplained."""
        # a place that is not followed is assumed to fit the later views as closely as the best
        own = kept[0].total - kept[0].charges.closer
        if self.cold_start and own < PARAMS.least and not self._searched_again:
            return False
        return own - self._left_out >= PARAMS.margin

    @property
    def held(self) -> float:
        """`travel` for which places that fit have been followed [m]."""
        return self._since.all_travel if self.all else 0.0

    def verdict(self, kept: list[Hypothesis], vain: float) -> PlaceVerdict:
        """Whether the best of the ranked hypotheses can be believed. vain: see `SearchContext`."""
        since = self._since
        driven = since.way >= PARAMS.travelled or since.turned >= 2.0 * PARAMS.travelled
        about = SearchContext(
            self.cold_start, self._whole, bool(kept) and self._complete(kept), self.whole_map,
            self.moved, vain, since.views, driven, self.left,
            self.before.pose if self.before else None,
        )  # fmt: skip
        found = self._belief.verdict(kept, about)
        if found.best is None and self._searched is None:
            self.all, self._whole = [], False  # else keep them until the search ends
        return found

    def _consider(
        self, guess: Pose, prior: Floats | None, flat: FlatPoints, sweep: DeskewedScan, lost: bool
    ) -> float:
        """Match a candidate, and keep it as a hypothesis if it fits. prior: (3, 3), its information
        matrix; None: weak. Returns its log likelihood."""
        match_params, led = self.judge.match_params, prior is not None
        wide = np.diag([0.3, 0.3, 0.1]) ** 2 if prior is None else inverted(prior)
        if prior is None:
            prior = np.diag([1.0, 1.0, 4.0])
            match_params = match_params._replace(reach=0.6, rounds=30)
        fit = align(self.known.surfaces, flat, guess, prior, match_params)
        judged = self.judge.judge(fit.pose, sweep.ranges)
        if not self._possible(compose(fit.pose, self._base), judged, 0.05):
            return -1e3
        joint = joined(wide, UNKNOWN)
        information = independent(self.known.surfaces, flat, fit.pose, match_params, fit.rms)
        covariance = updated(joint, information)[:3, :3]
        pose = compose(fit.pose, self._base)
        new = self.judge.weighed(judged)
        for other in self.all:
            if same(other.pose, pose):
                # the odometry prior counts against one scan
                least = other.latest + (0.5 * PARAMS.margin if other.led else 0.0)
                if new > least and not self.cold_start:
                    other.pose, other.covariance, other.led = pose, covariance, led
                    other.latest, other.judged = new, judged
                return -1e3  # known already
        # it must fit the earlier views as well
        before = self._since.likely(pose, self._weighed)
        found = Hypothesis(pose, covariance, before, new, judged, led=led)
        if self.cold_start:
            for view in self._last.used:
                self.judge.charge(compose(fit.pose, view.back), view.sweep, found.charges, 2)
            self.judge.charge(fit.pose, sweep, found.charges)
            found.log, found.latest = found.charges.log, 0.0
            before, new = found.charges.most, 0.0
            found.covariance = covariance + _BESIDE
        # only once it is lost: a keyframe may have been taken during a push
        found.keyframe_log = self.alarm.keyframe_log(pose) if lost else 0.0
        self.all.append(found)
        return before + new

    def _weighed(self, pose: Pose, ranges: Floats) -> float:
        """Log likelihood of a scan at a pose, by every other beam."""
        return self.judge.weighed(self.judge.judge(pose, ranges, 2))

    def _possible(self, pose: Pose, judged: Judgement, more: float = 0.0) -> bool:
        """Whether a pose is possible by one scan; near the last pose, or the one before a person
        set one, the map may be wrong. more: stricter, for a new one."""
        here = any(last is not None and last.away(pose) < 0.5 for last in (self.left, self.before))
        if here and judged.agree > PARAMS.poor:
            return True  # a mapped wall may be gone
        fits = judged.agree > 0.35 + more and judged.through < 0.4 - more
        return fits and free_at(self.known, pose.x, pose.y)

    def _prior(self, hypothesis: Hypothesis, turned_round: bool = False) -> float:
        """Log prior of a hypothesis given the last known pose: not moved, carried no faster than
        walking, hardly turned. turned_round: whether it is the twin of one at that pose."""
        left = self.left
        if left is None:
            return 0.0
        if left.odds > 0.0:
            return -min(0.5 * left.mahalanobis(hypothesis), left.odds)
        carried = 0.0
        if left.was_known:
            reachable = PARAMS.near + 0.5 + PARAMS.pace * self.alarm.carried
            beyond = left.away(hypothesis.pose) - reachable
            carried = min(0.5 * (max(beyond, 0.0) / PARAMS.put) ** 2, PARAMS.unmoved)
        if turned_round:
            carried = PARAMS.unmoved
        if self.whole_map:
            return -carried
        turned = wrap(hypothesis.pose.psi - left.pose.psi) / PARAMS.turned
        return -carried - min(0.5 * turned**2, 0.25 * PARAMS.margin)
