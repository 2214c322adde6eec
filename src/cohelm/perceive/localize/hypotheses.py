"""Searches the map for a robot and follows the places where it may be, until one can be believed.

All the map is searched, nearest places first, a slice at a time. What is found are hypotheses.
Each is followed as the robot moves, and one is believed only when no other explains what was seen
nearly as well: two rooms alike are not guessed between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import compose, inverse
from cohelm.core.types import Floats, Pose, wrap
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.global_search import Search, candidates, looked, search
from cohelm.perceive.localize.keyframe import usable
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.localization_map import Judgement, LocalizationMap, free_at
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.match.odometry_covariance import UNKNOWN, inverted, joined, moved, updated
from cohelm.perceive.match.scan_matching import align
from cohelm.perceive.match.surfaces import moved as shifted
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar

_BESIDE: Floats = np.diag([0.1, 0.1, 0.03]) ** 2
"""A match along a corridor may end so far beside; the next one is not held to it."""


class _View(NamedTuple):
    """A scan from where the robot was, `back` from where it is now: points in the body frame then,
    and the whole scan's ranges."""

    back: Pose
    points: Floats
    ranges: Floats


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

    @property
    def total(self) -> float:
        """Likelihood of all scans, and of its having come there."""
        return self.log + self.latest + self.prior + self.witnessed


class Verdict(NamedTuple):
    """best: the likeliest place, None where none fits. lead: by which it is likelier than the
    next. proven: nothing else on the map comes near it. why: it is not believed; empty if it is."""

    best: Hypothesis | None
    lead: float
    proven: bool
    why: str


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
        self.all: list[Hypothesis] = []
        self.everywhere = self.cold  # whether it is the whole map that is searched
        self.before: Pose | None = None  # where it believed to be until somebody said where it is
        self.moved = False  # whether a check has found one that fits as it used to
        self._search: Search | None = None
        self._searched: tuple[Floats, Floats, Floats] | None = None
        self._found: list[tuple[Pose, Floats | None]] = []
        self._base = Pose(0.0, 0.0, 0.0)  # odometry pose of the sweep that is searched with
        self._way = self._turned = 0.0
        self._leg = Pose(0.0, 0.0, 0.0)  # on from where hypotheses were last judged afresh
        self._views = 0  # places some way apart that they were judged from before,
        self._weight = 0.0  # and how many of them tell something of their own
        self._past: list[tuple[Pose, Floats, float]] = []  # the last, from here, and their weights
        self._seen: Floats = np.empty(0)  # ranges of the scan before
        self._answered = False  # whether they are those of a whole search,
        self._whole = False  # and of the whole map,
        self._jolted = False  # and scans that contradicted what was seen came since
        self._tried: list[float] = []  # likelihoods of all that were matched
        self._full = False  # whether there may have been more
        self._behind: list[_View] = []  # of the last metres, the newest last; while cold only
        self._earlier: list[_View] = []  # of them, those that a search goes by beside its own
        self._complete = True  # whether no place that fits as well was left out
        self._waited = 0  # scans since then
        self._leading: Hypothesis | None = None  # the likeliest
        self._led = 0  # scans in which it led well
        self._left: Pose | None = None  # where it would be by odometry, since it is lost
        self._left_joint: Floats = np.empty((0, 0))  # and how sure that place is
        self._odds = 0.0  # log odds that the robot is where it left off, since it is lost,
        self._knew = False  # and whether it knew that place

    def forget(self) -> None:
        """Drop all places and any search."""
        self._search, self._searched, self._found, self.all = None, None, [], []
        self._answered = False
        self.moved, self._led = False, 0

    def drop(self) -> None:
        """A check has ended: what it found is of no use any more."""
        self.all, self.before = [], None

    def believed(self) -> None:
        """A place is believed: where the robot was before counts no more."""
        self.cold, self.before = False, None
        self._behind, self._earlier = [], []
        self._left, self._odds, self._knew = None, 0.0, False

    def leave(self, pose: Pose, joint: Floats, odds: float, knew: bool) -> None:
        """Keep where it was when it became lost, the log odds that it still is, and whether it knew
        that place before."""
        self._left, self._left_joint, self._odds, self._knew = pose, joint, odds, knew

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
        if self.searching or (self.cold and self._complete and self.all):
            return False  # all that can be are followed
        return not self.all or self._waited >= self.caution.pause

    def led_on(self, step: Pose) -> None:
        """The robot has moved by a step, by its odometry."""
        self._base = compose(self._base, step)
        self.before = compose(self.before, step) if self.before else None
        if self._left:
            self._left, self._left_joint = moved(self._left, self._left_joint, step)

    def compared(self) -> None:
        """The newest scan was compared with those before."""
        self._odds = 0.0 if self.alarm.raised else self._odds
        self._jolted = self._jolted or self.alarm.jolted

    def carried(self, step: Pose, joint: Floats) -> None:
        """Lead places that a check has found on by odometry, and no more. joint: covariance of the
        tracked pose and of what the wheels get wrong."""
        for one in self.all:
            one.pose, own = moved(one.pose, joined(one.covariance, joint[3:, 3:]), step)
            one.covariance = own[:3, :3]

    def look_back(self, step: Pose, sweep: DeskewedScan) -> None:
        """Keep the views of the last metres while it may be anywhere: a place that is thought of
        only now must fit them."""
        if not self.cold:
            return
        c, turn = self.caution, inverse(step)
        seen = [view._replace(back=compose(turn, view.back)) for view in self._behind]
        last = seen[-1].back if seen else None
        near = last and math.hypot(last.x, last.y) < c.view and abs(last.psi) < c.view
        if not near and usable(self.lidar, sweep.ranges):
            seen.append(_View(Pose(0.0, 0.0, 0.0), sweep.points, sweep.ranges))
        self._behind = seen[-c.kept :]

    def seek(
        self, points: Floats, across: Floats, sweep: DeskewedScan, here: Pose, joint: Floats
    ) -> None:  # fmt: skip
        """Begin a search: near by at first, then everywhere. here, joint: where it is taken to be,
        and how sure that is."""
        places = self.known.places
        own = self._left or here
        if not self.everywhere:
            # not by the likeliest of what was found, which may be anywhere
            near = np.hypot(places[:, 0] - own.x, places[:, 1] - own.y) < self.caution.near
            places = places[near]
        # what was seen from nearer by than this says nothing more
        self._earlier = [
            v for v in self._behind if math.hypot(v.back.x, v.back.y) + 0.5 * abs(v.back.psi) > 0.15
        ]
        all_ = [sweep.points, *(shifted(v.back, v.points, True) for v in self._earlier)]
        self._search = search(np.vstack(all_), places)
        # where it is taken to be competes with all others
        known = [] if self.cold else [here]
        known += [p for p in (self._left, self.before) if p is not None]
        self._found = [(pose, None) for pose in known]
        if known:  # where odometry leads is not looked for half a metre beside
            sure = self._left_joint if self._left else joint
            self._found += [(own, inverted(sure[:3, :3]))]
        self._searched = (points, across, sweep.ranges)
        self._tried = []
        if self.cold and not self._complete:  # some that can be are not followed: anew
            self.all = []
        self._base = Pose(0.0, 0.0, 0.0)
        if not self.all:
            self._way = self._turned = 0.0
            self._leg = Pose(0.0, 0.0, 0.0)
            self._views, self._weight = 0, 0.0
            self._past, self._seen = [], sweep.ranges

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
            self._views = len(self._earlier)
            self._weight = float(self._views)
        # more places were found than were tried, where the last of them fit as well as the best
        last = self._tried[-self.caution.last :]
        close = 2.0 * self.caution.margin
        self._complete = not self._full or max(last) < max(self._tried) - close
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
        self._leg = compose(self._leg, step)
        way, turned = math.hypot(self._leg.x, self._leg.y), abs(self._leg.psi)
        # a scan from the same spot says nothing new
        fresh = way + 0.5 * turned > 0.15 and not any(h.stale for h in self.all)
        oldest = sorted(self.all, key=lambda h: -h.age)[: self.caution.judged]
        # what the map gets wrong is wrong alike for some way
        care = self.judge.care
        share = 1.0 if self.cold else min(1.0, (way + 0.5 * turned) / care.correlated)
        back = inverse(step)
        self._past = [(compose(back, pose), seen, by) for pose, seen, by in self._past]
        if fresh and self.all:
            self._past = [*self._past, (back, self._seen, share)][-self.caution.remembered :]
        self._seen = sweep.ranges
        for one in self.all:
            one.age += 1
            if fresh:
                one.log, one.stale = one.log + share * one.latest, True
            foretold, own = moved(one.pose, joined(one.covariance, joint[3:, 3:]), step)
            one.pose, one.covariance = foretold, own[:3, :3].copy()
        for one in oldest:
            prior = inverted(one.covariance + _BESIDE)
            fit = align(self.known.surfaces, points, across, one.pose, prior, care)
            own = joined(one.covariance, joint[3:, 3:])
            one.pose, one.covariance = fit.pose, updated(own, fit.information)[:3, :3]
            one.judged = self.judge.judge(fit.pose, sweep.ranges)
            new = self.judge.weighed(one.judged)
            one.latest = new if one.stale else max(0.9 * one.latest + 0.1 * new, new)
            one.witnessed = self.alarm.witnessed(one.pose)
            one.age, one.stale = 0, False
        if fresh:
            self._way, self._turned = self._way + way, self._turned + turned
            self._leg = Pose(0.0, 0.0, 0.0)
            self._views += bool(self.all)
            self._weight += share if self.all else 0.0
        self._waited += 1

    def ranked(self) -> list[Hypothesis]:
        """Drop what is refuted; all that can be, the likeliest first."""
        for one in self.all:
            one.prior = self._prior(one)
        alive = [h for h in self.all if self._possible(h.pose, h.judged)]
        alive.sort(key=lambda h: -h.total)
        kept: list[Hypothesis] = []
        for one in alive:
            close = kept and kept[0].total - one.total > self.caution.refuted
            if not close and not any(same(one.pose, other.pose) for other in kept):
                kept.append(one)
        if not kept:  # what is found from now on has held from no place, and beside no other, yet
            self._views, self._whole = 0, False
        self.all = kept[: self.caution.followed]
        self._complete = self._complete and len(kept) <= self.caution.followed
        return kept

    def verdict(self, kept: list[Hypothesis]) -> Verdict:
        """Whether the best of those that are ranked can be believed."""
        c, fair = self.caution, self.judge.fair
        kept = self._rivalled(kept)
        best = kept[0] if kept else None
        unsure = self.cold or not self._whole
        if best is None or not fair(best.judged, c.fair if unsure else c.poor):
            if self._searched is None:  # else what a search has found so far is kept for its end
                self.all, self._whole = [], False
            why = "no place on the map looks like what the LiDAR sees"
            return Verdict(None, 0.0, False, why)
        lead = best.total - kept[1].total if len(kept) > 1 else math.inf
        back = next((h for h in kept if self.before and same(h.pose, self.before)), None)
        if back is not None and best.total - back.total < c.margin:
            best, lead, wanted = back, math.inf, 0.0
        else:
            wanted = self._wanted(best, lead)
        sigma = math.sqrt(float(np.linalg.eigvalsh(best.covariance[:2, :2])[-1]))
        far = self._far(best.pose)
        # the map may be wrong here, where all of it has been searched and nothing comes near
        only = self._whole and not far and lead >= 2.0 * c.margin
        # or nobody moved it, and nothing that was found elsewhere makes up for that
        stayed = lead >= c.margin and self._stays(best)
        poor = only or (stayed and self._whole)
        strange = far or self._odds > 0.0
        glimpsed = far and (self._views < c.views or not self._complete)
        why = ""
        if lead < wanted or glimpsed:
            some = f"{len(kept)}" if self._complete else "many"
            why = f"{some} places on the map look alike: drive on a little"
            if self.moved:
                why = "the robot was moved, or something new stands here"
            elif lead >= wanted and self._complete:
                why = "one view is not enough to be sure: drive on a little"
        elif (
            not fair(best.judged, c.poor if poor else c.good)
            or best.judged.agree < (c.whole if far else c.poor if poor else c.seen)
            or (best.judged.log < c.least and not stayed and (strange or lead < 3.0 * c.margin))
            or (best.judged.told < 0.5 * len(self.lidar.beams) and not stayed)
        ):
            why = "too much of what the LiDAR sees is not on the map"
        elif sigma > c.sure and best is not back:
            why = "too few features are in view to say where along them the robot is"
        return Verdict(best, lead, only or stayed, why)

    def _consider(
        self, guess: Pose, prior: Floats | None, points: Floats, across: Floats, ranges: Floats,
        lost: bool,
    ) -> float:  # fmt: skip
        """Match a candidate, and keep it as a hypothesis where it fits. prior: (3, 3), how well it
        is known, as information; None: hardly. How likely it is."""
        care = self.judge.care
        if prior is None:
            prior, care = np.diag([1.0, 1.0, 4.0]), care._replace(reach=0.6, rounds=30)
        fit = align(self.known.surfaces, points, across, guess, prior, care)
        judged = self.judge.judge(fit.pose, ranges)
        if not self._possible(compose(fit.pose, self._base), judged, 0.05):
            return -1e3
        joint = joined(np.diag([0.3, 0.3, 0.1]) ** 2, UNKNOWN)
        covariance = updated(joint, fit.information)[:3, :3]
        pose = compose(fit.pose, self._base)
        new = self.judge.weighed(judged)
        for other in self.all:
            if same(other.pose, pose):
                if new > other.latest:
                    other.pose, other.covariance = pose, covariance
                    other.latest, other.judged = new, judged
                return -1e3  # nothing new
        # it must fit what was seen from the places before: to come late is no advantage
        before = self._until_now(pose)
        if self.cold:
            before = sum(
                self.judge.judge(compose(fit.pose, view.back), view.ranges).weighed
                for view in self._earlier
            )
        found = Hypothesis(pose, covariance, before, new, judged)
        # only once it is lost: a keyframe may have been taken while somebody pushed, and before
        # that the map is asked
        found.witnessed = self.alarm.witnessed(pose) if lost else 0.0
        self.all.append(found)
        return before + new

    def _until_now(self, pose: Pose) -> float:
        """How likely all scans since it is lost are, had the robot come to this pose."""
        seen = [
            share * self.judge.weighed(self.judge.judge(compose(pose, back), ranges, 2))
            for back, ranges, share in self._past
        ]
        whole = sum(share for _, _, share in self._past)
        return sum(seen) * self._weight / whole if seen else 0.0

    def _possible(self, pose: Pose, judged: Judgement, more: float = 0.0) -> bool:
        """Whether the robot may be there, by one scan alone; where it last was, the map may be
        wrong. more: that is asked of a new one."""
        left = self._left
        here = left is not None and math.hypot(left.x - pose.x, left.y - pose.y) < 0.5
        if here and judged.agree > self.caution.poor:
            return True  # a wall that is gone may be driven through
        fits = judged.agree > 0.35 + more and judged.through < 0.4 - more
        return fits and free_at(self.known, pose.x, pose.y)

    def _strayed(self, one: Hypothesis) -> float:
        """How far it is from where the robot would be had nobody moved it, as squared sigmas."""
        if self._left is None:
            return 0.0
        left = self._left
        off = np.array([one.pose.x - left.x, one.pose.y - left.y, wrap(one.pose.psi - left.psi)])
        spread = self._left_joint[:3, :3] + one.covariance + np.diag([0.1, 0.1, 0.05]) ** 2
        return float(off @ np.linalg.solve(spread, off))

    def _rivalled(self, kept: list[Hypothesis]) -> list[Hypothesis]:
        """Of those that are ranked, without any that explains less of the scan than the place where
        the robot left off, while no scan shows that it was moved: where the map knows little,
        little speaks against a place."""
        own = next((h for h in kept if self._strayed(h) < 9.0), None)
        if own is None or self._odds == 0.0:
            return kept
        least = own.judged.agree * own.judged.told
        return [h for h in kept if h is own or h.judged.agree * h.judged.told >= least]

    def _stays(self, one: Hypothesis) -> bool:
        """Whether it is where the robot left off, and that can be: no scan has contradicted another
        since it knew that place, or none of it but a thing, and then the whole map was searched."""
        if self._strayed(one) >= 9.0:
            return False
        if self._odds > 0.0:
            return True
        c = self.caution
        alike = one.judged.agree >= c.seen and one.witnessed > 2.0 * c.contradicted
        return self._knew and self._whole and alike

    def _prior(self, one: Hypothesis) -> float:
        """What where the robot was says to a hypothesis: that it stayed, that nobody carries it far
        in no time, and that who is pushed or dragged is hardly turned round."""
        c = self.caution
        if self._odds > 0.0:
            return -min(0.5 * self._strayed(one), self._odds)
        if self._left is None:
            return 0.0
        left, carried = self._left, 0.0
        if self._knew:
            farthest = c.near + 0.5 + c.pace * self.alarm.carried
            beyond = math.hypot(one.pose.x - left.x, one.pose.y - left.y) - farthest
            carried = min(0.5 * (max(beyond, 0.0) / c.put) ** 2, c.unmoved)
        if self.everywhere:
            return -carried
        turned = wrap(one.pose.psi - left.psi) / c.turned
        return -carried - min(0.5 * turned**2, 0.25 * c.margin)

    def _far(self, pose: Pose) -> bool:
        """Whether the robot can hardly have been moved there: then nothing else speaks for it."""
        if self.cold:
            return True
        near = [p for p in (self._left, self.before) if p is not None]
        reach = self.caution.near + 0.5
        return bool(near) and all(math.hypot(p.x - pose.x, p.y - pose.y) > reach for p in near)

    def _wanted(self, best: Hypothesis, lead: float) -> float:
        """The lead in log likelihood that makes the best hypothesis believed."""
        c = self.caution
        half = 0.5 * c.margin
        self._led = (self._led + 1 if best is self._leading else 1) if lead >= half else 0
        self._leading = best
        if self.moved:
            return half if self._led >= c.settled else math.inf
        if self.cold:
            return c.margin
        driven = self._way >= c.travelled or self._turned >= 2.0 * c.travelled
        enough = driven or self._led >= c.steady or not self.everywhere
        return half if enough else c.margin


def same(a: Pose, b: Pose) -> bool:
    """Whether two hypotheses are one place."""
    return math.hypot(a.x - b.x, a.y - b.y) < 0.25 and abs(wrap(a.psi - b.psi)) < 0.2
