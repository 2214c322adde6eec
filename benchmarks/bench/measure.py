"""How a time is taken, how several takings make one number, and on what machine."""

from __future__ import annotations

import os
import platform
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter_ns


@dataclass(frozen=True)
class Rounds:
    """One quantity, measured once in every round; rounds alternate between us and the peers."""

    values: tuple[float, ...]

    @property
    def median(self) -> float:
        """The middle one: a round disturbed by the rest of the machine does not move it."""
        return statistics.median(self.values)

    @property
    def low(self) -> float:
        """The smallest."""
        return min(self.values)

    @property
    def high(self) -> float:
        """The largest."""
        return max(self.values)

    def scaled(self, factor: float) -> Rounds:
        """The same in another unit."""
        return Rounds(tuple(factor * value for value in self.values))

    def times(self, other: Rounds) -> float:
        """How many times as large as `other`: median of the ratios within each round."""
        pairs = zip(self.values, other.values, strict=True)
        return statistics.median(ours / theirs for ours, theirs in pairs)


def median_call_us(call: Callable[[int], object], calls: int) -> float:
    """Median time of call(0), call(1), ... [us]; each is timed by itself.

    The clock's own time (some 80 ns) and the one Python frame of `call` are included, for
    everyone alike.
    """
    taken = [0] * calls
    for i in range(calls):
        start = perf_counter_ns()
        call(i)
        taken[i] = perf_counter_ns() - start
    return statistics.median(taken) / 1e3


def machine(packages: Sequence[str] = ()) -> dict[str, str | int]:
    """Processor, cores, Python and package versions that the numbers hold for."""
    facts: dict[str, str | int] = {
        "cpu": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else _cores(),
        "system": platform.system(),
        "python": platform.python_version(),
    }
    for package in packages:
        found = installed_version(package)
        if found is not None:
            facts[package] = found
    return facts


def installed_version(package: str) -> str | None:
    """Version of a distribution, None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _cores() -> int:
    return os.cpu_count() or 1


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    name = named[0] if named else platform.processor() or platform.machine()
    for noise in ("(R)", "(TM)", "Processor", "CPU"):
        name = name.replace(noise, "")
    return " ".join(name.split())
