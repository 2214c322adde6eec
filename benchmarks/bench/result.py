"""What `cohelm bench` found: as JSON, and as the table a person reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from .measure import Rounds

CBFPY = ("qpax", "elastiqp")
"""cbfpy by its backend: the default, and the faster extra."""
IR_SIM = "ir-sim"

_KEYS = {"qpax": "cbfpy", "elastiqp": "cbfpy_elastiqp"}
_NAMES = {"qpax": "cbfpy, qpax", "elastiqp": "cbfpy, elastiqp", "ir-sim": "ir-sim"}


@dataclass(frozen=True)
class BenchResult:
    """Times of one bench; every number is kept round by round.

    step: one control step through `law.step.step`, by number of discs [us]. run: `sim.run.run`
    with four discs and the paper's law, everything recorded [steps/s]. guarded: episodes of the
    campaigns with guard and planning, on one core [steps/s]. filters: cbfpy's safety filter by
    backend and number of discs [us]. ir_sim: ir-sim's `env.step` with four discs [steps/s]. absent:
    why a peer has no number. shaped: share of the timed poses at which our filter acts.
    """

    step: dict[int, Rounds]
    run: Rounds
    guarded: Rounds
    filters: dict[str, dict[int, Rounds]]
    ir_sim: Rounds | None
    absent: dict[str, str]
    shaped: dict[int, float]
    machine: dict[str, str | int]

    def as_json(self) -> dict[str, Any]:
        """Medians under the promised names, null for an absent peer; then spread and ratios."""
        return {
            "step_us": _medians(self.step),
            "run_steps_per_s": _rounded(self.run.median),
            "guarded_steps_per_s": _rounded(self.guarded.median),
            "peers": {
                **{f"{_KEYS[name]}_step_us": _medians(self.filters.get(name)) for name in CBFPY},
                "ir_sim_steps_per_s": None if self.ir_sim is None else _rounded(self.ir_sim.median),
            },
            "ratios": self._ratios(),
            "spread": self._spread(),
            "absent": {_NAMES[name]: why for name, why in self.absent.items()},
            "filter_active": {str(n): round(share, 3) for n, share in self.shaped.items()},
            "machine": self.machine,
        }

    def _ratios(self) -> dict[str, Any]:
        """How many times faster we are, within the same rounds."""
        against = {
            f"step_over_{_KEYS[name]}": {
                str(n): _rounded(theirs.times(self.step[n]))
                for n, theirs in self.filters[name].items()
            }
            if name in self.filters
            else None
            for name in CBFPY
        }
        ir_sim = self.ir_sim
        return {
            **against,
            "run_over_ir_sim": None if ir_sim is None else _rounded(self.run.times(ir_sim)),
        }

    def _spread(self) -> dict[str, Any]:
        """Smallest and largest round, under the names of the medians."""
        found: dict[str, Any] = {
            "rounds": len(self.run.values),
            "step_us": _ranges(self.step),
            "run_steps_per_s": _range(self.run),
            "guarded_steps_per_s": _range(self.guarded),
        }
        for name in CBFPY:
            found[f"{_KEYS[name]}_step_us"] = _ranges(self.filters.get(name))
        found["ir_sim_steps_per_s"] = None if self.ir_sim is None else _range(self.ir_sim)
        return found

    def table(self) -> Group:
        """Ours, the peers', and how many times faster ours is."""
        rounds = f"median of {len(self.run.values)} rounds (smallest–largest)"
        steps = Table(title=Text(f"One control step [µs], {rounds}"), title_justify="left")
        steps.add_column("discs", justify="right")
        steps.add_column("cohelm")
        for name in CBFPY:
            steps.add_column(_NAMES[name])
            steps.add_column("ratio", justify="right")
        for n, ours in self.step.items():
            cells = [str(n), _shown(ours)]
            for name in CBFPY:
                theirs = self.filters.get(name, {}).get(n)
                cells += ["–", ""] if theirs is None else [_shown(theirs), _times(theirs, ours)]
            steps.add_row(*cells)
        drives = Table(title=Text(f"Runs [1000 steps/s], {rounds}"), title_justify="left")
        drives.add_column("what")
        drives.add_column("rate")
        drives.add_column("ratio", justify="right")
        ir_sim = self.ir_sim
        drives.add_row("ir-sim, 4 discs", "–" if ir_sim is None else _shown(ir_sim.scaled(1e-3)))
        ratio = "" if ir_sim is None else _times(self.run, ir_sim)
        drives.add_row("cohelm, 4 discs, paper's law", _shown(self.run.scaled(1e-3)), ratio)
        drives.add_row(
            "cohelm, campaigns, guard and planning", _shown(self.guarded.scaled(1e-3)), ""
        )
        words = [f"{self.machine['cores']} cores of {self.machine['cpu']}"]
        words += [f"{_NAMES[name]}: {why}" for name, why in self.absent.items()]
        return Group(steps, drives, *(Text(word) for word in words))


def _rounded(value: float) -> float:
    """Four figures: more would be noise."""
    return float(f"{value:.4g}")


def _medians(rounds: dict[int, Rounds] | None) -> dict[str, float] | None:
    return None if rounds is None else {str(n): _rounded(r.median) for n, r in rounds.items()}


def _ranges(rounds: dict[int, Rounds] | None) -> dict[str, list[float]] | None:
    return None if rounds is None else {str(n): _range(r) for n, r in rounds.items()}


def _range(rounds: Rounds) -> list[float]:
    return [_rounded(rounds.low), _rounded(rounds.high)]


def _shown(rounds: Rounds) -> str:
    return f"{_number(rounds.median)} ({_number(rounds.low)}–{_number(rounds.high)})"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def _times(larger: Rounds, smaller: Rounds) -> str:
    return f"{_number(larger.times(smaller))} ×"
