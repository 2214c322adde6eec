"""The laws that an episode may be driven under: ours, those of a peer, and others' own."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import ModuleType

from cohelm.core.errors import CohelmError
from cohelm.core.plugins import plugin, plugins
from cohelm.core.trace import Trace
from cohelm.robot.model import RobotModel
from cohelm.study.campaign import apart, rvo
from cohelm.study.campaign.episode import LAWS, Episode, Interventions, traced
from cohelm.study.campaign.rvo import PEERS
from cohelm.study.controlled import Controller, ControllerFactory

GROUP = "cohelm.laws"
"""Entry points that name laws by others."""
_MUST_BE = "must be a function (robot, period) that returns a controller"


def is_own(law: str) -> bool:
    """Whether a law is not one of ours, but `package:factory` or an entry point."""
    return law not in LAWS


def by_others(law: str) -> bool:
    """Whether a law is a peer's or one's own: it drives apart, and says nothing of a filter."""
    return law in PEERS or is_own(law)


def factory(law: str) -> ControllerFactory:
    """What makes the law for a robot and a control period. CohelmError where there is none."""
    made: ControllerFactory = plugin(GROUP, law)
    if not callable(made):
        raise CohelmError(f"{law} {_MUST_BE}")
    return made


def check_made(law: str, case: Episode) -> None:
    """CohelmError where a law by others can not be made for a case: it would fail in each."""
    try:
        apart.check(partial(_made, case, law))
    except CohelmError as error:
        raise CohelmError(f"{law} {_MUST_BE}, and made none: {error}") from error


def check(law: str) -> None:
    """CohelmError where there is no such law here."""
    if law in PEERS:
        rvo.check()
    elif is_own(law):
        factory(law)


@cache
def own_code(law: str) -> str:
    """A digest of the code of a law by others: its package, or its module and what it has imported
    from the same folder. As of the first call: what a process has imported stays as it was."""
    factory(law)  # so that it is imported
    module, colon, _ = law.partition(":")
    name = (module if colon else plugins(GROUP)[law].module).partition(".")[0]
    digest = hashlib.sha256()
    for path in sorted(_files(sys.modules[name])):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _files(module: ModuleType) -> set[Path]:
    """The source files of a top-level module."""
    if hasattr(module, "__path__"):
        return {path for folder in module.__path__ for path in Path(folder).rglob("*.py")}
    named = [str(getattr(one, "__file__", None)) for one in [*sys.modules.values()]]
    loaded = {Path(name) for name in named if name.endswith(".py")}
    folder = Path(str(module.__file__)).parent
    return {path for path in loaded if path.parent == folder and path.is_file()}


def pieces(case: Episode, law: str, acted: Interventions) -> Iterator[Trace]:
    """The drive of a case under any law, piece by piece, at least to its arrival or time limit.

    acted: where what gate and monitors did is counted, where there are any.
    """
    if not by_others(law):
        return traced(case, law, acted)
    setup = replace(case.setup, pilot=None)
    if case.goal is not None:
        setup = replace(setup, near=case.goal.near)
    return iter((apart.drive(setup, partial(_made, case, law)),))


def _made(case: Episode, law: str) -> Controller:
    """A law by others for a case, of which it is given the true obstacles."""
    if law in PEERS:
        return rvo.Peer(case, law)
    setup = case.setup
    robot = RobotModel.of(case.robot.name, setup.outline, setup.limits, delay=setup.delay)
    made = factory(law)(robot, setup.dt)
    if not callable(made):  # pyright: ignore[reportUnnecessaryComparison]
        raise CohelmError(f"it returned {type(made).__name__}, which can not be called")
    return made
