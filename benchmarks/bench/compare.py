"""`cohelm bench`: our step and runs, and the peers, in turns within the same rounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from time import perf_counter
from typing import Any

import numpy as np

from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, SAFE, Floats, X, Y
from cohelm.law.gains import Gains
from cohelm.law.step import step
from cohelm.sim.run import run
from cohelm.sim.setup import Setup
from cohelm.study.campaign.episode import Episode, Interventions, traced

from .measure import Rounds, machine, median_call_us
from .peers import INSTALL, Peer, PeerFailed, installed
from .result import CBFPY, IR_SIM, BenchResult
from .scene import Field, course, field, guarded

QUICK_SIZES = (4, 16, 64, 256)
FULL_SIZES = (4, 16, 64, 256, 1024)

_PACKAGES = (
    "cohelm", "numpy", "numba", "llvmlite", "cbfpy", "jax", "qpax", "elastiqp", "ir-sim", "shapely",
)  # fmt: skip


def bench(
    progress: Callable[[str, float], None] = lambda _doing, _share: None,
    quick: bool = True,
    *,
    sizes: Sequence[int] | None = None,
    rounds: int | None = None,
    peers: Sequence[str] = (*CBFPY, IR_SIM),
) -> BenchResult:
    """Time everything; a minute with `quick`, which takes fewer and shorter rounds.

    progress: told what is being done, and the share of all that is done.
    sizes: numbers of discs of a step. rounds: how often each number is taken. peers: those to
    ask; the ones that are not installed are left out and named.
    """
    sizes = tuple(sizes or (QUICK_SIZES if quick else FULL_SIZES))
    rounds = rounds or (7 if quick else 11)
    with ExitStack() as stack:
        progress("starting the peers", 0.0)
        table = _Table(stack, peers)
        fields = {n: field(n) for n in sizes}
        setup = course(10.0 if quick else None)
        trace = run(setup)
        table.prepare(fields, setup, trace)
        progress("compiling the pilot", 0.1)
        cases = guarded(few=quick)
        _drive(cases)
        progress("waiting for the peers to compile", 0.3)
        table.wait()
        for k in range(rounds):
            progress(f"round {k + 1} of {rounds}", 0.6 + 0.4 * k / rounds)
            _round(table, fields, setup, len(trace), cases, quick)
    return BenchResult(
        step={n: table.taken(f"step {n}") for n in sizes},
        run=table.taken("run"),
        guarded=table.taken("guarded"),
        filters={
            name: {n: table.taken(f"{name} {n}") for n in sizes}
            for name in CBFPY
            if name not in table.absent
        },
        ir_sim=None if IR_SIM in table.absent else table.taken(IR_SIM),
        absent=table.absent,
        shaped={n: f.shaped for n, f in fields.items()},
        machine=machine(_PACKAGES),
    )


class _Table:
    """The numbers taken so far, and the peers that still answer."""

    def __init__(self, stack: ExitStack, names: Sequence[str]) -> None:
        self.absent: dict[str, str] = {}
        self._peers: dict[str, Peer] = {}
        self._values: dict[str, list[float]] = {}
        self._owed: dict[str, int] = {}
        for name in (*CBFPY, IR_SIM):
            if name not in names:
                self.absent[name] = "not asked"
            elif not installed(name):
                self.absent[name] = INSTALL
            else:
                self._peers[name] = stack.enter_context(Peer(name))

    def prepare(self, fields: dict[int, Field], setup: Setup, trace: Trace) -> None:
        """Hand every peer its scenes; `wait` for them after doing something else."""
        for name in list(self._peers):
            for question in (
                [world_question(setup, trace)] if name == IR_SIM else _filter_questions(fields)
            ):
                self._try(name, lambda peer, q=question: peer.send(q))
                self._owed[name] = self._owed.get(name, 0) + 1

    def wait(self) -> None:
        """Until every peer is ready."""
        for name, count in self._owed.items():
            for _ in range(count):
                self._try(name, lambda peer: peer.receive())

    def ask(self, name: str, key: str, question: dict[str, Any], field_of_answer: str) -> None:
        """Take one number from a peer, if it is there."""
        answer = self._try(name, lambda peer: peer.ask(question))
        if answer is not None:
            self.take(key, float(answer[field_of_answer]))

    def take(self, key: str, value: float) -> None:
        """Add one round's number."""
        self._values.setdefault(key, []).append(value)

    def taken(self, key: str) -> Rounds:
        """All rounds of one number."""
        return Rounds(tuple(self._values[key]))

    def _try(self, name: str, act: Callable[[Peer], Any]) -> Any:
        peer = self._peers.get(name)
        if peer is None:
            return None
        try:
            return act(peer)
        except PeerFailed as failure:
            self.absent[name] = str(failure)
            del self._peers[name]
            return None


def _round(
    table: _Table, fields: dict[int, Field], setup: Setup, steps: int, cases: Sequence[Episode],
    quick: bool,
) -> None:  # fmt: skip
    """Every number once, ours and the peers' next to each other."""
    for n, scene in fields.items():
        table.take(f"step {n}", _step_us(scene, 2000 if quick else 5000))
        for name in CBFPY:
            question = {"time": n, "calls": 200 if quick else 400}
            table.ask(name, f"{name} {n}", question, "us")
    start = perf_counter()
    run(setup)
    table.take("run", steps / (perf_counter() - start))
    table.ask(IR_SIM, IR_SIM, {"run": True}, "steps_per_s")
    start = perf_counter()
    driven = _drive(cases)
    table.take("guarded", driven / (perf_counter() - start))


def _drive(cases: Sequence[Episode]) -> int:
    """Drive episodes with the guard, as a campaign does on one core; how many steps they took."""
    return sum(len(part) for case in cases for part in traced(case, "guard", Interventions()))


def _step_us(scene: Field, calls: int) -> float:
    """Median time of the public control step among the scene's discs [us]."""
    poses, desired, stick, discs = scene.poses, scene.desired, scene.stick, scene.discs
    gains, count = Gains(), len(scene.poses)

    def call(i: int) -> None:
        step(poses[i % count], desired[i % count], stick, discs, gains)

    return median_call_us(call, calls)


def _filter_questions(fields: dict[int, Field]) -> list[dict[str, Any]]:
    return [
        {
            "field": n,
            "discs": scene.discs[:, [X, Y, SAFE]].tolist(),
            "poses": [list(pose) for pose in scene.poses],
            "wishes": scene.wishes.tolist(),
        }
        for n, scene in fields.items()
    ]


def world_question(setup: Setup, trace: Trace) -> dict[str, Any]:
    """What ir-sim is asked to play: the world of our run, and the commands of its wheels."""
    around = setup.obstacles.discs
    commands = np.column_stack((trace.rows["applied_v"], trace.rows["applied_omega"]))
    size: Floats = setup.outline.max(axis=0) - setup.outline.min(axis=0)
    return {
        "start": list(setup.start),
        "size": size.tolist(),
        "discs": around[:, [X, Y, RADIUS]].tolist(),
        "commands": commands.tolist(),
        "dt": setup.dt,
    }
