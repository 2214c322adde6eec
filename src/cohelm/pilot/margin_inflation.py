"""Inflates the filter's margins by the position errors of a robot that drives by its sensors.

The guard assumes positions accurate to half of `hard_margin` (docs/guard.md, assumptions 2 and 6).
Larger errors have to be added to it, and to all clearances that plans use.
"""

from __future__ import annotations

from cohelm.law.guard.rules import Rules
from cohelm.pilot.replanning import ReplanParams
from cohelm.pilot.step import Settings
from cohelm.plan.path_planner import PathParams
from cohelm.robot.model import RobotModel

SLOP = 0.008
"""Largest error of the guard's predicted position of an outline corner on the physics twin, by
`benchmarks/twin.py` [m]."""


def noise(model: RobotModel) -> float:
    """How much nearer than measured an obstacle may be: one standard deviation of a range of the
    noisiest LiDAR, since a post may be hit by one beam; range sensors already report the nearest
    possible distance [m]."""
    return max((one.noise_m for one in model.lidars if not one.range_sensor), default=0.0)


def inflated_rules(rules: Rules, off: float) -> Rules:
    """Rules with margins for a larger position error, which half of `hard_margin` covers [m]."""
    more = 2.0 * off
    return rules._replace(
        hard_margin=rules.hard_margin + more, soft_margin=rules.soft_margin + more
    )


def inflated(
    settings: Settings, path_params: PathParams, replan_params: ReplanParams, off: float,
    noise: float,
) -> tuple[Settings, PathParams, ReplanParams]:  # fmt: skip
    """Settings and parameters of a pilot with inflated margins, for paths as for the guard.

    off: additional position error [m]; noise: its part that varies from scan to scan [m].
    """
    more = 2.0 * off
    return (
        settings._replace(rules=inflated_rules(settings.rules, off)),
        path_params._replace(clearance=path_params.clearance + more),
        replan_params._replace(
            accept=replan_params.accept + more, slack=replan_params.slack + 2.0 * noise
        ),
    )
