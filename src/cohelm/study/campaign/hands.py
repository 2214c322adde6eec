"""`hands`: recorded operators of another room drive in the paper's lab; `about` describes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import StickRecording
from cohelm.link import stick as sticks
from cohelm.scenario import build
from cohelm.sim.setup import Setup
from cohelm.study.campaign.data import csv_files
from cohelm.study.campaign.episode import Episode, sequence
from cohelm.study.campaign.lab import goal, limited, scenario

FOLDER = "stick"
"""Of recorded sticks, in a folder of data."""
_MOST_RUNS = 100


class Hands(NamedTuple):
    """The recordings found."""

    names: tuple[str, ...]
    """File and run."""
    recordings: tuple[StickRecording, ...]
    left_out: tuple[str, ...]
    """Files that are no sticks, a sentence each."""


def read(folder: Path) -> Hands:
    """Every run of every stick file (CSV, plain or gzip) in a folder, or in `stick` in it.

    Raises CohelmError where there is none.
    """
    inside, there = csv_files(folder, FOLDER)
    names: list[str] = []
    found: list[StickRecording] = []
    left_out: list[str] = []
    for file in there:
        try:
            runs = _runs(file)
        except CohelmError as error:
            left_out.append(f"not read as a stick: {error}")
            continue
        for run in runs:
            try:
                found.append(sticks.read(file, run))
                names.append(file.name if run is None else f"{file.name}#{run}")
            except CohelmError as error:
                left_out.append(f"not read as a stick: {error}")
    if not found:
        raise CohelmError(
            f"{inside}: no stick file in it can be read; give the folder of CSV files as "
            "docs/sticks.md describes them with --data"
        )
    return Hands(tuple(names), tuple(found), tuple(left_out))


def _runs(file: Path) -> Sequence[str | None]:
    """The runs of a file, however it numbers them; None: it holds a single one."""
    called = sticks.runs(file)
    if len(called) > _MOST_RUNS:
        raise CohelmError(
            f"{file}: holds {len(called)} runs, and {_MOST_RUNS} are the most: cut it"
        )
    return called or (None,)


def course() -> Setup:
    """The lab, with a centred stick."""
    return limited(build.setup(scenario()), 3.0)


def case(recorded_stick: Hands, course: Setup, seed: int, number: int) -> Episode:
    """Drive `number` of the campaign with this seed."""
    which = number % len(recorded_stick.recordings)
    recording = recorded_stick.recordings[which]
    begin = float(recording.times[0])
    if number >= len(recorded_stick.recordings):
        rng = sequence(seed, "hands", number)
        begin += float(rng.uniform(0.0, 0.5) * (recording.times[-1] - recording.times[0]))
    later = recording.times >= begin
    times = np.ascontiguousarray(recording.times[later] - begin)
    stick = StickRecording(times, recording.x[later], recording.psi[later])
    setup = replace(course, recorded_stick=stick, seed=number)
    return Episode("hands", number, recorded_stick.names[which], setup, goal(setup))
