"""Thresholds of the localizer: when a pose on the map is believed, and when it is given up."""

from __future__ import annotations

import math
from typing import NamedTuple


class LocalizerParams(NamedTuple):
    """Thresholds of the localizer. Log likelihoods in nats."""

    fair: float = 0.8
    """A pose is doubtful if a smaller share of the unblocked beams agrees,"""
    blocked: float = 0.75
    """or if a larger share of the beams is blocked by unmapped objects,"""
    unlikely: float = -20.0
    """or if the log likelihood of the scan is less."""
    patience: int = 3
    """Doubtful scans in a row that mean lost."""
    odd: float = -4.0
    """As many scans less likely than this start a check of places near by,"""
    drop: float = 0.4
    """or less likely by this than before. A place near by that fits better by this,"""
    alike: float = 0.5
    """and at most this worse than the pose did before, makes a move of the robot likely."""
    settled: int = 5
    """Scans without a competing place, after which it was moved; and contradicting scans after
    which the pose is checked."""
    pause: int = 8
    """Scans between two checks."""
    contradicted: float = -1.2
    """Log likelihood of a scan given the keyframe and odometry, below which it contradicts: at
    least one object is not where it was."""
    jolts: int = 2
    """Contradicting scans in a row that raise the alarm;"""
    frozen: int = 10
    """scans for which no newer keyframe is taken then, and"""
    alarmed: int = 30
    """scans for which the alarm lasts."""
    aged: int = 100
    """Largest age of a keyframe in scans: a gyro drift of 0.05 deg/s reaches the tolerance by
    then."""
    proven: float = 1.0
    """A pose that has fitted for this distance [m] is not given up for map errors while scans
    agree with each other,"""
    unheld: float = 5.0
    """until it has not fitted for this distance [m]: then the whole map is searched,"""
    elsewhere: int = 2
    """and the same place must be better in so many searches in a row."""
    poor: float = 0.25
    """Share of the unblocked beams below which the map is useless: the robot is lost without a
    search, and no search can find it."""
    rivals: int = 4
    """Nor is it given up for another place, unless that is better by `margin` in so many checks in
    a row,"""
    rivalled: float = 1.5
    """over this distance [m]."""
    trust: float = 3.0
    """Of the way driven, what the map has explained must not be less by more than this than what it
    has not [m]: else it may be the map of another building, and a place must hold for as long as
    none did. So far the one who gave map and start is trusted,"""
    most_trust: float = 10.0
    """and no way explained counts for more than this, so that a wrong map is noticed in the end;
    nor does one that was not, as long as a place was believed: that map may be out of date [m]."""
    refused: float = 16.0
    """Squared Mahalanobis distance from the prediction beyond which a match is rejected."""
    good: float = 0.9
    """A new pose is believed only if this share of the unblocked beams agrees,"""
    seen: float = 0.5
    """and this share of all,"""
    margin: float = 6.0
    """and it leads any other in log likelihood by this,"""
    travelled: float = 0.5
    """or by half of it after this distance [m] or twice the angle [rad],"""
    steady: int = 10
    """or by half of it in so many scans, since a standing robot would else stay lost. Less, one
    object, is within the map's errors."""
    certain: float = math.log(99.0)
    """Cold start: a place is believed if it is 99 times as likely as all others together,"""
    views: int = 4
    """and has held in so many separate views."""
    view: float = 0.5
    """Until then views this far apart [m, rad] are kept,"""
    kept: int = 6
    """so many, which new places must fit as well."""
    remembered: int = 8
    """Earlier scans that a place found later must fit."""
    whole: float = 0.75
    """Far from the last pose, and at a cold start, this share of all beams must agree: people near
    by occlude less than a quarter of the view,"""
    least: float = -12.0
    """and the log likelihood must exceed this, some four unmapped objects."""
    sure: float = 0.1
    """Largest standard deviation of a pose that is believed [m]."""
    drawn: float = 0.5
    """Distance over which the surface offset of the map is estimated [m]."""
    unmoved: float = 12.0
    """Prior log odds that the robot was not moved without contradicting scans, at its start or
    after `proven`: once in e^12, some hundred thousand."""
    put: float = 0.5
    """Standard deviation of a start pose that does not fit [m], and half of that in heading
    [rad]."""
    turned: float = 0.5
    """Standard deviation of the heading change of a pushed robot [rad]; costs at most a quarter of
    `margin`, since some one in five is carried."""
    pace: float = 1.6
    """Largest speed at which the robot is carried: walking speed of ISO 13855 [m/s]."""
    gap: float = 0.5
    """Longest time between scans in which it can not have been carried [s]."""
    near: float = 3.0
    """Radius of the first search around the last pose [m]."""
    hypotheses: int = 40
    """Places matched of a search near by, best first, and"""
    everywhere: int = 160
    """of a search of the whole map. If one of the last"""
    last: int = 10
    """fits, there may be more."""
    followed: int = 64
    """Hypotheses that are followed,"""
    judged: int = 8
    """so many at each scan, in turn."""
    refuted: float = 20.0
    """Log likelihood below the best at which a place is refuted. Nothing far off is believed while
    a place that is left out may be less than this worse."""
    places: int = 80
    """Places scored in one slice."""
    points: int = 360
    """Points of a sweep that are matched, at most."""


PARAMS = LocalizerParams()
"""Those in use."""
