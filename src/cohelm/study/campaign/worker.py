"""Drives a chunk of a suite's episodes, in whichever process it is sent to."""

from __future__ import annotations

import hashlib
import subprocess
from functools import cache
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.scenario.load import shipped
from cohelm.study.campaign import adversary, laws
from cohelm.study.campaign.result import FAILS, NOT_DRIVEN, EpisodeResult, fault_of
from cohelm.study.campaign.scoring import run_episode
from cohelm.study.campaign.suites import Suite

ROOMS = (
    "core", "robot", "law", "perceive", "plan", "pilot", "link", "loop", "record", "sim",
    "scenario", "ros", "study",
)  # fmt: skip
"""Whose code a row can depend on."""

_PACKAGE = Path(__file__).resolve().parents[2]


@cache
def code() -> str:
    """A digest of all the code, and the shipped scenarios, that an episode's row can depend on."""
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((_PACKAGE / room).rglob("*")):
            if path.suffix in (".py", ".yaml"):
                digest.update(path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes())
    for name, path in shipped().items():  # lab and hands are driven in one of them
        digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def commit() -> str | None:
    """Git's name of the commit that this code is of, with `-dirty` where files have changed since;
    None where it is in no checkout of its own."""
    try:
        if not _git("ls-files", "__init__.py"):  # installed beside somebody's own code, say
            return None
        return _git("describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(*arguments: str) -> str:
    command = ("git", "-C", _PACKAGE, *arguments)
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def chunk(suite: Suite, law: str, numbers: tuple[int, ...]) -> list[EpisodeResult]:
    """The rows of some episodes under a law.

    An error that is not the user's is reported in the episode's row, so that one episode does not
    stop ten thousand; nor do those of a law of the user's own. CohelmError where there is no such
    law here.
    """
    laws.check(law)
    return [_one(suite, law, number) for number in numbers]


def _one(suite: Suite, law: str, number: int) -> EpisodeResult:
    try:
        case, stick = suite.case(number), list[float]()
        if case.kind.startswith("search"):
            case = adversary.searched(case, law).case
            assert case.rollout is not None
            stick = case.rollout.attack.script.ravel().tolist()
        return run_episode(case, law)._replace(stick=stick)
    except FAILS as error:  # the campaign goes on; the report and the exit say so
        if isinstance(error, CohelmError) and not laws.by_others(law):
            raise
        return NOT_DRIVEN._replace(
            suite=suite.name, plant=suite.plant, law=law, episode=number, fault=fault_of(error)
        )
