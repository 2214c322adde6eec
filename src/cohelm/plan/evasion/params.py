"""Parameters and state of an evasion."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import Floats
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.limits import Limits, ramps, speeds

STEP = 0.1  # of the rollout of a motion [s]
HURRY = 1.6
"""An evasion may be faster than the reference by this factor."""
PATIENT, LONG = 10.0, 20.0
"""The addition to the time until it is noticed that a mover sets off counts whole in an evasion as
long as the first, and not at all in one as long as the second [s]."""


class EvasionParams(NamedTuple):
    """Parameters of the evasion of moving obstacles."""

    horizon: float = 3.0
    """Prediction horizon, see `horizon`; 0: no evasion, the robot stands and waits [s]."""
    period: float = 0.1
    """Between two evaluations, as a rule: they wait for scans, see `is_due` [s]."""
    speed: float = 0.8
    """Largest speed of an evasion [m/s]."""
    yaw_rate: float = 1.6
    """Largest yaw rate of an evasion [rad/s]."""
    clearance: float = 0.25
    """Clearance to a mover below which a motion has risk [m]."""
    standing_growth: float = 0.05
    moving_growth: float = 0.3
    growth_per_speed: float = 0.4
    most_growth: float = 0.6
    """Growth rate of the position uncertainty: the first for a standing mover, which may sway;
    for a moving one, which may turn, the second plus the third per m/s of its speed, at most the
    fourth [m/s]."""
    social_clearance: float = 0.4
    """Clearance to movers below which the path is not simply followed [m]."""
    risk_weight: float = 3.0
    """Cost of a second right beside a mover [m/s]."""
    ahead: float = 0.5
    """Risk counts also at a mover's position this long afterwards [s]."""
    slack: float = 0.1
    slack_growth: float = 0.15
    """A motion has risk where the filter's certificate would have less clearance left than the
    first, which grows by the second [m, m/s]."""
    turning: float = 0.8
    """How long the estimated acceleration of a mover lasts [s]."""
    hysteresis: float = 0.15
    """By how much another motion must be cheaper than the current one [m]."""
    static_clearance: float = 0.03
    """Required clearance to static obstacles [m]."""
    certified_for: float = 3.0
    """How long the filter is included in the rollout of a motion [s]."""
    certified_growth: float = 0.0
    """Share of the position uncertainty that is included there."""
    pass_right: float = 0.0
    """Width added to movers on the robot's left, so that it passes them on the right, as the
    paper's k_CBF does [m]."""
    sets_off_weight: float = 90.0
    """Cost of a second beside a mover that could reach the robot before it is out of the way, if
    it turned on the robot [m/s]."""
    sets_off_acceleration: float = 1.0
    """Largest acceleration of a mover that sets off, at most its max_acceleration [m/s^2]."""


class Evasion(NamedTuple):
    """The current evasion."""

    on: bool
    v: float
    omega: float
    """The requested twist while it is on [m/s, rad/s]."""
    then: float
    """The yaw rate after `turns` [rad/s]."""
    turns: float
    """How long v and omega are to be requested [s]."""
    after: float
    """The speed after `turns` [m/s]."""
    since: float
    """Time since the last evaluation [s]."""
    fresh: bool
    """Whether that had a new scan."""
    lasted: float
    """How long it has been on, less how long it was off after that, at most `LONG` [s]."""


NO_EVASION = Evasion(False, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, False, 0.0)

_SHORTEST, _LONGEST = 3.0, 6.0
"""Bounds of the horizon [s]: shorter, and movers are noticed late; longer, and the uncertainty of
where they will be, which grows by up to 0.6 m/s, is wider than any gap between them."""
_WIDE = 0.5  # radius of a wide mover [m]
_COMES_NEAR = 0.75  # how far one comes that sets off, without its counting less [m]


def adapted(params: EvasionParams, outline: Floats, limits: Limits) -> EvasionParams:
    """The parameters for a robot: its horizon, and how much movers that may set off count.

    The farther a wide mover comes that sets off at the robot while the robot leaves its way, the
    more movers are within that distance, as its square, and the longer they stay there. So each
    counts less by its cube: else their sum keeps a slow robot off its path. outline: (k, 2) [m].
    """
    (speed, _), (push, _) = speeds(limits), ramps(limits)
    leaving = _time_from_rest(_out_of_way(outline), speed, push)
    comes = 0.5 * params.sets_off_acceleration * leaving * leaving
    weight = params.sets_off_weight * (_COMES_NEAR / max(comes, _COMES_NEAR)) ** 3
    return params._replace(horizon=horizon(outline, limits, params), sets_off_weight=weight)


def horizon(outline: Floats, limits: Limits, params: EvasionParams) -> float:
    """The prediction horizon with which a robot can leave the way of a wide mover [s].

    A quarter turn from rest, then straight on by its own reach, the mover's radius and the
    clearance. A horizon that ends before shows every motion of a slow robot as a contact, of which
    it can only choose the latest. outline: (k, 2) [m].
    """
    (speed, yaw_rate), (push, spin) = speeds(limits), ramps(limits)
    turning = _time_from_rest(0.5 * math.pi, min(params.yaw_rate, yaw_rate), spin)
    leaving = _time_from_rest(
        _out_of_way(outline) + params.clearance, min(params.speed, speed), push
    )
    return min(max(turning + leaving, _SHORTEST), _LONGEST)


def _out_of_way(outline: Floats) -> float:
    """How far a robot goes to leave the way of a wide mover [m]."""
    return farthest_corner(outline) + _WIDE


def _time_from_rest(distance: float, speed: float, acceleration: float) -> float:
    """How long a distance takes from rest [m, m/s, m/s^2, or of angles]."""
    if speed <= 0.0 or acceleration <= 0.0:
        return math.inf
    if speed * speed >= 2.0 * distance * acceleration:
        return math.sqrt(2.0 * distance / acceleration)
    return distance / speed + 0.5 * speed / acceleration
