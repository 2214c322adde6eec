"""Start-up times: `cohelm --help`, and `cohelm reproduce` on an empty and a filled cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.measure import Rounds
from bench.peers import installed
from growth import shown

COHELM = (str(Path(sys.executable).with_name("cohelm")),)

# Linux counts the memory of the starting process as the started one's, until it has outgrown it;
# so a small process starts, times and weighs the command.
WATCH = """
import resource, subprocess, sys, time
start = time.perf_counter()
code = subprocess.call(sys.argv[1:], stdout=subprocess.DEVNULL)
print(time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(code)
"""


@dataclass(frozen=True)
class Command:
    """Wall time [s] and peak resident memory of the process [MB]; or why there are none."""

    name: str
    seconds: Rounds | None
    peak_mb: Rounds | None
    failure: str = ""

    def as_json(self) -> dict[str, object]:
        return {
            "seconds": None if self.seconds is None else list(self.seconds.values),
            "peak_mb": None if self.peak_mb is None else list(self.peak_mb.values),
            "failure": self.failure,
        }


def measure(progress: Callable[[str, float], None], quick: bool) -> list[Command]:
    """Help and imports many times; reproduce once cold per round and then warm."""
    rounds = 3 if quick else 5
    short = {
        "`cohelm --help`": (*COHELM, "--help"),
        "`import cohelm.law.step`": (sys.executable, "-c", "import cohelm.law.step"),
    }
    for name, module in (("qpax", "cbfpy"), ("ir-sim", "irsim")):
        if installed(name):
            short[f"`import {module}` (peer)"] = (sys.executable, "-c", f"import {module}")
    taken: dict[str, list[tuple[float, float]]] = {}
    failures: dict[str, str] = {}

    def take(name: str, command: Sequence[str], cache: str | None = None) -> None:
        if name in failures:
            return
        try:
            taken.setdefault(name, []).append(_timed(command, cache))
        except RuntimeError as failure:
            failures[name] = str(failure)

    for k in range(rounds):
        for name, command in short.items():
            progress(name, 0.5 * k / rounds)
            take(name, command)
    repeats = 1 if quick else 2
    for k in range(repeats):
        progress("`cohelm reproduce`", 0.5 + 0.5 * k / repeats)
        with tempfile.TemporaryDirectory() as folder:
            reproduce = (*COHELM, "reproduce", "--out", str(Path(folder) / "out"))
            cache = str(Path(folder) / "cache")
            take("`cohelm reproduce`, bare cache", reproduce, cache)
            take("`cohelm reproduce`, second time", reproduce, cache)
    return [
        Command(name, None, None, failures[name])
        if name in failures
        else Command(name, Rounds(tuple(s for s, _ in pairs)), Rounds(tuple(m for _, m in pairs)))
        for name, pairs in ({**taken, **{failed: [] for failed in failures}}).items()
    ]


def _timed(command: Sequence[str], cache: str | None) -> tuple[float, float]:
    """Wall time [s] and peak memory [MB] of a process; RuntimeError with its last output."""
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    if cache is not None:
        environment["COHELM_CACHE_DIR"] = cache
    watched = subprocess.run(
        (sys.executable, "-I", "-S", "-c", WATCH, *command),
        capture_output=True,
        env=environment,
        text=True,
        check=False,
    )
    last = watched.stderr.strip().splitlines()[-1:]
    if watched.returncode != 0:
        raise RuntimeError(f"failed: {' '.join(last)}")
    seconds, peak = watched.stdout.split()
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # ru_maxrss is in bytes, or KiB
    return float(seconds), float(peak) * unit / 1e6


def markdown(commands: Sequence[Command]) -> list[str]:
    """The table of docs/benchmarks.md."""
    lines = ["| command | wall time [s] | peak memory [MB] |", "|---|---:|---:|"]
    for c in commands:
        if c.seconds is None or c.peak_mb is None:
            lines.append(f"| {c.name} | {c.failure} | |")
        else:
            lines.append(f"| {c.name} | {shown(c.seconds)} | {c.peak_mb.high:.0f} |")
    return lines
