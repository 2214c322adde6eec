"""How the control step grows with the number of discs, beside cbfpy: 4 ... 1024."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bench.compare import bench
from bench.measure import Rounds
from bench.result import BenchResult
from matplotlib.figure import Figure

PEERS = {"qpax": "cbfpy, qpax", "elastiqp": "cbfpy, elastiqp"}


def measure(progress: Callable[[str, float], None], quick: bool) -> BenchResult:
    """The long form of `cohelm bench`; with `quick`, its short form."""
    return bench(progress, quick)


def per_disc_ns(rounds: dict[int, Rounds]) -> float:
    """Time of one more disc, between the fewest and the most [ns]."""
    few, many = min(rounds), max(rounds)
    return 1e3 * (rounds[many].median - rounds[few].median) / (many - few)


def figure(result: BenchResult, path: Path) -> None:
    """Time over number of discs, both logarithmic; bars from the smallest to the largest round."""
    drawn = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = drawn.add_subplot()
    series = {"cohelm, whole control step": result.step}
    series |= {f"{PEERS[name]}, filter alone": rounds for name, rounds in result.filters.items()}
    for label, rounds in series.items():
        middle = [r.median for r in rounds.values()]
        below = [r.median - r.low for r in rounds.values()]
        above = [r.high - r.median for r in rounds.values()]
        axes.errorbar(list(rounds), middle, yerr=[below, above], marker="o", capsize=3, label=label)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks(list(result.step), [str(n) for n in result.step])
    axes.set_xlabel("discs")
    axes.set_ylabel("time of one step [µs]")
    axes.grid(which="both", alpha=0.3)
    axes.legend()
    drawn.savefig(path, dpi=150)


def markdown(result: BenchResult) -> list[str]:
    """The table of docs/benchmarks.md."""
    found = result.as_json()
    names = [name for name in PEERS if name in result.filters]
    lines = [
        "| discs | cohelm, whole step [µs] | "
        + "".join(f"{PEERS[name]} [µs] | ratio | " for name in names).rstrip(),
        "|---:|---:|" + "---:|---:|" * len(names),
    ]
    for n, ours in result.step.items():
        cells = [str(n), shown(ours)]
        for name in names:
            theirs = result.filters[name][n]
            cells += [shown(theirs), f"{theirs.times(ours):.3g}"]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", f"One more disc costs us {per_disc_ns(result.step):.2g} ns."]
    ir_sim = result.ir_sim
    if ir_sim is not None:
        ratios = found["ratios"]
        lines += [
            "",
            "| four discs | steps/s | times ir-sim |",
            "|---|---:|---:|",
            f"| ir-sim, one robot, commands given | {shown(ir_sim)} | 1 |",
            f"| cohelm, one robot, everything recorded | {shown(result.run)} "
            f"| {ratios['run_over_ir_sim']:.3g} |",
        ]
    lines += [
        "",
        f"Episodes of the campaigns, guard and planning: {shown(result.guarded)} steps/s a core.",
    ]
    lines += [f"No number for {name}: {why}." for name, why in found["absent"].items()]
    return lines


def shown(rounds: Rounds) -> str:
    """Median, and in brackets the smallest and largest round."""
    form = "{:,.0f}" if rounds.median >= 1000.0 else "{:.3g}"
    middle, low, high = (form.format(v) for v in (rounds.median, rounds.low, rounds.high))
    return f"{middle} ({low} – {high})"
