"""Drives a chunk of a suite's episodes, in whichever process it is sent to."""

from __future__ import annotations

import hashlib
import traceback
from dataclasses import replace
from functools import cache
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.core.plugins import plugin
from cohelm.core.trace import Trace
from cohelm.robot.model import RobotModel
from cohelm.study.campaign import adversary
from cohelm.study.campaign.episode import LAWS, Episode, Interventions, Law
from cohelm.study.campaign.result import NOT_DRIVEN, EpisodeResult
from cohelm.study.campaign.rvo import PEERS, peer_trace
from cohelm.study.campaign.scoring import run_episode, scored
from cohelm.study.campaign.suites import Suite
from cohelm.study.controlled import ControllerFactory, driven

_ROOMS = (
    "core", "robot", "law", "perceive", "plan", "pilot", "link", "loop", "sim", "scenario",
    "ros", "study/campaign",
)  # fmt: skip


@cache
def code() -> str:
    """A digest of all the code that an episode's row can depend on."""
    package = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for room in _ROOMS:
        for path in sorted((package / room).rglob("*")):
            if path.suffix in (".py", ".yaml"):
                digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def chunk(suite: Suite, law: Law, numbers: tuple[int, ...]) -> list[EpisodeResult]:
    """The rows of some episodes under a law.

    An error that is not the user's is reported in the episode's row, so that one episode does not
    stop ten thousand.
    """
    return [_one(suite, law, number) for number in numbers]


def _one(suite: Suite, law: Law, number: int) -> EpisodeResult:
    try:
        case = suite.case(number)
        if law in PEERS:
            return scored(
                case, law, iter((peer_trace(case, law),)), case.setup.limits, Interventions()
            )
        if is_own(law):
            return scored(
                case, law, iter((own_trace(case, law),)), case.setup.limits, Interventions()
            )
        if is_search(case):
            found = adversary.searched(case, law)
            script = found.case.rollout.attack.script if found.case.rollout else None
            stick = [] if script is None else script.ravel().tolist()
            return run_episode(found.case, law)._replace(stick=stick)
        return run_episode(case, law)
    except CohelmError:
        raise
    except Exception as error:  # the campaign goes on; the report and the exit say so
        place = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        return NOT_DRIVEN._replace(suite=suite.name, law=law, episode=number, fault=fault)


def is_search(case: Episode) -> bool:
    """Whether the case is one that is searched for."""
    return case.kind.startswith("search")


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


def own_trace(case: Episode, law: str) -> Trace:
    """The drive of a case under an external law, which is given the true obstacles."""
    setup = replace(case.setup, pilot=None)
    if case.goal is not None:
        setup = replace(setup, near=case.goal.near)
    robot = RobotModel.of(case.robot.name, setup.outline, setup.limits, delay=setup.delay)
    return driven(setup, factory(law)(robot, setup.dt))
