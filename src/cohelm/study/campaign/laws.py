"""The laws that an episode may be driven under: ours, those of a peer, and others' own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from cohelm.core.errors import CohelmError
from cohelm.core.plugins import plugin
from cohelm.core.trace import Trace
from cohelm.robot.model import RobotModel
from cohelm.study.campaign.episode import LAWS, Episode, Interventions, traced
from cohelm.study.campaign.rvo import PEERS, peer_trace
from cohelm.study.controlled import ControllerFactory, driven

GROUP = "cohelm.laws"
"""Entry points that name laws by others."""


def is_own(law: str) -> bool:
    """Whether a law is not one of ours, but `package:factory` or an entry point."""
    return law not in LAWS


def factory(law: str) -> ControllerFactory:
    """What makes the law for a robot and a control period. CohelmError where there is none."""
    made: ControllerFactory = plugin(GROUP, law)
    if not callable(made):
        raise CohelmError(f"{law} must be a function (robot, period) that returns a controller")
    return made


def pieces(case: Episode, law: str, acted: Interventions) -> Iterator[Trace]:
    """The drive of a case under any law, piece by piece, at least to its arrival or time limit.

    acted: where what gate and monitors did is counted, where there are any.
    """
    if law in PEERS:
        return iter((peer_trace(case, law),))
    if is_own(law):
        return iter((_own(case, law),))
    return traced(case, law, acted)


def _own(case: Episode, law: str) -> Trace:
    """The drive of a case under an external law, which is given the true obstacles."""
    setup = replace(case.setup, pilot=None)
    if case.goal is not None:
        setup = replace(setup, near=case.goal.near)
    robot = RobotModel.of(case.robot.name, setup.outline, setup.limits, delay=setup.delay)
    return driven(setup, factory(law)(robot, setup.dt))
