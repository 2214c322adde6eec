"""How moving obstacles are evaded: what can be set, and what is being done."""

from __future__ import annotations

from typing import NamedTuple

STEP = 0.1  # from one look along a foretold motion to the next [s]
HURRY = 1.6
"""Who gets out of somebody's way may be so much faster than the reference."""


class EvasionParams(NamedTuple):
    """How moving obstacles are evaded."""

    horizon: float = 3.0
    """How far ahead is looked; 0: nobody is evaded, the robot only stands [s]."""
    period: float = 0.1
    """From one look to the next [s]."""
    speed: float = 0.8
    """Largest speed of an evasion [m/s]."""
    yaw_rate: float = 1.6
    """Largest yaw rate of one [rad/s]."""
    clearance: float = 0.25
    """Clearance to a moving obstacle below which a motion is the worse the nearer it comes [m]."""
    standing_growth: float = 0.05
    moving_growth: float = 0.3
    growth_per_speed: float = 0.4
    most_growth: float = 0.6
    """Doubt of where it will be grows by the first if it stands; else by the second, and by the
    third for each m/s of its speed, but by no more than the fourth [m/s]: who stands, sways; who
    walks, turns."""
    social_clearance: float = 0.4
    """Clearance below which the course is not simply followed [m]."""
    risk_weight: float = 3.0
    """How far the robot goes out of its way for a second right beside somebody [m/s]."""
    ahead: float = 0.5
    """Where a mover will be so long afterwards counts as near to him, too [s]."""
    slack: float = 0.1
    slack_growth: float = 0.15
    """A motion is the worse the less the filter has to spare when it looks for a way to stop, below
    the first, which grows by the second [m, m/s]."""
    turning: float = 0.8
    """For so long a mover is taken to go on changing his velocity as he does [s]."""
    hysteresis: float = 0.15
    """How much better than what is being done something else has to be [m]."""
    static_clearance: float = 0.03
    """Clearance to what stands [m]."""
    certified_for: float = 3.0
    """For so long a motion is foretold as the filter will let it be [s]."""
    certified_growth: float = 0.0
    """Share of the doubt that is counted in for that."""
    pass_right: float = 0.0
    """How much wider movers are taken to be on the robot's left, so that it passes them on the
    right, as the paper's k_CBF does [m]."""
    sets_off_weight: float = 180.0
    """How far the robot goes out of its way for a second beside somebody who would be there before
    it got away, if he turned on it [m/s]."""
    sets_off_acceleration: float = 1.0
    """With which he sets off, at most; less if he is capable of less [m/s^2]."""


class Evasion(NamedTuple):
    """What is being done about moving obstacles."""

    on: bool
    v: float
    omega: float
    """The twist asked for while it is on [m/s, rad/s]."""
    then: float
    """The yaw rate after `turns` [rad/s]."""
    turns: float
    """For how long omega is meant to be asked for [s]."""
    after: float
    """The speed after `turns` [m/s]."""
    left: int
    """Steps until the next look."""


NO_EVASION = Evasion(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
