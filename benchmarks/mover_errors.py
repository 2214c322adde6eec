"""Errors of estimated movers in the fields of `movers`: `python -m benchmarks.mover_errors`.

Each field is driven once under the guard with the robot's own LiDAR, exact arcs. Along that way
perception is driven again with the sensors of campaigns (2 cm of noise, a sweep of 75 ms that
comes 50 ms late, wheels 1.5 % wrong), and its obstacles are compared with the truth,
at every scan, for each disc that is within NEAR of the outline and does not touch it.

A disc is estimated *too far* where no obstacle within ABOUT of it, disc or point, is as near
to the outline as it is, by more than SLACK; unobserved ground also counts where it
begins on the way to it. *View*: the share of the beams that would end on it,
if the LiDAR looked all round and nothing else stood there. A disc out of view is counted by when
it last was in view.

    python -m benchmarks.mover_errors [--seed 3000] [--n 30] [--json FILE]

Seeds below 2000 may be tuned on; the docs count from 3000 on.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cohelm.core.frames import compose, inverse, placed  # noqa: E402
from cohelm.core.types import RADIUS, Floats, Pose, Twist, X, Y  # noqa: E402
from cohelm.perceive.pipeline import Perception, Seen  # noqa: E402
from cohelm.perceive.track.params import TrackerParams  # noqa: E402
from cohelm.robot.clearance import disc_clearance  # noqa: E402
from cohelm.robot.sensors import Lidar  # noqa: E402
from cohelm.scenario.load import robot  # noqa: E402
from cohelm.sim.grid import NO_GRID  # noqa: E402
from cohelm.sim.lidar import sight  # noqa: E402
from cohelm.sim.run import run  # noqa: E402
from cohelm.sim.setup import Setup, with_pilot  # noqa: E402
from cohelm.sim.world import World, place  # noqa: E402
from cohelm.study.campaign import movers  # noqa: E402
from cohelm.study.campaign.episode import lively  # noqa: E402
from cohelm.study.campaign.movers import MAX_ACCELERATION  # noqa: E402
from tests.perceive.drives import LIDAR, drive  # noqa: E402

NEAR = 1.5
"""From the outline to a disc that counts [m]."""
ABOUT = 0.5
"""An obstacle so near to a disc's surface counts as its estimate [m]."""
ROUND = 0.15
"""By so much longer the way from the outline to a disc is through what begins on that way [m]."""
SLACK = 0.05
"""By more than this a disc is estimated too far [m]."""
FULL, BEAMS = 0.9, 5
"""A disc is in full view with that share of its beams, out of view with fewer beams than that."""
JUST, LONG = 1.5, 4.0
"""Times out of view that divide its rows [s]."""
VIEWS = ("full", "part", "out, just", "out, a while", "out, long or never seen")
SALLY = robot("sally").model_copy(update={"lidar": LIDAR})


class Way(NamedTuple):
    """One drive through a field."""

    setup: Setup
    poses: list[Pose]
    twists: list[Twist]


class Sample(NamedTuple):
    """One disc at one scan."""

    view: str
    true: float
    """Clearance of the outline [m]."""
    estimated: float
    """The same, of its estimate; inf where there is none [m]."""
    time: float
    """[s]"""
    disc: int


def driven(seed: int, number: int) -> Way:
    """A field, driven by LiDAR."""
    setup = movers.case(seed, number).setup
    setup = with_pilot(
        setup, lidars=SALLY.lidars, max_acceleration=MAX_ACCELERATION, gains=lively(setup.gains)
    )
    rows = run(setup).rows
    poses = [Pose(*p) for p in zip(*(rows[c].tolist() for c in ("x", "y", "psi")), strict=True)]
    twists = [
        Twist(*t)
        for t in zip(rows["applied_v"].tolist(), rows["applied_omega"].tolist(), strict=True)
    ]
    return Way(setup, poses, twists[:-1])


def at(world: World, t: float) -> Floats:
    discs = np.empty((len(world.discs), 6))
    place(discs, world, t)
    return discs


def sampled(way: Way, seed: int, params: TrackerParams | None = None) -> Iterator[Sample]:
    """Samples of perception on the way."""
    world, outline = way.setup.obstacles, way.setup.outline
    lidar = LIDAR.lidar()
    eyes = Perception(
        SALLY, tracker_params=params or TrackerParams(max_acceleration=MAX_ACCELERATION)
    )
    last = np.full(len(world.discs), -math.inf)  # in view for the third scan in a row
    runs = np.zeros(len(world.discs), np.int64)
    for moment in drive(
        way.poses, way.twists, seed, around=lambda t: at(world, t), walls=world.walls
    ):
        seen = eyes.take(moment.now, moment.readings)
        if not moment.scanned:
            continue
        discs = at(world, moment.now)
        obstacles = estimated(seen, moment.truth)
        ground = obstacles[len(seen.obstacles.discs) :][seen.unobserved]
        beams = in_view(moment.truth, lidar, discs, world.walls)
        far = np.maximum(distances(moment.truth, lidar, discs), discs[:, RADIUS])
        whole = 2.0 * np.arcsin(discs[:, RADIUS] / far) / lidar.step
        runs = np.where(beams >= BEAMS, runs + 1, 0)
        last[runs >= 3] = moment.now
        for i, d in enumerate(discs):
            true = disc_clearance(moment.truth, outline, d[X], d[Y], d[RADIUS])
            if not 0.0 < true < NEAR:
                continue
            if beams[i] >= BEAMS:
                view = VIEWS[0] if beams[i] >= FULL * whole[i] else VIEWS[1]
            else:
                since = moment.now - last[i]
                view = VIEWS[2 if since <= JUST else 3 if since <= LONG else 4]
            gap = nearest(moment.truth, outline, d, obstacles)
            gap = min(gap, before(moment.truth, outline, d, true, ground))
            yield Sample(view, true, gap, moment.now, i)


def estimated(seen: Seen, truth: Pose) -> Floats:
    """All obstacles given to the filter, as discs in the world: (n, 3), points of radius 0."""
    frame = compose(truth, inverse(seen.odometry))
    found = seen.obstacles.placed(frame)
    discs, points = found.discs[:, [X, Y, RADIUS]], found.points
    return np.vstack((discs, np.column_stack((points, np.zeros(len(points))))))


def nearest(pose: Pose, outline: Floats, disc: Floats, obstacles: Floats) -> float:
    """The least clearance of a disc's estimate [m]."""
    far = (
        np.hypot(obstacles[:, 0] - disc[X], obstacles[:, 1] - disc[Y])
        - obstacles[:, 2]
        - disc[RADIUS]
    )
    gaps = [disc_clearance(pose, outline, x, y, r) for x, y, r in obstacles[far < ABOUT].tolist()]
    return min(gaps, default=math.inf)


def before(pose: Pose, outline: Floats, disc: Floats, true: float, ground: Floats) -> float:
    """The least clearance of ground (n, 3) on the way to a disc that has a `true` one [m]."""
    least = math.inf
    for x, y, _ in ground.tolist():
        off = math.hypot(x - disc[X], y - disc[Y]) - disc[RADIUS]
        if off < true + ROUND:
            gap = disc_clearance(pose, outline, x, y, 0.0)
            if gap + off < true + ROUND:
                least = min(least, gap)
    return least


def distances(pose: Pose, lidar: Lidar, discs: Floats) -> Floats:
    sensor = compose(pose, lidar.mount)
    return np.hypot(discs[:, X] - sensor.x, discs[:, Y] - sensor.y)


def in_view(pose: Pose, lidar: Lidar, discs: Floats, walls: Floats) -> Floats:
    """Beams that end on each disc."""
    ranges = np.empty(len(lidar.beams))
    sight(pose, lidar, discs, walls, NO_GRID, ranges)
    hit = np.isfinite(ranges)
    ends = placed(ranges[hit, None] * lidar.beams[hit], compose(pose, lidar.mount))
    off = (
        np.hypot(ends[:, None, 0] - discs[:, X], ends[:, None, 1] - discs[:, Y]) - discs[:, RADIUS]
    )
    return (np.abs(off) < 0.01).sum(axis=0)


def table(samples: list[Sample]) -> dict[str, dict[str, float]]:
    """By view: how many, the share too far, and by how much they are too near."""
    made = {}
    for view in VIEWS:
        some = np.array([(s.true, s.estimated) for s in samples if s.view == view]).reshape(-1, 2)
        if not len(some):
            continue
        off = some[:, 1] - some[:, 0]
        made[view] = {
            "samples": len(some),
            "too_far": float((off > SLACK).mean()),
            "too_near_median_m": float(np.median(np.maximum(-off, 0.0))),
            "too_near_90_m": float(np.quantile(np.maximum(-off, 0.0), 0.9)),
        }
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=3000)
    parser.add_argument("--n", type=int, default=30)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    samples: list[Sample] = []
    for number in range(args.n):
        samples += sampled(driven(args.seed, number), number)
        print(f"{number + 1} of {args.n} fields", file=sys.stderr)
    made = table(samples)
    print(f"{'in view':25s} {'samples':>8s} {'too far':>8s} {'too near, median':>17s} {'90 %':>7s}")
    for view, row in made.items():
        print(
            f"{view:25s} {row['samples']:8.0f} {100 * row['too_far']:6.1f} % "
            f"{row['too_near_median_m']:15.2f} m {row['too_near_90_m']:5.2f} m"
        )
    if args.json:
        args.json.write_text(json.dumps(made, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
