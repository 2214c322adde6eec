"""How the batch grows with robots and threads, beside ir-sim in the same rounds."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from time import perf_counter

from growth import shown

from cohelm.sim.batch import all_threads, run_batch
from cohelm.sim.run import run
from cohelm.study.bench.compare import world_question
from cohelm.study.bench.measure import Rounds
from cohelm.study.bench.peers import Peer, installed
from cohelm.study.bench.scene import course, crowd

ROBOTS = (1, 16, 256, 4096)
ENOUGH_STEPS = 200_000  # a shorter batch is repeated, so that a round is not all clock


@dataclass(frozen=True)
class Crowds:
    """Million robot-steps/s by (robots, threads), and ir-sim's steps/s; same rounds."""

    batch: dict[tuple[int, int], Rounds]
    ir_sim: Rounds | None

    def as_json(self) -> dict[str, object]:
        return {
            "batch_msteps_per_s": {
                f"{robots} robots, {threads} threads": list(r.values)
                for (robots, threads), r in self.batch.items()
            },
            "ir_sim_steps_per_s": None if self.ir_sim is None else list(self.ir_sim.values),
        }


def measure(progress: Callable[[str, float], None], quick: bool) -> Crowds:
    """Every size on one thread and on all, in turns."""
    rounds = 3 if quick else 9
    every = all_threads()
    setup = course(10.0)
    steps = setup.steps
    batches = {robots: crowd(robots, setup.duration) for robots in ROBOTS}
    values: dict[tuple[int, int], list[float]] = {}
    theirs: list[float] = []
    with ExitStack() as stack:
        peer = stack.enter_context(Peer("ir-sim")) if installed("ir-sim") else None
        if peer is not None:
            peer.ask(world_question(setup, run(setup)))
        run_batch(batches[1])
        for k in range(rounds):
            progress(f"round {k + 1} of {rounds}", k / rounds)
            for robots, batch in batches.items():
                repeats = max(1, ENOUGH_STEPS // (robots * steps))
                for threads in sorted({1, every}):
                    start = perf_counter()
                    for _ in range(repeats):
                        run_batch(batch, threads)
                    rate = robots * steps * repeats / (perf_counter() - start) / 1e6
                    values.setdefault((robots, threads), []).append(rate)
            if peer is not None:
                theirs.append(float(peer.ask({"run": True})["steps_per_s"]))
    return Crowds(
        {key: Rounds(tuple(rates)) for key, rates in values.items()},
        Rounds(tuple(theirs)) if theirs else None,
    )


def markdown(crowds: Crowds) -> list[str]:
    """The table of docs/benchmarks.md."""
    lines = [
        "| robots | threads | million robot-steps/s | times ir-sim |",
        "|---:|---:|---:|---:|",
    ]
    for (robots, threads), rates in crowds.batch.items():
        ratio = "" if crowds.ir_sim is None else f"{1e6 * rates.times(crowds.ir_sim):,.0f}"
        lines.append(f"| {robots} | {threads} | {shown(rates)} | {ratio} |")
    return lines
