"""The lab closed on sensors only, with its requirements: `python benchmarks/sensors.py`.

Odometry 1-2 % wrong, a gyro that drifts, LiDAR of 2 cm noise at 10 Hz, 50 ms late. First the parts
against the truth (map, localisation, pushes), then whole drives through the loop in simulated
time, on the twin or, with `--kind kinematic`, on exact arcs; finally pushes of 2 m on the way.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the drives are the tests' own

from benchmarks.lab import drive
from benchmarks.perceive import localised, pushed, surveyed
from cohelm.perceive.localize.localization_map import map_from_occupancy
from tests.perceive.drives import lab_map


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--kind", choices=["kinematic", "twin"], default="twin")
    parser.add_argument("--seeds", type=int, default=2)
    given = parser.parse_args()
    console = Console()

    made, rows = surveyed()
    show(console, "map", ("drive", "ATE rms", "largest", "heading", "CPU a scan"), rows)
    heads = ("map, seed", "rms", "99 %", "largest", "heading", "ms median", "99 %")
    show(console, "localisation", heads, list(localised({"the robot's own": made})))
    heads = ("of 1-2 m", "found again", "median", "last", "believed wrongly after 1 s")
    show(console, "pushed aside", heads, list(pushed(map_from_occupancy(*lab_map()), 30)))

    heads = (
        "scenario, seed", "arrived", "free", "path rms", "99 %", "place rms", "99 %", "heading",
        "gap",
    )  # fmt: skip
    rows = []
    for name in ("lab-track", "lab-avoid", "lab-shared"):
        for seed in range(given.seeds):
            r = drive(given.kind, seed, scenario=name)
            rows.append((
                f"{name}, {seed}", f"{r.time:.1f} s" if r.arrived else f"no: {r.reason}",
                f"{100 * r.free:.0f} %", *(f"{100 * v:.1f} cm" for v in (r.path_rms, r.path_99)),
                *(f"{100 * v:.2f} cm" for v in (r.located_rms, r.located_99)),
                f"{math.degrees(r.heading_rms):.2f} deg", f"{100 * r.least:.1f} cm",
            ))  # fmt: skip
    show(console, f"the whole loop, {given.kind}, nobody at the stick", heads, rows)

    moments = (16.0, 18.0, 20.0, 22.0, 24.0)
    heads = ("at", "knows its place again after", "with a LiDAR that looks all round")
    rows = []
    for at in moments:
        found = [drive(given.kind, 0, 2.0, at, all_round=round_).found for round_ in (False, True)]
        rows.append((f"{at:.0f} s", *(f"{t:.2f} s" for t in found)))
    show(console, "pushed 2 m along the corridor, in the whole loop", heads, rows)


def show(console: Console, title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    table = Table(*heads, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    console.print(table)


if __name__ == "__main__":
    main()
