"""Localizes the robot on a map by scan matching; detects being lost, and recovers.

*Tracking*: odometry foretells, matching corrects, and the whole scan is judged against the map.
What the wheels measure wrongly is estimated on the way (`match.odometry_covariance`): along a
corridor without features that error alone would add up.
*Lost*, when scans disagree with the map: all the map is searched, nearest places first, a slice
at a time. What is found are hypotheses. Each is followed as the robot moves, and one is believed
only when no other explains what was seen nearly as well: two rooms alike are not guessed between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between, compose, inverse
from cohelm.core.types import Floats, Pose, wrap
from cohelm.perceive.localize.global_search import Search, candidates, looked, search
from cohelm.perceive.localize.keyframe import Keyframe, agreement, usable
from cohelm.perceive.localize.localization_map import Judgement, LocalizationMap, free_at, judge
from cohelm.perceive.match.odometry_covariance import (
    UNKNOWN,
    Wheels,
    inverted,
    joined,
    moved,
    updated,
)
from cohelm.perceive.match.scan_matching import Fit, MatchParams, align, independent
from cohelm.perceive.match.surfaces import facing, moved as shifted, normals
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar


class Caution(NamedTuple):
    """When a pose is believed, and when no more."""

    fair: float = 0.8
    """A pose is doubted where fewer beams agree, of those nothing stands in front of,"""
    blocked: float = 0.75
    """or where more beams than this are blocked by what is not on the map,"""
    unlikely: float = -20.0
    """or where the scan's log likelihood is less."""
    patience: int = 3
    """So many doubtful scans in a row mean lost."""
    odd: float = -4.0
    """As many scans less likely than this: is there a place near by that fits better?"""
    drop: float = 0.4
    """Or less likely by this than they were. A place near by that fits by so much better,"""
    alike: float = 0.5
    """and no more than this worse than the old one did, makes it doubtful whether the robot was
    moved."""
    settled: int = 5
    """After as many scans with no other place that comes near, it was. As many that contradict the
    one before, and the pose is checked."""
    pause: int = 8
    """Which is asked again after so many scans."""
    contradicted: float = -1.2
    """A scan this unlikely after the one before, by the odometry between them: one thing at least
    is not where it was."""
    jolts: int = 2
    """So many such scans in a row, and the robot may have been moved;"""
    frozen: int = 10
    """For so many, no newer keyframe is taken, and"""
    alarmed: int = 30
    """for so many scans a better place may be that to which."""
    aged: int = 100
    """A keyframe is no older than so many scans: a gyro that drifts by 0.05 deg/s has turned by
    what scans are compared to by then."""
    proven: float = 1.0
    """A pose that has fitted for this way [m] is not given up for what the map shows wrong, while
    scans agree with each other,"""
    unheld: float = 5.0
    """before it has been so for this way [m]: then the whole map is searched for a better place,"""
    elsewhere: int = 2
    """and the same one must be better in so many searches in a row."""
    poor: float = 0.25
    """Where less than this share of what is unblocked fits, there is no map to speak of: then no
    search is needed to be lost, and none is enough to be found."""
    rivals: int = 4
    """Nor for another place, unless that fitted better by `margin` in so many checks in a row,"""
    rivalled: float = 1.5
    """over this way [m]."""
    refused: float = 16.0
    """A match this unlikely by what was foretold, as squared sigmas, is not believed."""
    good: float = 0.9
    """A new pose is believed only where as many beams agree, of those unblocked,"""
    seen: float = 0.5
    """and this share of all,"""
    margin: float = 6.0
    """and no other pose comes within this of its log likelihood,"""
    travelled: float = 0.5
    """or, with half that margin, after this way [m] or twice the angle [rad]."""
    steady: int = 10
    """or with half of it through as many scans: a robot that stands would else be lost for ever.
    Where two places differ by less, one thing, neither is ruled out: a map errs by as much."""
    views: int = 4
    """Switched on with no idea where it is, it must hold from so many places some way apart."""
    view: float = 0.5
    """Until then views so far apart [m, rad] are kept,"""
    kept: int = 6
    """so many, and what is found must fit them as well."""
    remembered: int = 8
    """While it is lost, a place that is found later must fit so many scans from before."""
    whole: float = 0.75
    """Far from where it was, or with no idea where that was, this share of all beams must agree:
    people near by hide less than a quarter of what is around,"""
    least: float = -12.0
    """and this log likelihood, which allows for some four things that are not on the map,"""
    sure: float = 0.1
    """Nor is a pose believed less certain than this standard deviation [m]."""
    drawn: float = 0.5
    """How far a map's surfaces lie from the middle of its cells is learnt over this way [m]."""
    unmoved: float = 12.0
    """Log odds that a robot is where it was told to start, or where its pose has fitted for
    `proven`: once in e^12, some hundred thousand, it is moved without scans that contradict each
    other."""
    put: float = 0.5
    """Where it does not look as told at the start, it may have been put down so far beside, one
    sigma [m], and turned by half of that [rad]."""
    turned: float = 0.5
    """Who is pushed or dragged is turned by this, one sigma [rad]; where he was turned farther, a
    place must make up for it by a quarter of `margin`, as of some five one is carried."""
    near: float = 3.0
    """After having been lost, the robot is looked for within this first [m]."""
    hypotheses: int = 40
    """So many places of a search near by are matched, best first, and"""
    everywhere: int = 160
    """of a search of the whole map. Where one of the last"""
    last: int = 10
    """fits, there were more."""
    followed: int = 64
    """So many are followed,"""
    judged: int = 8
    """so many at each scan, in turn. Where more are left out that are not"""
    refuted: float = 20.0
    """less likely than the best by this, as log likelihood, nothing far off is believed."""
    places: int = 80
    """Places looked at in one slice."""
    points: int = 360
    """Points of a sweep that are matched, at most."""


_SCATTER = 0.06
"""Of the points of scans about the surfaces of a map of which nothing has been learnt [m],"""
_LEAST_SCATTER = 0.02
"""and of any: an accurate LiDAR's."""

_BESIDE: Floats = np.diag([0.1, 0.1, 0.03]) ** 2
"""A match along a corridor may end so far beside; the next one is not held to it."""


class Located(NamedTuple):
    """pose: of the body in the map at the sweep's instant. covariance: (3, 3). share: of beams
    that agree with the map. reason: why it is lost, empty if it is not."""

    pose: Pose
    covariance: Floats
    share: float
    lost: bool
    reason: str


class _View(NamedTuple):
    """A scan from where the robot was, `back` from where it is now: points in the body frame then,
    and the whole scan's ranges."""

    back: Pose
    points: Floats
    ranges: Floats


@dataclass
class _Hypothesis:
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


@dataclass
class Locator:
    """Follows one robot on one map. `start` None: it may be anywhere."""

    known: LocalizationMap
    lidar: Lidar
    start: Pose | None = None
    care: MatchParams = field(default_factory=MatchParams)
    caution: Caution = field(default_factory=Caution)

    def __post_init__(self) -> None:
        self._odometry: Pose | None = None
        self._doubts = 0
        self._search: Search | None = None
        self._found: list[tuple[Pose, Floats | None]] = []
        self._base = Pose(0.0, 0.0, 0.0)  # odometry pose of the sweep that is searched with
        self._searched: tuple[Floats, Floats, Floats] | None = None
        self._hypotheses: list[_Hypothesis] = []
        self._way = self._turned = 0.0
        self._leg = Pose(0.0, 0.0, 0.0)  # on from where hypotheses were last judged afresh
        self._views = 0  # places some way apart that they were judged from before,
        self._weight = 0.0  # and how many of them tell something of their own
        self._past: list[tuple[Pose, Floats, float]] = []  # the last, from here, and their weights
        self._seen: Floats = np.empty(0)  # ranges of the scan before
        self._answered = False  # whether they are those of a whole search,
        self._all = False  # and that of the whole map
        self._tried: list[float] = []  # likelihoods of all that were matched
        self._full = False  # whether there may have been more
        self._behind: list[_View] = []  # of the last metres, the newest last; while cold only
        self._earlier: list[_View] = []  # of them, those that a search goes by beside its own
        self._complete = True  # whether no place that fits as well was left out
        self._waited = 0  # scans since then
        self._everywhere = self._cold = self.start is None
        self._told = False  # whether somebody has just said where it is
        self._before: Pose | None = None  # and where it believed to be until then
        self._odd = 0
        self._checking = False  # whether the search only checks a pose that is believed
        self._left: Pose | None = None  # where it would be by odometry, since it is lost
        self._moved = False  # whether that check has found one that fits as it used to
        self._leading: _Hypothesis | None = None  # the likeliest
        self._led = 0  # scans in which it led well
        self._usual = -math.inf  # log likelihood of scans, as they were before they were odd
        self._likely = 0.0  # log likelihood of the believed pose
        self._blank = 0.0  # by how much what ended where the map knows nothing made it less likely
        self._scatter = _SCATTER  # of points about their surfaces, as far as learnt [m]
        self._spread = 0.0  # how far those of scans are from what is usual, in the mean
        self._keyframe: Keyframe | None = None
        self._there = Pose(0.0, 0.0, 0.0)  # the believed pose at the keyframe
        self._older: tuple[Keyframe, Pose] | None = None  # both of the keyframe before
        self._fallen = 0  # scans in a row that are much less likely on the map than those before,
        self._level = -math.inf  # and the log likelihood of those
        self._witness: tuple[Keyframe, Pose] | None = None  # both as they were before the alarm
        self._jolts = self._alarm = self._aged = 0
        self._shaken = False  # whether scans contradicted each other when it began to be checked
        self._ranges: Floats = np.empty(0)  # of the newest scan
        self._fitting = self._unheld = 0.0  # ways since when the map has fitted, and has not [m]
        self._rivals = 0
        self._rival, self._rivalled = Pose(0.0, 0.0, 0.0), 0.0
        self._lead = self.caution.unmoved  # by which the believed pose was likelier than others
        self._odds = 0.0  # log odds that the robot is where it left off, since it is lost
        self._left_joint: Floats = np.empty((0, 0))  # and how sure that place is
        self._checked = 0.0  # log likelihood of the believed pose by the scan it is checked with
        self._elsewhere = 0  # searches of the whole map that found the same better place,
        self._other: Pose | None = None  # where the robot would be by now, had it been there
        pose = self.start or Pose(0.0, 0.0, 0.0)
        lost = self.start is None
        wide = np.diag([0.1, 0.1, 0.05]) ** 2 if self.start else np.diag([1e3, 1e3, 10.0])
        reason = "looking for the robot on the map" if lost else ""
        self._wheels = Wheels()
        self._joint: Floats = joined(wide, UNKNOWN)
        self._told_joint: Floats = self._joint  # of what errs independently only: what is told
        self.located = Located(pose, wide, 0.0, lost, reason)

    def place(self, pose: Pose, sigma: float = 0.3) -> None:
        """Somebody says where the robot is, within about sigma [m].

        It is believed, and checked at once against the places near by. Where the LiDAR contradicts
        it, what was believed before needs no proof but to fit.
        """
        wide = np.diag([sigma, sigma, 0.5 * sigma]) ** 2
        before, usual = None if self.located.lost else self.located.pose, self._usual
        self._forget()
        self._odometry = None
        self._believe(pose, wide, 0.0, 0.0)
        self._before, self._usual, self._told = before, usual, True

    def correct(self, sweep: DeskewedScan, odometry: Pose) -> Located:
        """Take in a sweep. odometry: the odometry pose at its instant."""
        step = between(self._odometry, odometry) if self._odometry else Pose(0.0, 0.0, 0.0)
        self._odometry = odometry
        step = self._wheels.corrected(step)
        self._base = compose(self._base, step)
        self._before = compose(self._before, step) if self._before else None
        self._other = compose(self._other, step) if self._other else None
        if self._left:
            self._left, self._left_joint = moved(self._left, self._left_joint, step)
        points, across = normals(sweep.points, sweep.beams, self.lidar.step)
        every = max(1, -(-len(points) // self.caution.points))
        # contiguous whatever `every` is: other strides are another function to compile
        points = np.ascontiguousarray(points[::every])
        mount = self.lidar.mount
        across = facing(points, np.ascontiguousarray(across[::every]), mount.x, mount.y)
        self._ranges = sweep.ranges
        if self._cold:
            self._look_back(step, sweep)
        self._compare(odometry, sweep.ranges, step)
        if self.located.lost:
            self._follow(step, sweep, points, across)
        else:
            self._track(step, sweep, points, across)
        return self.located

    def think(self) -> Located:
        """Use a moment for the search, where one is going on; about 3 ms."""
        if self._searched is None:
            return self.located
        points, across, ranges = self._searched
        if self._search is not None:
            self._search = looked(self._search, self.known, self.caution.places)
            if self._search.over:
                c = self.caution
                most = c.everywhere if self._everywhere else c.hypotheses
                found = candidates(self._search, most)
                self._full = len(found) == most
                self._found += [(pose, None) for pose in found]
                self._search = None
            return self.located
        for pose, prior in self._found[:4]:
            self._tried.append(self._consider(pose, prior, points, across, ranges))
        self._found = self._found[4:]
        if not self._found:
            self._searched, self._answered, self._waited = None, True, 0
            self._all = self._everywhere
            if self._cold:
                self._views = len(self._earlier)
                self._weight = float(self._views)
            # more places were found than were tried, where the last of them fit as well as the best
            last = self._tried[-self.caution.last :]
            close = 2.0 * self.caution.margin
            self._complete = not self._full or max(last) < max(self._tried) - close
            self._settle()
            if self.located.lost and not any(self._plausible(h.judged) for h in self._hypotheses):
                self._everywhere = self._cold or not self._everywhere
        return self.located

    def _look_back(self, step: Pose, sweep: DeskewedScan) -> None:
        """Keep the views of the last metres: a place that is thought of only now must fit them."""
        c, turn = self.caution, inverse(step)
        seen = [view._replace(back=compose(turn, view.back)) for view in self._behind]
        last = seen[-1].back if seen else None
        near = last and math.hypot(last.x, last.y) < c.view and abs(last.psi) < c.view
        if not near and usable(self.lidar, sweep.ranges):
            seen.append(_View(Pose(0.0, 0.0, 0.0), sweep.points, sweep.ranges))
        self._behind = seen[-c.kept :]

    def _compare(self, odometry: Pose, ranges: Floats, moved_by: Pose) -> None:
        """Ask whether this scan contradicts the keyframe; take a newer one where it does not.
        moved_by: since the scan before."""
        key, c = self._keyframe, self.caution
        step = between(key.odometry, odometry) if key else Pose(0.0, 0.0, 0.0)
        if key is not None:
            log = agreement(self.lidar, key.ranges, ranges, step)
            self._jolts = self._jolts + 1 if log < c.contradicted else 0
            if not self._alarm and self._jolts >= c.jolts:
                # where a lost robot is, nobody knows: what it saw there is no witness
                self._witness = None if self.located.lost else (key, self._there)
            elif not self._alarm and not self.located.lost:
                self._witness = None
            self._alarm = c.alarmed if self._jolts >= c.jolts else max(self._alarm - 1, 0)
            self._odds = 0.0 if self._alarm else self._odds
        self._aged += 1
        near = math.hypot(step.x, step.y) < 0.3 and abs(step.psi) < 0.3
        gone = key is None or not near or self._aged > c.aged
        held = 0 < self._jolts < c.frozen
        if gone and not held and usable(self.lidar, ranges):
            self._older = (key, self._there) if key is not None else None
            self._keyframe = Keyframe(odometry, ranges)
            self._there = compose(self.located.pose, moved_by)
            self._jolts = self._aged = 0

    def _refuted(self, pose: Pose) -> bool:
        """Whether the newest scan contradicts what was seen before the alarm, at a pose; nobody
        knows where that is not known. What does not was not moved: it is the map that is wrong.
        """
        if self._witness is None:
            return True
        key, there = self._witness
        log = agreement(self.lidar, key.ranges, self._ranges, between(there, pose))
        return log < self.caution.contradicted

    @property
    def _movable(self) -> bool:
        """Whether the robot may have been moved, or has not yet shown that it knows its place."""
        return self._alarm > 0 or self._fitting < self.caution.proven

    @property
    def _trust(self) -> float:
        """Log odds that the robot is where it believes to be: none where scans contradict each
        other, and what it was believed for until it has fitted for some way."""
        c = self.caution
        return 0.0 if self._alarm else c.unmoved if self._fitting >= c.proven else self._lead

    def _track(self, step: Pose, sweep: DeskewedScan, points: Floats, across: Floats) -> None:
        foretold, joint = moved(self.located.pose, self._joint, step)
        _, told = moved(self.located.pose, self._told_joint, step)
        for one in self._hypotheses:  # what a check has found so far
            one.pose, own = moved(one.pose, joined(one.covariance, joint[3:, 3:]), step)
            one.covariance = own[:3, :3]
        spread = joint[:3, :3]
        prior = inverted(spread)
        fit = align(self.known.surfaces, points, across, foretold, prior, self.care)
        judged = self._judge(fit.pose, sweep.ranges)
        c, way = self.caution, math.hypot(step.x, step.y)
        movable = self._movable
        fits = self._fits(judged)
        if movable and not fits:
            loose = np.diag([4.0, 4.0, 16.0])
            wider = self.care._replace(reach=0.6)
            other = align(self.known.surfaces, points, across, foretold, loose, wider)
            again = self._judge(other.pose, sweep.ranges)
            if again.log > judged.log + 1.0 and self._fair(again, c.good):
                fit, judged, fits = other, again, self._fits(again)
        self._fitting = self._fitting + way if fits else self._fitting
        self._unheld = 0.0 if fits else self._unheld + way
        astray = self._unheld > c.unheld
        doubtful = astray and not self._fair(judged, c.poor)
        if movable and not fits:
            doubtful = self._fitting < c.proven or self._refuted(fit.pose)
        self._doubts = self._doubts + 1 if not fits and doubtful else 0
        innovation = np.array([
            fit.pose.x - foretold.x, fit.pose.y - foretold.y, wrap(fit.pose.psi - foretold.psi),
        ])  # fmt: skip
        own = independent(self.known.surfaces, points, across, fit.pose, self.care, fit.rms)
        off = innovation @ own @ np.linalg.solve(np.eye(3) + told[:3, :3] @ own, innovation)
        # moved from where it was, or put elsewhere than was said: the place that fits is one of
        # those that may
        jumped = movable and off > c.refused
        if jumped and self._lead >= c.unmoved and self._fitting < c.proven:
            told = joined(told[:3, :3] + np.diag([c.put, c.put, 0.5 * c.put]) ** 2, told[3:, 3:])
        if self._doubts >= c.patience or jumped:
            self._forget()
            self._everywhere = False
            why = "what the LiDAR sees is not what the map shows here"
            self._leave(foretold, told, self._trust)
            self._joint = self._told_joint = joint
            self.located = Located(foretold, told[:3, :3].copy(), judged.agree, True, why)
            self._seek(points, across, sweep)
            self._found += [(fit.pose, None)] if jumped and self._searched else []
            return
        if not movable and off > c.refused:
            self._joint, self._told_joint = joint, told
            self.located = Located(foretold, told[:3, :3].copy(), judged.agree, False, "")
        else:
            self._wheels = self._wheels.learnt(joint, innovation)
            self._drawn(fit, way)
            self._joint = updated(joint, fit.information)
            new = min(1.0, max(way / self.care.correlated, 0.02)) if not movable else 1.0
            self._told_joint = updated(told, new * own)
            self.located = Located(
                fit.pose, self._told_joint[:3, :3].copy(), judged.agree, False, ""
            )
        self._fall(judged.log)
        odd = judged.log < max(c.odd, self._usual - max(c.drop, 3.0 * self._spread))
        if self._usual == -math.inf:
            self._usual, self._blank = judged.log, judged.log - judged.weighed
        if not odd or not movable:
            self._blank += 0.1 * (judged.log - judged.weighed - self._blank)
            self._spread += 0.01 * (abs(judged.log - self._usual) - self._spread)
            self._usual += 0.01 * (judged.log - self._usual)
        self._likely = self._weighed(judged)
        self._odd = self._odd + 1 if odd else 0
        self._rivalled += way
        due = self._odd >= c.patience and self._odd % c.pause == c.patience
        shaken = self._jolts >= c.settled or self._fallen >= c.patience
        if (due or self._told or astray or shaken) and not self._searched:
            self._everywhere, self._checking, self._shaken = astray, True, shaken
            self._checked = self._likely
            self._seek(points, across, sweep)
            self._told = self._told and self._searched is None

    def _fall(self, log: float) -> None:
        """Scans that are much less likely on the map, all at once: a robot that was moved along a
        corridor sees no contradiction. What was seen before decides as after others."""
        c = self.caution
        key = self._keyframe
        least = self._level - c.margin * (0.5 if self._level > c.odd else 2.0)
        self._fallen = self._fallen + 1 if log < least else 0
        if self._fallen > c.patience or self._level == -math.inf:
            self._level = log
        elif self._fallen == 0:
            self._level += 0.1 * (log - self._level)
        elif self._fallen == c.patience:
            if not self._alarm and key is not None:
                self._witness = (key, self._there) if self._aged > c.patience else self._older
            self._alarm = c.alarmed

    def _drawn(self, fit: Fit, way: float) -> None:
        """Learn how the map was drawn: a wall's surface is the middle of the cells that hits fell
        into, or the edge of cells that were filled. Walls on either side show it, for what moves
        the robot from one moves it to the other."""
        most = self.known.resolution
        learnt = min(way / self.caution.drawn, 0.1)
        new = self.care.offset + learnt * fit.before
        self.care = self.care._replace(offset=min(max(new, -most), most))
        if math.isfinite(fit.rms):
            scatter = self._scatter + learnt * (fit.rms - self._scatter)
            self._scatter = max(scatter, _LEAST_SCATTER)

    def _believe(
        self, pose: Pose, covariance: Floats, share: float, lead: float, proven: bool = False
    ) -> None:
        """Track from here on. lead: by which it was likelier than any other place. proven: nothing
        else on the map comes near it."""
        self._lead = min(max(lead, 0.0), self.caution.margin)
        self._cold, self._before = False, None
        self._behind, self._earlier = [], []
        self._joint = joined(covariance, self._joint[3:, 3:])
        self._told_joint = self._joint
        self._keyframe, self._older, self._witness = None, None, None
        self._alarm = self._jolts = 0
        self._fallen, self._level = 0, -math.inf
        self._left, self._odds = None, 0.0
        self._fitting, self._unheld = self.caution.proven if proven else 0.0, 0.0
        self._rivals = self._elsewhere = 0
        self._other = None
        self.located = Located(pose, covariance, share, False, "")

    def _follow(self, step: Pose, sweep: DeskewedScan, points: Floats, across: Floats) -> None:
        """Lost: move all hypotheses along, and see which still hold."""
        pose, self._joint = moved(self.located.pose, self._joint, step)
        self.located = self.located._replace(pose=pose, covariance=self._joint[:3, :3].copy())
        self._leg = compose(self._leg, step)
        way, turned = math.hypot(self._leg.x, self._leg.y), abs(self._leg.psi)
        # a scan from the same spot says nothing new
        fresh = way + 0.5 * turned > 0.15 and not any(h.stale for h in self._hypotheses)
        oldest = sorted(self._hypotheses, key=lambda h: -h.age)[: self.caution.judged]
        # what the map gets wrong is wrong alike for some way
        share = 1.0 if self._cold else min(1.0, (way + 0.5 * turned) / self.care.correlated)
        back = inverse(step)
        self._past = [(compose(back, pose), seen, by) for pose, seen, by in self._past]
        if fresh and self._hypotheses:
            self._past = [*self._past, (back, self._seen, share)][-self.caution.remembered :]
        self._seen = sweep.ranges
        for one in self._hypotheses:
            one.age += 1
            if fresh:
                one.log, one.stale = one.log + share * one.latest, True
            foretold, joint = moved(one.pose, joined(one.covariance, self._joint[3:, 3:]), step)
            one.pose, one.covariance = foretold, joint[:3, :3].copy()
        for one in oldest:
            prior = inverted(one.covariance + _BESIDE)
            fit = align(self.known.surfaces, points, across, one.pose, prior, self.care)
            joint = joined(one.covariance, self._joint[3:, 3:])
            one.pose, one.covariance = fit.pose, updated(joint, fit.information)[:3, :3]
            one.judged = self._judge(fit.pose, sweep.ranges)
            new = self._weighed(one.judged)
            one.latest = new if one.stale else max(0.9 * one.latest + 0.1 * new, new)
            one.witnessed = self._witnessed(one.pose)
            one.age, one.stale = 0, False
        if fresh:
            self._way, self._turned = self._way + way, self._turned + turned
            self._leg = Pose(0.0, 0.0, 0.0)
            self._views += bool(self._hypotheses)
            self._weight += share if self._hypotheses else 0.0
        self._waited += 1
        if self._answered and self._hypotheses:
            self._settle()
        tired = not self._hypotheses or self._waited >= self.caution.pause
        if self._cold and self._complete and self._hypotheses:
            tired = False  # all that can be are followed
        if self.located.lost and self._searched is None and tired:
            self._seek(points, across, sweep)

    def _seek(self, points: Floats, across: Floats, sweep: DeskewedScan) -> None:
        """Begin a search: near by at first, then everywhere."""
        if len(points) < 20:
            if self.located.lost:
                self.located = self.located._replace(reason="the LiDAR sees too little")
            self._checking = False
            return
        places = self.known.places
        if not self._everywhere:
            # not by the likeliest of what was found, which may be anywhere
            here = self._left or self.located.pose
            near = np.hypot(places[:, 0] - here.x, places[:, 1] - here.y) < self.caution.near
            places = places[near]
        # what was seen from nearer by than this says nothing more
        self._earlier = [
            v for v in self._behind if math.hypot(v.back.x, v.back.y) + 0.5 * abs(v.back.psi) > 0.15
        ]
        all_ = [sweep.points, *(shifted(v.back, v.points, True) for v in self._earlier)]
        self._search = search(np.vstack(all_), places)
        # where it is taken to be competes with all others
        own = [] if self._cold else [self.located.pose]
        own += [p for p in (self._left, self._before) if p is not None]
        self._found = [(pose, None) for pose in own]
        if own:  # where odometry leads is not looked for half a metre beside
            joint = self._left_joint if self._left else self._joint
            self._found += [(self._left or self.located.pose, inverted(joint[:3, :3]))]
        self._searched = (points, across, sweep.ranges)
        self._tried = []
        if self._cold and not self._complete:  # some that can be are not followed: anew
            self._hypotheses = []
        self._base = Pose(0.0, 0.0, 0.0)
        if not self._hypotheses:
            self._way = self._turned = 0.0
            self._leg = Pose(0.0, 0.0, 0.0)
            self._views, self._weight = 0, 0.0
            self._past, self._seen = [], sweep.ranges

    def _consider(
        self, guess: Pose, prior: Floats | None, points: Floats, across: Floats, ranges: Floats
    ) -> float:  # fmt: skip
        """Match a candidate, and keep it as a hypothesis where it fits. prior: (3, 3), how well it
        is known, as information; None: hardly. How likely it is."""
        care = self.care
        if prior is None:
            prior, care = np.diag([1.0, 1.0, 4.0]), care._replace(reach=0.6, rounds=30)
        fit = align(self.known.surfaces, points, across, guess, prior, care)
        judged = self._judge(fit.pose, ranges)
        if not self._possible(compose(fit.pose, self._base), judged, 0.05):
            return -1e3
        joint = joined(np.diag([0.3, 0.3, 0.1]) ** 2, UNKNOWN)
        covariance = updated(joint, fit.information)[:3, :3]
        pose = compose(fit.pose, self._base)
        new = self._weighed(judged)
        for other in self._hypotheses:
            if _same(other.pose, pose):
                if new > other.latest:
                    other.pose, other.covariance = pose, covariance
                    other.latest, other.judged = new, judged
                return -1e3  # nothing new
        # it must fit what was seen from the places before: to come late is no advantage
        before = self._until_now(pose)
        if self._cold:
            before = sum(
                self._judge(compose(fit.pose, view.back), view.ranges).weighed
                for view in self._earlier
            )
        found = _Hypothesis(pose, covariance, before, new, judged)
        found.witnessed = self._witnessed(pose)
        self._hypotheses.append(found)
        return before + new

    def _until_now(self, pose: Pose) -> float:
        """How likely all scans since it is lost are, had the robot come to this pose."""
        seen = [
            share * self._weighed(self._judge(compose(pose, back), ranges, 2))
            for back, ranges, share in self._past
        ]
        whole = sum(share for _, _, share in self._past)
        return sum(seen) * self._weight / whole if seen else 0.0

    def _settle(self) -> None:
        """Drop what is refuted; believe one if no other is near it; else go on, or look again."""
        for one in self._hypotheses:
            one.prior = self._prior(one)
        alive = [h for h in self._hypotheses if self._possible(h.pose, h.judged)]
        alive.sort(key=lambda h: -h.total)
        kept: list[_Hypothesis] = []
        for one in alive:
            close = kept and kept[0].total - one.total > self.caution.refuted
            if not close and not any(_same(one.pose, other.pose) for other in kept):
                kept.append(one)
        self._hypotheses = kept[: self.caution.followed]
        self._complete = self._complete and len(kept) <= self.caution.followed
        best = kept[0] if kept else None
        if self._checking and self._holds(best):
            return
        unsure = self._cold or not self._all
        least = self.caution.fair if unsure else self.caution.poor
        if best is None or not self._fair(best.judged, least):
            if self._searched is None:  # else what a search has found so far is kept for its end
                self._hypotheses = []
            why = "no place on the map looks like what the LiDAR sees"
            self.located = self.located._replace(lost=True, reason=why)
            return
        c = self.caution
        lead = best.total - kept[1].total if len(kept) > 1 else math.inf
        back = next((h for h in kept if self._before and _same(h.pose, self._before)), None)
        if back is not None and best.total - back.total < c.margin:
            best, lead, wanted = back, math.inf, 0.0
        else:
            wanted = self._wanted(best, lead)
        sigma = math.sqrt(float(np.linalg.eigvalsh(best.covariance[:2, :2])[-1]))
        far = self._far(best.pose)
        # the map may be wrong here, where all of it has been searched and nothing comes near
        only = self._all and not far and lead >= 2.0 * c.margin
        # or nobody moved it, and nothing that was found elsewhere makes up for that
        stayed = self._odds > 0.0 and lead >= c.margin and self._strayed(best) < 9.0
        poor = only or (stayed and self._all)
        strange = far or self._odds > 0.0
        glimpsed = far and (self._views < c.views or not self._complete)
        if lead < wanted or glimpsed:
            some = f"{len(kept)}" if self._complete else "many"
            why = f"{some} places on the map look alike: drive on a little"
            if self._moved:
                why = "the robot was moved, or something new stands here"
            elif lead >= wanted and self._complete:
                why = "one view is not enough to be sure: drive on a little"
        elif (
            not self._fair(best.judged, c.poor if poor else c.good)
            or best.judged.agree < (c.whole if far else c.poor if poor else c.seen)
            or (best.judged.log < c.least and not stayed and (strange or lead < 3.0 * c.margin))
            or (best.judged.told < 0.5 * len(self.lidar.beams) and not stayed)
        ):
            why = "too much of what the LiDAR sees is not on the map"
        elif sigma > c.sure and best is not back:
            why = "too few features are in view to say where along them the robot is"
        else:
            self._forget()
            self._believe(best.pose, best.covariance, best.judged.agree, lead, only or stayed)
            return
        self.located = Located(best.pose, best.covariance, best.judged.agree, True, why)

    def _possible(self, pose: Pose, judged: Judgement, more: float = 0.0) -> bool:
        """Whether the robot may be there, by one scan alone; where it last was, the map may be
        wrong. more: that is asked of a new one."""
        left = self._left
        here = left is not None and math.hypot(left.x - pose.x, left.y - pose.y) < 0.5
        if here and judged.agree > self.caution.poor:
            return True  # a wall that is gone may be driven through
        fits = judged.agree > 0.35 + more and judged.through < 0.4 - more
        return fits and free_at(self.known, pose.x, pose.y)

    def _strayed(self, one: _Hypothesis) -> float:
        """How far it is from where the robot would be had nobody moved it, as squared sigmas."""
        if self._left is None:
            return 0.0
        left = self._left
        off = np.array([one.pose.x - left.x, one.pose.y - left.y, wrap(one.pose.psi - left.psi)])
        spread = self._left_joint[:3, :3] + one.covariance + np.diag([0.1, 0.1, 0.05]) ** 2
        return float(off @ np.linalg.solve(spread, off))

    def _prior(self, one: _Hypothesis) -> float:
        """What where the robot was says to a hypothesis: that it stayed, or that who is pushed or
        dragged is hardly turned round."""
        c = self.caution
        if self._odds > 0.0:
            return -min(0.5 * self._strayed(one), self._odds)
        if self._left is None or self._everywhere:
            return 0.0
        return -min(0.5 * (wrap(one.pose.psi - self._left.psi) / c.turned) ** 2, 0.25 * c.margin)

    def _witnessed(self, pose: Pose) -> float:
        """What was seen before scans began to contradict each other says to the newest scan, had
        the robot been moved to this pose: it stood there without the map, however poor that is.
        Only once it is lost: it may have been taken while somebody pushed, and before that the map
        is asked."""
        if self._witness is None or not self.located.lost:
            return 0.0
        key, there = self._witness
        return agreement(self.lidar, key.ranges, self._ranges, between(there, pose))

    def _far(self, pose: Pose) -> bool:
        """Whether the robot can hardly have been moved there: then nothing else speaks for it."""
        left, told = self._left, self._before
        if self._cold:
            return True
        near = [p for p in (left, told) if p is not None]
        reach = self.caution.near + 0.5
        return bool(near) and all(math.hypot(p.x - pose.x, p.y - pose.y) > reach for p in near)

    def _holds(self, best: _Hypothesis | None) -> bool:
        """Whether the believed pose stands up to what a check of it has found; that ends it."""
        c = self.caution
        self._checking = False
        if self._everywhere:
            return self._holds_on_the_map()
        if self._shaken and self._hypotheses:
            best = max(self._hypotheses, key=lambda h: h.latest + self._gained(h.pose))
        if best is not None and not _same(best.pose, self.located.pose):
            gained = self._gained(best.pose)
            lead = best.latest + gained - self._likely
            better = lead > c.margin
            clearly = max(c.drop, self._trust)
            own = next((h for h in self._hypotheses if _same(h.pose, self.located.pose)), None)
            turned = abs(wrap(best.pose.psi - self.located.pose.psi)) > 2.0 * c.turned
            if turned and own is not None and own.judged.log > self._usual - c.alike:
                clearly = max(clearly, 0.5 * c.margin)  # it fits: it may be who walks about
            as_before = lead > clearly and best.judged.log > self._usual - c.alike
            if self._shaken and lead > 0.5 * c.margin:
                as_before = self._plausible(best.judged)
            if self._movable:
                if (gained > 0.0 or self._shaken or not self._alarm) and (better or as_before):
                    self._moved = as_before and not better
                    self._leave(self.located.pose, self._told_joint, 0.0)
                    return False
            elif better and self._rivals_again(best):
                return False
        else:
            self._rivals = 0
        self._hypotheses, self._before = [], None
        return True

    def _holds_on_the_map(self) -> bool:
        """Whether no place of the whole map fits better, now that this one has not for a while.

        Where the map is as wrong everywhere else, it is the map that is wrong; and where another
        place fits better each time, too: the robot would have gone on with the right one.
        """
        c, other = self.caution, self._other
        better = [
            h for h in self._hypotheses
            if h.latest > self._checked + c.margin and not _same(h.pose, self.located.pose)
        ]  # fmt: skip
        if other and any(_same(h.pose, other) for h in better):
            self._elsewhere += 1
        else:
            self._elsewhere = 1 if better else 0
            self._other = max(better, key=lambda h: h.latest).pose if better else None
        if self._elsewhere < c.elsewhere:
            self._unheld = c.unheld - 1.0 if self._elsewhere else 0.0
            self._hypotheses, self._before = [], None
            return True
        self._leave(self.located.pose, self._told_joint, 0.0)
        return False

    def _leave(self, pose: Pose, joint: Floats, odds: float) -> None:
        """Keep where it was when it became lost, and the log odds that it still is."""
        self._left, self._left_joint, self._odds = pose, joint, odds

    def _gained(self, pose: Pose) -> float:
        """By how much likelier the newest scan is after what was seen before the alarm, had the
        robot been moved to this pose, than where it takes itself to be."""
        if self._witness is None or not self._alarm:
            return 0.0
        key, there = self._witness
        here = agreement(self.lidar, key.ranges, self._ranges, between(there, self.located.pose))
        return agreement(self.lidar, key.ranges, self._ranges, between(there, pose)) - here

    def _rivals_again(self, best: _Hypothesis) -> bool:
        """Whether another place has been found better often enough, and for long enough: the same
        one, though now and then yet another may be better than that."""
        c = self.caution

        def off(pose: Pose) -> float:
            seen = between(self.located.pose, pose)
            return math.hypot(seen.x - self._rival.x, seen.y - self._rival.y)

        better = [h for h in self._hypotheses if h.latest > self._likely + c.margin]
        nearest = min(better, key=lambda h: off(h.pose), default=best)
        if self._rivals == 0 or off(nearest.pose) > 0.5:
            self._rivals, self._rivalled, nearest = 0, 0.0, best
        self._rival = between(self.located.pose, nearest.pose)
        self._rivals += 1
        return self._rivals >= c.rivals and self._rivalled >= c.rivalled

    def _wanted(self, best: _Hypothesis, lead: float) -> float:
        """The lead in log likelihood that makes the best hypothesis believed."""
        c = self.caution
        half = 0.5 * c.margin
        self._led = (self._led + 1 if best is self._leading else 1) if lead >= half else 0
        self._leading = best
        if self._moved:
            return half if self._led >= c.settled else math.inf
        if self._cold:
            return c.margin
        driven = self._way >= c.travelled or self._turned >= 2.0 * c.travelled
        enough = driven or self._led >= c.steady or not self._everywhere
        return half if enough else c.margin

    def _forget(self) -> None:
        self._search, self._searched, self._found, self._hypotheses = None, None, [], []
        self._answered = False
        self._doubts, self._odd, self._checking = 0, 0, False
        self._moved, self._led, self._usual = False, 0, -math.inf
        self._told = False

    def _judge(self, pose: Pose, ranges: Floats, every: int = 1) -> Judgement:
        offset = self.care.offset
        return judge(self.known, self.lidar, pose, ranges, every, offset, self._scatter)

    def _weighed(self, judged: Judgement) -> float:
        """How likely a place is beside others: where much of the view ended where the map knows
        nothing until now, as much of it may."""
        unknown = max(judged.log - judged.weighed - self._blank, 0.0)
        return judged.log + judged.closer - unknown

    def _fits(self, judged: Judgement) -> bool:
        """Whether a tracked pose may be kept; after a jolt, less is excused than before."""
        c = self.caution
        least = c.unlikely
        if self._alarm > 0 and self._usual > -math.inf:
            least = max(least, self._usual - max(c.margin, 4.0 * self._spread))
        return judged.log >= least and self._fair(judged, c.fair)

    def _plausible(self, judged: Judgement) -> bool:
        return judged.log >= self.caution.least and self._fair(judged, self.caution.fair)

    def _fair(self, judged: Judgement, least: float) -> bool:
        unblocked = 1.0 - judged.short
        c = self.caution
        return judged.told >= 10 and judged.agree >= least * unblocked and judged.short < c.blocked


def _same(a: Pose, b: Pose) -> bool:
    return math.hypot(a.x - b.x, a.y - b.y) < 0.25 and abs(wrap(a.psi - b.psi)) < 0.2
