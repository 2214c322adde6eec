"""Runs the benchmarks that are scripts of their own, each of which prints a few lines."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
LIMIT_S = 120.0


@dataclass(frozen=True)
class Part:
    """One script: `title` in the tables, `options` for the whole study and for --quick."""

    title: str
    script: str
    options: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()


PARTS = (
    Part("The control loop in real time", "loop", ("--seconds", "20"), ("--seconds", "5")),
    Part("The physics twin", "twin", (), ("--quick",)),
    Part("Where the robot is, and its map", "perceive", (), ("--quick",)),
    Part("From the stick to the robot", "link", ("--seconds", "5"), ("--seconds", "2")),
    Part("The operator's page", "station", ("--seconds", "10"), ("--seconds", "3")),
    Part("Campaigns", "campaign", (), ("--quick",)),
)
"""One for each script; a missing script is left out."""


@dataclass(frozen=True)
class PartOutput:
    """Output of a part, or why it has no numbers."""

    part: Part
    lines: tuple[str, ...]


def measure(progress: Callable[[str, float], None], quick: bool) -> list[PartOutput]:
    """Run every part in a process of its own, one after the other."""
    there = [part for part in PARTS if (HERE / f"{part.script}.py").is_file()]
    outputs: list[PartOutput] = []
    for k, part in enumerate(there):
        progress(part.script, k / len(there))
        outputs.append(PartOutput(part, _ran(part, quick)))
    return outputs


def _ran(part: Part, quick: bool) -> tuple[str, ...]:
    command = [sys.executable, "-m", f"benchmarks.{part.script}"]
    command += part.quick if quick else part.options
    try:
        done = subprocess.run(
            command, cwd=ROOT, env={**os.environ, "MPLBACKEND": "Agg"}, capture_output=True,
            text=True, timeout=LIMIT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return (f"no numbers: not done after {LIMIT_S:.0f} s",)
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        return (f"no numbers: {last[0]}",)
    return tuple(done.stdout.rstrip().splitlines())


def markdown(outputs: list[PartOutput]) -> list[str]:
    """A section for each part, with its output."""
    lines: list[str] = []
    for each in outputs:
        lines += [f"## {each.part.title}", "", f"`python -m benchmarks.{each.part.script}`", ""]
        lines += ["```text", *each.lines, "```", ""]
    return lines
