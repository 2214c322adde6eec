"""One scenario, run, recorded as it goes, and scored."""

from __future__ import annotations

import json
from functools import reduce
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.core.trace import Trace
from cohelm.law.reference import tabulate
from cohelm.record.topics import Scene
from cohelm.record.write import Recorder
from cohelm.sim.run import Setup, pieces
from cohelm.study.experiments import Progress
from cohelm.study.metrics import Metrics, measure

RECORD = "record.mcap"
METRICS = "metrics.json"
SCENARIO = "scenario.yaml"
"""What a run leaves in its folder."""


def recorded(setup: Setup, folder: Path, told: Progress) -> Metrics:
    """Run a setup into a folder, which is made if need be.

    Interrupted (Ctrl-C) or on a full disk, what was written before stays readable. Raises
    CohelmError where the folder or a file in it can not be made.
    """
    make(folder)
    desired = tabulate(setup.reference, 0.1, int(setup.reference.duration / 0.1) + 1, False)
    scene = Scene(setup.outline, setup.around.walls, desired[:, :3])
    told("simulating", 0.0)
    done: list[Trace] = []
    with Recorder(folder / RECORD, scene) as recorder:
        for piece in pieces(setup):
            recorder.write(piece)
            done.append(piece)
            told("simulating and recording", 0.7 * len(done) * len(done[0]) / setup.steps)
    trace = reduce(Trace.joined, done)
    metrics = measure(trace)
    write(folder / SCENARIO, setup.scenario)
    write(folder / METRICS, json.dumps(metrics.as_dict(), indent=2, allow_nan=False) + "\n")
    told("drawing", 0.7)
    return metrics


def make(folder: Path) -> None:
    """Make a folder and those above it; CohelmError where that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CohelmError(
            f"the folder {folder} can not be made ({error.strerror}): choose another with --out"
        ) from error


def write(path: Path, text: str) -> None:
    """Write a text file; CohelmError where that is not possible."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CohelmError(
            f"{path} can not be written ({error.strerror}): free some space, or choose another "
            "folder with --out"
        ) from error
