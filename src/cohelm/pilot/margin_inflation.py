"""Inflates the filter's margins for a robot that lives by its sensors, by what these may be wrong.

The guard takes places to be as accurate as half of `clear` (docs/guard.md, assumptions 2 and 6).
What they are worse by has to be added to it, and to all clearances that plans count on.
"""

from __future__ import annotations

from cohelm.law.guard.step import Rules
from cohelm.pilot.replanning import ReplanParams
from cohelm.pilot.step import Settings
from cohelm.plan.path_planner import PathParams
from cohelm.robot.model import RobotModel

SLOP = 0.008
"""How far a corner of the outline comes to be from where the guard foretold it, at most, on the
physics twin as it comes: `benchmarks/twin.py` [m]."""


def noise(model: RobotModel) -> float:
    """How much nearer than it is seen a thing may be: one standard deviation of a range, of which
    a surface near by is many beams' mean, and a post's width just one's; of the noisiest LiDAR, as
    what a range sensor shows is told as near as it may be [m]."""
    return max((one.noise_m for one in model.lidars if not one.range_sensor), default=0.0)


def inflated_rules(rules: Rules, off: float) -> Rules:
    """Rules with room for what places are off by more: half of `clear` holds it [m]."""
    more = 2.0 * off
    return rules._replace(
        hard_margin=rules.hard_margin + more, soft_margin=rules.soft_margin + more
    )


def inflated(
    settings: Settings,
    path_params: PathParams,
    replan_params: ReplanParams,
    off: float,
    noise: float,
) -> tuple[Settings, PathParams, ReplanParams]:
    """All that a pilot goes by, with that room; ways are as much wider as the guard keeps.

    off: what places are off by more [m]; noise: how much of it is now there and now not [m].
    """
    more = 2.0 * off
    return (
        settings._replace(rules=inflated_rules(settings.rules, off)),
        path_params._replace(clearance=path_params.clearance + more),
        replan_params._replace(
            accept=replan_params.accept + more, slack=replan_params.slack + 2.0 * noise
        ),
    )
