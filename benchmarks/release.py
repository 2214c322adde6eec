"""Released in a tight spot: does the robot get away, and back on its path?

    python -m benchmarks.release [--seed 3000] [--n 1000] [--json FILE]

Each case is a room of the suite `random` without its walkers, with true obstacles. An adversarial
operator drives the robot under the safety filter, anywhere, and presses it against obstacles, until
it stands with less than TIGHT clearance; there it releases the stick. As wheels turn both ways, a
motion out exists: the way in, reversed. The robot then follows the room's route. Counted are those
that are back on a path, E_P (51) below 0.03, and those that arrive, within LIMIT.

Seeds below 2000 may be tuned on; the docs count from 3000 on.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.types import VX, VY, Pose, Twist
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.step import guard
from cohelm.law.guard.surroundings import surroundings
from cohelm.robot.kinematics import arc
from cohelm.sim.run import run
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.world import Body, outline_clearance, world
from cohelm.study.campaign import rooms
from cohelm.study.campaign.episode import lively, sequence
from cohelm.study.metrics import BACK_ON_PATH

TIGHT = 0.04
"""Clearance of a tight spot [m]."""
LIMIT = 120.0
"""[s]"""
_LEADS = 60.0  # an operator that has found no tight spot by then starts again [s]
_AT_LEAST = 6.0  # also if it finds one at once [s]


class Released(NamedTuple):
    """The result of one robot."""

    number: int
    pose: Pose
    """Pose where the stick was released."""
    clearance: float
    """There [m]."""
    away: float
    """Until it has 10 cm of clearance, or is back; inf: never [s]."""
    back: float
    """Until it is back on its path; inf: never [s]."""
    arrived: bool
    touched: bool
    """Whether it came nearer to an obstacle than promised, or than it was at the release."""


def room_without_walkers(seed: int, number: int) -> Setup:
    """A room of `random` without walkers."""
    setup = rooms.case(seed, number).setup
    discs = setup.obstacles.discs
    rests = np.diff(setup.obstacles.path_first) == 0
    rests &= (discs[:, VX] == 0.0) & (discs[:, VY] == 0.0)
    bodies = [Body(tuple(row)) for row in discs[rests].tolist()]
    names = tuple(f"disc_{i}" for i in range(len(bodies)))
    setup = replace(
        setup, obstacles=world((bodies, setup.obstacles.walls)), names=names, duration=LIMIT
    )
    return with_pilot(setup, max_acceleration=0.0, gains=lively(setup.gains))


def pressed(setup: Setup, rng: np.random.Generator) -> tuple[Pose, float]:
    """A tight spot that the operator has driven into, under the filter, and its clearance."""
    dt, limits, reach = setup.dt, setup.limits, setup.reach
    obstacles = surroundings(setup.obstacles.discs, None, setup.obstacles.walls)
    rules = Rules(dt=dt)
    while True:
        pose, twist, nominal, until = setup.start, Twist(0.0, 0.0), Twist(0.0, 0.0), 0.0
        for k in range(round(_LEADS / dt)):
            t = k * dt
            if t >= until:
                v = float(rng.choice([1.0, 1.0, 0.5, 0.0, -1.0])) * limits.speed
                nominal = Twist(v, rng.uniform(-1.0, 1.0) * limits.yaw_rate)
                until = t + rng.uniform(0.3, 3.0)
            passed = guard(
                pose, twist, nominal, obstacles, setup.outline, limits, rules, False
            )  # fmt: skip
            twist = passed.twist
            pose = arc(pose, twist, dt)
            if t > _AT_LEAST and abs(twist.v) + abs(twist.omega) < 1e-3:
                gap = outline_clearance(
                    pose, setup.outline, reach, setup.obstacles.discs, setup.obstacles.walls, 1.0
                )
                if gap < TIGHT:
                    return pose, gap


def released(seed: int, number: int) -> Released:
    """One case."""
    setup = room_without_walkers(seed, number)
    pose, gap = pressed(setup, sequence(seed, "release", number))
    rows = run(replace(setup, start=pose, near=rooms.NEAR)).rows
    on, free = rows["e_p"] < BACK_ON_PATH, rows["clearance"] > 0.1
    back = float(rows["t"][on.argmax()]) if on.any() else math.inf
    away = float(rows["t"][free.argmax()]) if free.any() else math.inf
    arrived = bool(rows["arrived"][-1])
    touched = bool(rows["clearance"].min() < min(0.5 * Rules().hard_margin, gap) - 1e-6)
    return Released(number, pose, gap, min(away, back), back, arrived, touched)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=3000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--n", type=int, default=1000)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    began, found = time.process_time(), list[Released]()
    for number in range(args.first, args.first + args.n):
        found.append(released(args.seed, number))
        one = found[-1]
        if not (one.arrived and math.isfinite(one.back)) or one.touched:
            print(f"not well: {one}", flush=True)
        if len(found) % 100 == 0:
            print(f"{len(found)} of {args.n}", file=sys.stderr, flush=True)
    away, back = (np.array([getattr(one, name) for one in found]) for name in ("away", "back"))
    made = {
        "released": len(found),
        "away": int(np.isfinite(away).sum()),
        "back": int(np.isfinite(back).sum()),
        "arrived": sum(one.arrived for one in found),
        "touched": sum(one.touched for one in found),
        "away_median_s": float(np.median(away)),
        "away_99_s": float(np.quantile(away, 0.99)),
        "back_median_s": float(np.median(back)),
        "back_99_s": float(np.quantile(back, 0.99)),
        "processor_s": (time.process_time() - began) / len(found),
    }
    print(json.dumps(made, indent=1))
    if args.json:
        args.json.write_text(json.dumps(made, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
