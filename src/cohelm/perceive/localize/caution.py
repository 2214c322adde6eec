"""When a pose on the map is believed, and when no more: the numbers by which it is judged."""

from __future__ import annotations

import math
from typing import NamedTuple


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
    certain: float = math.log(99.0)
    """Switched on with no idea where it is, it believes a place that is 99 times as likely as all
    others together,"""
    views: int = 4
    """and has held from so many places some way apart."""
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
    pace: float = 1.6
    """Nobody carries the robot faster than a man walks: ISO 13855's speed of approach [m/s]."""
    gap: float = 0.5
    """In so long without a scan it may have been carried as well [s]."""
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
