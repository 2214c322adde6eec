"""Robots that are lifted, wheels standing, and put down farther on: `benchmarks.carried`.

On published maps and in generated buildings, carried 9 m along their path in 6 s, at walking speed,
and then driven on. Perception alone. Success: at most 3 s after being put down neither lost nor
0.2 m off, for the rest of 9 s.

    python -m benchmarks.carried [--only NAME] [--seed 3100] [--seeds 130:134] [--count 3]
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.places import SALLY, WRONG, places_of  # noqa: E402
from cohelm.core.types import Pose, Twist  # noqa: E402
from cohelm.perceive.pipeline import Perception, warm_up  # noqa: E402
from tests.perceive.buildings import NO_DISCS, Place, tour  # noqa: E402
from tests.perceive.drives import DT, along, drive  # noqa: E402

BEFORE, CARRIED, AFTER = 150, 300, 450  # steps
FASTER = 3  # than it drives, 0.5 m/s


def recovered(
    place: Place, poses: list[Pose], twists: list[Twist], seed: int
) -> tuple[float, float]:
    """Last time lost or 0.2 m off since it was put down; longest spell wrong but not lost [s]."""
    off = BEFORE + FASTER * CARRIED
    way = [*poses[:BEFORE], *poses[BEFORE:off:FASTER], *poses[off : off + AFTER]]
    steps = [*twists[:BEFORE], *[Twist(0.0, 0.0)] * CARRIED, *twists[off : off + AFTER - 1]]
    perception = Perception(SALLY, place.known, way[0])
    down = DT * (BEFORE + CARRIED)
    last = run = longest = 0.0
    for m in drive(way, steps, seed, around=NO_DISCS, walls=place.walls, grid=place.grid):
        seen = perception.take(m.now, m.readings)
        e = math.hypot(seen.pose.x - m.truth.x, seen.pose.y - m.truth.y)
        if m.now > down and (seen.lost or e > 0.2):
            last = m.now - down
        run = run + DT if not seen.lost and e > WRONG else 0.0
        longest = max(longest, run)
    return last, longest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=3100, help="of what is driven")
    parser.add_argument("--seeds", default="130:134", help="of buildings")
    parser.add_argument("--count", type=int, default=3, help="on each map")
    parser.set_defaults(alike=False)
    given = parser.parse_args()
    first, last = (int(n) for n in given.seeds.split(":"))
    warm_up(SALLY, mapped=True)
    whole: list[tuple[float, float]] = []
    length = BEFORE + FASTER * CARRIED + AFTER
    for place in places_of(given, first, last):
        poses, twists = along(tour(place, given.seed, 80.0), 0.5)
        rng = np.random.default_rng([given.seed, 12])
        found = []
        for _ in range(given.count):
            k = int(rng.integers(0, len(poses) - length))
            seed = int(rng.integers(1_000_000))
            found.append(recovered(place, poses[k : k + length], twists[k : k + length], seed))
        print(summary(place.name, found), flush=True)
        whole += found
    print(summary("all", whole))


def summary(name: str, found: list[tuple[float, float]]) -> str:
    last, longest = np.array(found).T
    return (
        f"{name:24s} found {(last < 8.5).sum():3d}, within 3 s {(last < 3.0).sum():3d} of "
        f"{len(last):3d}; wrong and sure > 1 s {(longest > 1.0).sum()}, at most "
        f"{longest.max():.1f} s"
    )


if __name__ == "__main__":
    main()
