"""Drives a chunk of a suite's episodes, in whichever process it is sent to."""

from __future__ import annotations

import hashlib
import traceback
from functools import cache
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.scenario.load import shipped
from cohelm.study.campaign import adversary
from cohelm.study.campaign.result import NOT_DRIVEN, EpisodeResult
from cohelm.study.campaign.scoring import run_episode
from cohelm.study.campaign.suites import Suite

ROOMS = (
    "core", "robot", "law", "perceive", "plan", "pilot", "link", "loop", "record", "sim",
    "scenario", "ros", "study",
)  # fmt: skip
"""Whose code a row can depend on."""


@cache
def code() -> str:
    """A digest of all the code, and the shipped scenarios, that an episode's row can depend on."""
    package = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((package / room).rglob("*")):
            if path.suffix in (".py", ".yaml"):
                digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    for name, path in shipped().items():  # lab and hands are driven in one of them
        digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def chunk(suite: Suite, law: str, numbers: tuple[int, ...]) -> list[EpisodeResult]:
    """The rows of some episodes under a law.

    An error that is not the user's is reported in the episode's row, so that one episode does not
    stop ten thousand.
    """
    return [_one(suite, law, number) for number in numbers]


def _one(suite: Suite, law: str, number: int) -> EpisodeResult:
    try:
        case, stick = suite.case(number), list[float]()
        if case.kind.startswith("search"):
            case = adversary.searched(case, law).case
            assert case.rollout is not None
            stick = case.rollout.attack.script.ravel().tolist()
        return run_episode(case, law)._replace(stick=stick)
    except CohelmError:
        raise
    except Exception as error:  # the campaign goes on; the report and the exit say so
        place = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        return NOT_DRIVEN._replace(suite=suite.name, law=law, episode=number, fault=fault)
