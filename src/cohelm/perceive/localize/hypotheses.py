"""Searches the map for a robot and follows the places where it may be, until one can be believed.

All the map is searched, nearest places first, a slice at a time. What is found are hypotheses.
Each is followed as the robot moves, and one is believed only when no other explains what was seen
nearly as well (`verdict`): two rooms alike are not guessed between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cohelm.core.frames import compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.global_search import Search, candidates, looked, search
from cohelm.perceive.localize.hypothesis import Departure, Hypothesis, same, twin
from cohelm.perceive.localize.keyframe import usable
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.localization_map import Judgement, LocalizationMap, free_at
from cohelm.perceive.localize.past_views import NEAR, LastMetres, SinceLost
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.localize.verdict import Belief, Circumstances, PlaceVerdict
from cohelm.perceive.match.odometry_covariance import UNKNOWN, inverted, joined, moved, updated
from cohelm.perceive.match.scan_matching import align, independent
from cohelm.perceive.match.surfaces import moved as shifted
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar

_BESIDE: Floats = np.diag([0.1, 0.1, 0.03]) ** 2
"""A match along a corridor may end so far beside; the next one is not held to it. Switched on, this
is so of what a search finds, and no more: else places slide to where they fit better. Who was moved
may be moved on."""
_NOWHERE = Pose(0.0, 0.0, 0.0)


@dataclass
class Hypotheses:
    """Of one robot on one map. cold: it may be anywhere."""

    known: LocalizationMap
    lidar: Lidar
    caution: Caution
    judge: ScanJudge
    alarm: KidnapAlarm
    cold: bool

    def __post_init__(self) -> None:
        c = self.caution
        self.all: list[Hypothesis] = []
        self.everywhere = self.cold  # whether it is the whole map that is searched
        self.before: Departure | None = None  # where it was until somebody said where it is
        self.moved = False  # whether a check has found one that fits as it used to
        self.left: Departure | None = None  # where it was when it became lost
        self._belief = Belief(c, self.judge, len(self.lidar.beams))
        self._last = LastMetres(c.view, c.kept)
        self._since = SinceLost(c.remembered, np.empty(0))
        self._search: Search | None = None
        self._searched: tuple[Floats, Floats, Floats] | None = None
        self._found: list[tuple[Pose, Floats | None]] = []
        self._base = _NOWHERE  # odometry pose of the sweep that is searched with
        self._answered = False  # whether places are those of a whole search,
        self._whole = False  # and of the whole map,
        self._jolted = False  # and scans that contradicted what was seen came since
        self._tried: list[float] = []  # likelihoods of all that were matched
        self._full = False  # whether there may have been more
        self._left_out = -math.inf  # likelihood that none exceeds which is not followed
        self._again = False  # whether what explains little was searched for anew
        self._waited = 0  # scans since then
        self._stamp = self._sought = 0.0  # of the newest sweep, and of the one searched with [s]

    def forget(self) -> None:
        """Drop all places and any search."""
        self._search, self._searched, self._found, self.all = None, None, [], []
        self._answered = False
        self.moved = False
        self._belief.forget()

    def drop(self) -> None:
        """A check has ended: what it found is of no use any more."""
        self.all, self.before = [], None

    def believed(self) -> None:
        """A place is believed: where the robot was before counts no more."""
        self.cold, self.before = False, None
        self.left = None
        self._last.forget()

    def add(self, pose: Pose) -> None:
        """One more place for a search that goes on."""
        if self.searching:
            self._found += [(pose, None)]

    @property
    def searching(self) -> bool:
        """Whether a search goes on."""
        return self._searched is not None

    @property
    def answered(self) -> bool:
        """Whether there are places of a search that has come to its end."""
        return self._answered and bool(self.all)

    @property
    def tired(self) -> bool:
        """Whether it is time to search anew."""
        if self.searching or (self.cold and self.all and self._complete(self.all)):
            return False  # all that can be are followed
        return not self.all or self._waited >= self.caution.pause

    def led_on(self, step: Pose) -> None:
        """The robot has moved by a step, by its odometry."""
        self._base = compose(self._base, step)
        self.before = self.before.led_on(step) if self.before else None
        self.left = self.left.led_on(step) if self.left else None

    def compared(self) -> None:
        """The newest scan was compared with those before."""
        if self.left and self.alarm.raised:
            self.left = self.left._replace(odds=0.0)
        self._jolted = self._jolted or self.alarm.jolted

    def carried(self, step: Pose, joint: Floats) -> None:
        """Lead places that a check has found on by odometry, and no more. joint: covariance of the
        tracked pose and of what the wheels get wrong."""
        for one in self.all:
            one.pose, own = moved(one.pose, joined(one.covariance, joint[3:, 3:]), step)
            one.covariance = own[:3, :3]

    def look_back(self, step: Pose, sweep: DeskewedScan, stamp: float) -> None:
        """Keep the views of the last metres while it may be anywhere: a place that is thought of
        only now must fit them. stamp: of the sweep [s]."""
        self._stamp = stamp
        if not self.cold:
            return
        self._last.led_on(step)
        if usable(self.lidar, sweep.ranges):
            self._last.add(sweep.points, sweep.ranges, stamp)

    def seek(
        self, points: Floats, across: Floats, sweep: DeskewedScan, here: Pose, joint: Floats
    ) -> None:  # fmt: skip
        """Begin a search: near by at first, then everywhere. here, joint: where it is taken to be,
        and how sure that is."""
        places = self.known.places
        own = self.left.pose if self.left else here
        if not self.everywhere:
            # not by the likeliest of what was found, which may be anywhere
            near = np.hypot(places[:, 0] - own.x, places[:, 1] - own.y) < self.caution.near
            places = places[near]
        all_ = [sweep.points, *(shifted(v.back, v.points, True) for v in self._last.use())]
        self._search = search(np.vstack(all_), places, self.cold)
        # where it is taken to be competes with all others
        known = [] if self.cold else [here]
        known += [self.left.pose] if self.left else []
        self._found = [(pose, None) for pose in known]
        # where odometry leads is not looked for half a metre beside
        led = [(own, self.left.joint if self.left else joint)] if known else []
        led += [(self.before.pose, self.before.joint)] if self.before else []
        self._found += [(pose, inverted(sure[:3, :3])) for pose, sure in led]
        self._searched = (points, across, sweep.ranges)
        self._tried, self._sought = [], self._stamp
        self._again = self.cold and bool(self.all)
        self._base = _NOWHERE
        if not self.all:
            self._since = SinceLost(self.caution.remembered, sweep.ranges)

    def think(self, lost: bool) -> bool:
        """Use a moment for the search, where one is going on; about 3 ms. Whether that ended it."""
        if self._searched is None:
            return False
        points, across, ranges = self._searched
        if self._search is not None:
            self._search = looked(self._search, self.known, self.caution.places)
            if self._search.over:
                c = self.caution
                most = c.everywhere if self.everywhere else c.hypotheses
                found = candidates(self._search, most)
                self._full = len(found) == most
                self._found += [(pose, None) for pose in found]
                self._search = None
            return False
        for pose, prior in self._found[:4]:
            self._tried.append(self._consider(pose, prior, points, across, ranges, lost))
        self._found = self._found[4:]
        if self._found:
            return False
        self._searched, self._answered, self._waited = None, True, 0
        # places of the whole map are followed on, unless the robot may have been carried on
        self._whole = self.everywhere or (self._whole and bool(self.all) and not self._jolted)
        self._jolted = self._jolted and not self.everywhere
        if self.cold:
            self._since.views = max(self._since.views, len(self._last.used))
        # more places were found than were tried, where the last of them fit as well as the best
        last = max(self._tried[-self.caution.last :]) if self._full else -math.inf
        self._left_out = self._near(last, max(self._tried))
        if self.cold and self.all:
            self._left_out -= max(self.all, key=lambda h: h.log).charges.closer
        return True

    def widen(self) -> None:
        """Where nothing that is followed may well be the place, look near by and everywhere in
        turn."""
        if not any(self.judge.plausible(h.judged) for h in self.all):
            self.everywhere = self.cold or not self.everywhere

    def follow(
        self, step: Pose, sweep: DeskewedScan, points: Floats, across: Floats, joint: Floats
    ) -> None:  # fmt: skip
        """Lost: move all hypotheses along, and see which still hold. joint: as led on already."""
        since, care = self._since, self.judge.care
        off = since.led_on(step)
        # a scan from the same spot says nothing new
        fresh = off > NEAR and not any(h.stale for h in self.all)
        oldest = sorted(self.all, key=lambda h: -h.age)[: self.caution.judged]
        # what the map gets wrong is wrong alike for some way
        share = min(1.0, off / care.correlated)
        if fresh and self.all:
            since.keep(step, share)
        since.ranges = sweep.ranges
        for one in self.all:
            one.age += 1
            if fresh:
                one.log, one.stale = one.log + share * one.latest, True
            foretold, own = moved(one.pose, joined(one.covariance, joint[3:, 3:]), step)
            one.pose, one.covariance = foretold, own[:3, :3].copy()
        for one in oldest:
            held = self.cold or one.led
            prior = inverted(one.covariance if held else one.covariance + _BESIDE)
            fit = align(self.known.surfaces, points, across, one.pose, prior, care)
            own = joined(one.covariance, joint[3:, 3:])
            # what is followed for long must not be held to where it began: each wall tells once
            told = independent(self.known.surfaces, points, across, fit.pose, care, fit.rms)
            told = (since.share if one.stale else 0.0) * told
            one.pose, one.covariance = fit.pose, updated(own, told)[:3, :3]
            one.judged = self.judge.judge(fit.pose, sweep.ranges)
            if not self.cold:
                new = self.judge.weighed(one.judged)
                one.latest = new if one.stale else max(0.9 * one.latest + 0.1 * new, new)
            elif one.stale:
                self.judge.charge(one.pose, sweep.ranges, self._stamp, one.charges)
                one.log = one.charges.log
            one.witnessed = self.alarm.witnessed(one.pose)
            one.age, one.stale = 0, False
        if fresh:
            since.go_on()
        self._waited += 1

    def ranked(self) -> list[Hypothesis]:
        """Drop what is refuted; all that can be, the likeliest first."""
        stayed = [h for h in self.all if self.left is not None and self.left.held(h)]
        for one in self.all:
            own = next((h for h in stayed if twin(one, h, self.caution)), None)
            one.prior = self._prior(one, own is not None)
            if own is not None:  # people about speak no less against it than against its twin
                one.witnessed = min(one.witnessed, own.witnessed)
        alive = [h for h in self.all if self._possible(h.pose, h.judged)]
        alive.sort(key=lambda h: -h.total)
        kept: list[Hypothesis] = []
        for one in alive:
            unlikely = kept and kept[0].total - one.total > self.caution.refuted
            # people may speak against where it was, as long as the map fits there
            possible = not unlikely or any(one is own for own in stayed)
            if possible and not any(same(one.pose, other.pose) for other in kept):
                kept.append(one)
        if not kept:  # what is found from now on has held from no place, and beside no other, yet
            self._since.views, self._whole = 0, False
        self.all = kept[: self.caution.followed]
        for one in kept[self.caution.followed :][:1]:
            own = one.charges.most - kept[0].charges.closer
            self._left_out = max(self._left_out, own if self.cold else math.inf)
        return kept

    def _near(self, last: float, best: float) -> float:
        """Likelihood that no place exceeds of which the last that was tried is so likely. What a
        place of a robot that may be anywhere is charged for only grows; else one that comes near
        may come nearer."""
        if self.cold:
            return last
        return math.inf if last >= best - 2.0 * self.caution.margin else -math.inf

    def _complete(self, kept: list[Hypothesis]) -> bool:
        """Whether no place that is not followed comes near the best. Of a robot that may be
        anywhere, where the best of the first search leaves more than some four things unexplained,
        there may be one."""
        c = self.caution
        # what is not followed is taken to lie on what was seen since as closely as the best
        own = kept[0].total - kept[0].charges.closer
        if self.cold and own < c.least and not self._again:
            return False
        return own - self._left_out >= c.margin

    def verdict(self, kept: list[Hypothesis]) -> PlaceVerdict:
        """Whether the best of those that are ranked can be believed."""
        c, since = self.caution, self._since
        driven = since.way >= c.travelled or since.turned >= 2.0 * c.travelled
        about = Circumstances(
            self.cold, self._whole, bool(kept) and self._complete(kept), self.everywhere,
            self.moved, since.views, driven, self.left,
            self.before.pose if self.before else None,
        )  # fmt: skip
        found = self._belief.verdict(kept, about)
        if found.best is None and self._searched is None:
            self.all, self._whole = [], False  # else what is found so far is kept for its end
        return found

    def _consider(
        self, guess: Pose, prior: Floats | None, points: Floats, across: Floats, ranges: Floats,
        lost: bool,
    ) -> float:  # fmt: skip
        """Match a candidate, and keep it as a hypothesis where it fits. prior: (3, 3), how well it
        is known, as information; None: hardly. How likely it is."""
        care, led = self.judge.care, prior is not None
        wide = np.diag([0.3, 0.3, 0.1]) ** 2 if prior is None else inverted(prior)
        if prior is None:
            prior, care = np.diag([1.0, 1.0, 4.0]), care._replace(reach=0.6, rounds=30)
        fit = align(self.known.surfaces, points, across, guess, prior, care)
        judged = self.judge.judge(fit.pose, ranges)
        if not self._possible(compose(fit.pose, self._base), judged, 0.05):
            return -1e3
        joint = joined(wide, UNKNOWN)
        told = independent(self.known.surfaces, points, across, fit.pose, care, fit.rms)
        covariance = updated(joint, told)[:3, :3]
        pose = compose(fit.pose, self._base)
        new = self.judge.weighed(judged)
        for other in self.all:
            if same(other.pose, pose):
                # what odometry knows of a place counts against what one scan says
                least = other.latest + (0.5 * self.caution.margin if other.led else 0.0)
                if new > least and not self.cold:
                    other.pose, other.covariance, other.led = pose, covariance, led
                    other.latest, other.judged = new, judged
                return -1e3  # nothing new
        # it must fit what was seen from the places before: to come late is no advantage
        before = self._since.likely(pose, self._weighed)
        found = Hypothesis(pose, covariance, before, new, judged, led=led)
        if self.cold:
            for view in self._last.used:
                at = compose(fit.pose, view.back)
                self.judge.charge(at, view.ranges, view.stamp, found.charges, 2)
            self.judge.charge(fit.pose, ranges, self._sought, found.charges)
            found.log, found.latest = found.charges.log, 0.0
            before, new = found.charges.most, 0.0
            found.covariance = covariance + _BESIDE
        # only once it is lost: a keyframe may have been taken while somebody pushed, and before
        # that the map is asked
        found.witnessed = self.alarm.witnessed(pose) if lost else 0.0
        self.all.append(found)
        return before + new

    def _weighed(self, pose: Pose, ranges: Floats) -> float:
        """How likely a scan is at a pose, by every other beam."""
        return self.judge.weighed(self.judge.judge(pose, ranges, 2))

    def _possible(self, pose: Pose, judged: Judgement, more: float = 0.0) -> bool:
        """Whether the robot may be there, by one scan alone; where it last was, the map may be
        wrong. more: that is asked of a new one."""
        here = self.left is not None and self.left.away(pose) < 0.5
        if here and judged.agree > self.caution.poor:
            return True  # a wall that is gone may be driven through
        fits = judged.agree > 0.35 + more and judged.through < 0.4 - more
        return fits and free_at(self.known, pose.x, pose.y)

    def _prior(self, one: Hypothesis, turned_round: bool = False) -> float:
        """What where the robot was says to a hypothesis: that it stayed, that nobody carries it far
        in no time, and that who is pushed or dragged is hardly turned round. turned_round: whether
        it is the twin of one where it was."""
        c, left = self.caution, self.left
        if left is None:
            return 0.0
        if left.odds > 0.0:
            return -min(0.5 * left.strayed(one), left.odds)
        carried = 0.0
        if left.knew:
            beyond = left.away(one.pose) - (c.near + 0.5 + c.pace * self.alarm.carried)
            carried = min(0.5 * (max(beyond, 0.0) / c.put) ** 2, c.unmoved)
        if turned_round:
            carried = c.unmoved
        if self.everywhere:
            return -carried
        turned = wrap(one.pose.psi - left.pose.psi) / c.turned
        return -carried - min(0.5 * turned**2, 0.25 * c.margin)
