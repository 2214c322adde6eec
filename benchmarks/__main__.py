"""The whole study: `python benchmarks [--quick]`; tables into docs/benchmarks.md.

The numbers, round by round, and the figure go to benchmarks/results/, which git ignores.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import commands
import growth
import guard
import parts
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
TABLES = HERE.parent / "docs" / "benchmarks.md"


def main() -> None:
    quick = "--quick" in sys.argv[1:]
    RESULTS.mkdir(exist_ok=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:

        def progress_of(what: str) -> Callable[[str, float], None]:
            task = bar.add_task(what, total=1.0)
            return lambda doing, share: bar.update(
                task, description=f"{what}: {doing}", completed=share
            )

        steps = growth.measure(progress_of("steps"), quick)
        guarded = guard.measure(progress_of("guard"), quick)
        waits = commands.measure(progress_of("commands"), quick)
        others = parts.measure(progress_of("parts"), quick)
    found = {
        "growth": steps.as_json(),
        "guard": guarded.as_json(),
        "commands": {wait.name: wait.as_json() for wait in waits},
        "parts": {each.part.title: list(each.lines) for each in others},
    }
    for name, numbers in found.items():
        (RESULTS / f"{name}.json").write_text(json.dumps(numbers, indent=1) + "\n", "utf-8")
    growth.figure(steps, RESULTS / "growth.png")
    facts = dict(steps.machine)
    cores, cpu, system = (facts.pop(key) for key in ("cores", "cpu", "system"))
    article = "an" if str(cpu)[0] in "AEIOU" else "a"
    versions = ", ".join(f"{name} {version}" for name, version in facts.items())
    text = "\n".join([
        "# Benchmarks",
        "",
        "Written by `make bench`; do not edit. Each number is the median of rounds (smallest –",
        "largest), and each round times us and the peers in turns. What is equal and what is not:",
        "`benchmarks/bench/peers.py`.",
        "",
        f"{cores} cores of {article} {cpu}, {system}; {versions}.",
        "",
        "## One control step, and one robot",
        "",
        *growth.markdown(steps),
        "",
        "## One step of the guard",
        "",
        *guard.markdown(guarded),
        "",
        "## Commands",
        "",
        *commands.markdown(waits),
        "",
        *parts.markdown(others),
    ])  # fmt: skip
    if not quick:
        TABLES.parent.mkdir(exist_ok=True)
        TABLES.write_text(text, "utf-8")
    Console().print(Markdown(text))


if __name__ == "__main__":
    main()
