"""The guard's step from Python against the number of discs and LiDAR points, beside cbfpy.

`python benchmarks/guard.py [--quick]`, or as part of `python benchmarks`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from bench.measure import Rounds, median_call_us
from bench.peers import Peer, PeerFailed, installed
from bench.scene import POSES, SAFE_M, Field, field as among

from cohelm.core.flat import numbers, read
from cohelm.core.jit import jit
from cohelm.core.obstacles import Obstacles, Surroundings
from cohelm.core.types import RADIUS, Floats, Pose, Twist, X, Y
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.step import guard
from cohelm.law.guard.surroundings import surroundings
from cohelm.pilot.safety_filter import SafetyFilter
from cohelm.robot.limits import Limits
from cohelm.robot.model import RobotModel, shipped_path

DISCS = (4, 16, 64, 256, 1024)
POINTS = (90, 360, 720, 1440, 10_000)
COMPARED = 16
"""Discs at which cbfpy is timed too."""
FILTERS = {
    "discs": "16 discs", "points": "720 LiDAR points", "fresh points": "and `Obstacles` made anew"
}  # fmt: skip
PEERS = {"qpax": "cbfpy, qpax", "elastiqp": "cbfpy, elastiqp"}


@dataclass
class GuardTimes:
    """Microseconds a step, by number of obstacles; and of cbfpy's filter at COMPARED discs."""

    discs: dict[int, Rounds] = field(default_factory=dict)
    points: dict[int, Rounds] = field(default_factory=dict)
    peers: dict[str, Rounds] = field(default_factory=dict)
    filters: dict[str, Rounds] = field(default_factory=dict)
    """A whole call of `cohelm.SafetyFilter`, see FILTERS."""

    def as_json(self) -> dict[str, object]:
        """Medians, and cbfpy's times relative to them."""
        ours = self.discs[COMPARED]
        return {
            "discs_us": {str(n): r.median for n, r in self.discs.items()},
            "points_us": {str(n): r.median for n, r in self.points.items()},
            "safety_filter_us": {name: r.median for name, r in self.filters.items()},
            "safety_filter_times_step": self.filters["discs"].times(ours),
            "times_cbfpy": {name: r.times(ours) for name, r in self.peers.items()},
        }


def room(n: int) -> Floats:
    """n LiDAR points, 270 degrees, on walls and pillars 0.45 to 1.2 m away: (n, 2)."""
    bearing = np.linspace(-0.75 * math.pi, 0.75 * math.pi, n)
    far = 0.825 + 0.375 * np.sin(5.0 * bearing)
    return np.c_[far * np.cos(bearing), far * np.sin(bearing)]


class _Constant(NamedTuple):
    limits: Limits
    rules: Rules


_Passed = tuple[float, float, int, float, float, int]
"""The twist that the guard passes, and the rest of its answer."""


def prepared(
    outline: Floats, limits: Limits, rules: Rules
) -> Callable[[Pose, Twist, Twist, Surroundings], _Passed]:
    """`guard`, all that is constant bound; numba takes 0.8 us to convert a named tuple."""
    row = numbers(_Constant(limits, rules))

    def step(pose: Pose, before: Twist, nominal: Twist, obstacles: Surroundings) -> _Passed:
        return _flat(*pose, *before, *nominal, *obstacles, outline, row)

    return step


@jit
def _flat(
    x: float, y: float, psi: float, v0: float, omega0: float, v: float, omega: float,
    discs: Floats, max_acceleration: Floats, velocity_error: Floats, segments: Floats,
    points: Floats, outline: Floats, row: Floats,
) -> _Passed:  # fmt: skip
    s = read(_Constant, row, 0)
    g = guard(
        Pose(x, y, psi), Twist(v0, omega0), Twist(v, omega),
        Surroundings(discs, max_acceleration, velocity_error, segments, points), outline, s.limits,
        s.rules, False,
    )  # fmt: skip
    return g.twist.v, g.twist.omega, g.verdict, g.change, g.clearance, g.limiting


def measure(progress: Callable[[str, float], None], quick: bool) -> GuardTimes:
    """Time all in turns, in rounds; with Jackal's outline and limits."""
    model = _jackal()
    guarded = prepared(model.outline, model.bounds(), Rules())
    rounds, calls = (7, 2_000) if quick else (15, 10_000)
    fields = {n: among(n) for n in DISCS}
    here = (Pose(0.0, 0.0, 0.0),) * POSES
    wishes = tuple(Twist(float(v), float(w)) for v, w in fields[COMPARED].wishes)
    timed: dict[tuple[str, int], Callable[[int], object]] = {}

    def step(
        obstacles: Surroundings, poses: tuple[Pose, ...], nominals: tuple[Twist, ...]
    ) -> Callable[[int], object]:
        def call(i: int) -> object:
            nominal = nominals[i % POSES]
            return guarded(poses[i % POSES], before, nominal, obstacles)

        before = Twist(0.4, 0.1)
        call(0)
        return call

    for n, f in fields.items():
        nominals = tuple(Twist(float(v), float(w)) for v, w in f.wishes)
        timed["discs", n] = step(surroundings(f.discs), f.poses, nominals)
    for n in POINTS:
        timed["points", n] = step(surroundings(points=room(n)), here, wishes)
    safe = SafetyFilter(model, 0.02, delay=0.05)
    known, seen, scan = (
        Obstacles(discs=fields[COMPARED].discs[:, [X, Y, RADIUS]]),
        room(720),
        here[0],
    )
    poses, now = fields[COMPARED].poses, Twist(0.4, 0.1)
    nominals = tuple(Twist(float(v), float(w)) for v, w in fields[COMPARED].wishes)
    points = Obstacles(points=seen)
    timed["filter discs", 16] = lambda i: safe(poses[i % POSES], now, nominals[i % POSES], known)
    timed["filter points", 16] = lambda i: safe(scan, now, wishes[i % POSES], points)
    timed["filter fresh points", 16] = lambda i: safe(
        scan, now, wishes[i % POSES], Obstacles(points=seen)
    )
    taken: dict[tuple[str, int], list[float]] = {key: [] for key in timed}
    theirs: dict[str, list[float]] = {}
    with _Peers(fields[COMPARED]) as peers:
        for k in range(rounds):
            progress(f"round {k + 1} of {rounds}", k / rounds)
            for key, call in timed.items():
                taken[key].append(median_call_us(call, max(calls * 16 // max(key[1], 16), 50)))
            for name, us in peers.times(200 if quick else 1_000).items():
                theirs.setdefault(name, []).append(us)
    return GuardTimes(
        {n: Rounds(tuple(taken["discs", n])) for n in DISCS},
        {n: Rounds(tuple(taken["points", n])) for n in POINTS},
        {name: Rounds(tuple(us)) for name, us in theirs.items()},
        {name: Rounds(tuple(taken[f"filter {name}", 16])) for name in FILTERS},
    )


class _Peers:
    """The installed backends of cbfpy, each in its process, with the same discs and poses."""

    def __init__(self, f: Field) -> None:
        self._question = {
            "field": COMPARED,
            "discs": [[d[X], d[Y], SAFE_M] for d in f.discs.tolist()],
            "poses": [list(p) for p in f.poses],
            "wishes": f.wishes.tolist(),
        }

    def __enter__(self) -> _Peers:
        self._peers = {name: Peer(name) for name in PEERS if installed(name)}
        for peer in self._peers.values():
            peer.ask(self._question)
        return self

    def __exit__(self, *_: object) -> None:
        for peer in self._peers.values():
            peer.__exit__(None, None, None)

    def times(self, calls: int) -> dict[str, float]:
        found = {}
        for name, peer in self._peers.items():
            try:
                found[name] = peer.ask({"time": COMPARED, "calls": calls})["us"]
            except PeerFailed as why:
                print(why, file=sys.stderr)
        return found


def _jackal() -> RobotModel:
    text = Path(shipped_path("jackal")).read_text(encoding="utf-8")
    return RobotModel.model_validate(yaml.safe_load(text))


def markdown(found: GuardTimes) -> list[str]:
    """The tables of docs/benchmarks.md."""
    lines = ["| discs | guard step [µs] |", "|---:|---:|"]
    lines += [f"| {n} | {_shown(r)} |" for n, r in found.discs.items()]
    lines += ["", "| LiDAR points | guard step [µs] |", "|---:|---:|"]
    lines += [f"| {n} | {_shown(r)} |" for n, r in found.points.items()]
    lines += ["", "| `cohelm.SafetyFilter`, a whole call [µs] | |", "|---|---:|"]
    lines += [f"| {FILTERS[name]} | {_shown(r)} |" for name, r in found.filters.items()]
    for name, r in found.peers.items():
        ratio = r.times(found.discs[COMPARED])
        lines += ["", f"{PEERS[name]} at {COMPARED} discs: {_shown(r)} µs, {ratio:.3g} times ours."]
    return lines


def _shown(rounds: Rounds) -> str:
    """Median, and in brackets the smallest and largest round."""
    return f"{rounds.median:.3g} ({rounds.low:.3g} – {rounds.high:.3g})"


if __name__ == "__main__":
    times = measure(lambda what, _: print(what, file=sys.stderr), "--quick" in sys.argv[1:])
    print("\n".join(markdown(times)))
