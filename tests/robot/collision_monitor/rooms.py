"""The collision monitor alone: random rooms where everything stands, and no filter at all.

`python -m tests.robot.collision_monitor.rooms [--n 1000] [--seed 7000] [--seconds 12]`

Rooms are those of the campaign `random` without the walkers; the robot is Sally in the kinematic
simulator, in simulated time, behind the real gate (`LocalGatedRobot`). What asks for motion keeps
clear of nothing, in a different way in every room of four: it heads for the goal, and backs out a
little wherever it got stuck; deflects at random; drives full ahead and steers at random; makes
for what is nearest.

`--all-round`: the LiDAR looks all round; else it is Sally's, which sees 270 degrees. `--ahead`:
nothing backs, as what stands behind may never have been seen. `--off`: without the monitor.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from cohelm.core.types import RADIUS, Floats, Pose, Twist, X, Y
from cohelm.robot.gate.gate import Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import Body, World, world
from cohelm.study.campaign.episode import Episode
from cohelm.study.campaign.rooms import case
from cohelm.study.campaign.suites import with_all_round_lidar

PERIOD = 0.02
KINDS = ("for the goal", "at random", "full ahead", "at the nearest")


class Driven(NamedTuple):
    """What came of one room."""

    number: int
    kind: str
    hit: float
    """The fastest point of the outline when it overlapped anything, 0 without contact [m/s]."""
    at: float
    """When that was [s]."""
    least: float
    """The smallest clearance while it moved [m]."""
    acted: int
    """Periods in which the monitor restricted."""
    periods: int
    way: float
    """[m]"""
    faulted: str


class Wants:
    """Proposals of one kind."""

    def __init__(self, kind: str, drawn: Episode, around: World, seed: int) -> None:
        self._kind, self._goal = kind, drawn.goal
        self._discs = around.discs
        self._random = np.random.default_rng([seed, drawn.number])
        self._until, self._twist = -math.inf, Twist(0.0, 0.0)
        self._stuck = 0.0

    def twist(self, now: float, pose: Pose, moving: Twist) -> Twist:
        """What is asked for now."""
        draw = self._random.uniform
        if self._kind == "at random":
            if now >= self._until:
                self._until = now + draw(0.2, 2.0)
                self._twist = Twist(draw(-1.0, 1.0), draw(-2.0, 2.0))
            return self._twist
        if self._kind == "full ahead":
            if now >= self._until:
                self._until = now + draw(0.2, 1.5)
                self._twist = Twist(1.0 if draw() < 0.8 else -1.0, draw(-0.8, 0.8))
            return self._twist
        if now < self._until:
            return self._twist
        still = abs(moving.v) < 0.02 and abs(moving.omega) < 0.05
        self._stuck = self._stuck + PERIOD if still else 0.0
        if self._stuck > 1.0:
            self._until, self._stuck = now + draw(0.5, 2.0), 0.0
            self._twist = Twist(draw(-0.8, 0.3), draw(-1.5, 1.5))
        x, y = (self._goal.x, self._goal.y) if self._kind == "for the goal" else self._near(pose)
        off = math.remainder(math.atan2(y - pose.y, x - pose.x) - pose.psi, 2.0 * math.pi)
        return Twist(0.8 * max(math.cos(off), 0.0), max(-1.5, min(1.5, 2.0 * off)))

    def _near(self, pose: Pose) -> tuple[float, float]:
        d = self._discs
        i = int((np.hypot(d[:, X] - pose.x, d[:, Y] - pose.y) - d[:, RADIUS]).argmin())
        return float(d[i, X]), float(d[i, Y])


def standing(drawn: Episode) -> World:
    """Its room without the walkers."""
    around = drawn.setup.obstacles
    bodies = [
        Body(tuple(row)) for row, name in zip(around.discs.tolist(), drawn.setup.names, strict=True)
        if name.startswith("disc_")
    ]  # fmt: skip
    return world((bodies, around.walls))


def drive(
    number: int, seed: int, *, seconds: float = 12.0, all_round: bool = False, ahead: bool = False,
    watched: bool = True,
) -> Driven:  # fmt: skip
    """One room."""
    drawn = case(seed, number)
    around, kind = standing(drawn), KINDS[number % len(KINDS)]
    model: RobotModel = robot("sally")
    model = with_all_round_lidar(model) if all_round else model
    simulated = Kinematic(model, drawn.setup.start, around, seed=number)
    kept = LocalGatedRobot(simulated, rules(model, PERIOD), None, None if watched else ())
    wants = Wants(kind, drawn, around, seed)
    truth, hit, at, acted, way, before = simulated.truth(), 0.0, math.nan, 0, 0.0, 0.0
    n = round(seconds / PERIOD)
    for k in range(n):
        kept.wait(k * PERIOD)
        readings = kept.read()
        truth = simulated.truth()
        speed = abs(truth.twist.v) + abs(truth.twist.omega) * model.reach
        if truth.clearance < 0.0 and max(speed, before) > hit:
            hit, at = max(speed, before), k * PERIOD
        before = speed
        way += abs(truth.twist.v) * PERIOD
        asked = Twist(0.0, 0.0)
        if k > 10:
            asked = wants.twist(k * PERIOD, truth.pose, truth.twist)
            asked = asked._replace(v=max(asked.v, 0.0)) if ahead else asked
        passed = kept.propose(Proposal(k, readings.odometry.stamp, asked))
        acted += passed.reason.startswith("collision monitor")
        if k == 10:
            assert kept.drive(GateMode.SHARED) == ""
    return Driven(
        number, kind, hit, at, truth.least_moving, acted, n, way, kept.gate.reason
    )  # fmt: skip


def main() -> None:
    """Drive them, and say what came of it."""
    ask = argparse.ArgumentParser()
    ask.add_argument("--n", type=int, default=1000)
    ask.add_argument("--first", type=int, default=0)
    ask.add_argument("--seed", type=int, default=7000)
    ask.add_argument("--seconds", type=float, default=12.0)
    ask.add_argument("--jobs", type=int, default=1)
    ask.add_argument("--all-round", action="store_true")
    ask.add_argument("--ahead", action="store_true")
    ask.add_argument("--off", action="store_true")
    given = ask.parse_args()
    one = partial(
        drive, seed=given.seed, seconds=given.seconds, all_round=given.all_round,
        ahead=given.ahead, watched=not given.off,
    )  # fmt: skip
    numbers = range(given.first, given.first + given.n)
    if given.jobs > 1:
        with ProcessPoolExecutor(given.jobs) as pool:
            rows = list(pool.map(one, numbers, chunksize=4))
    else:
        rows = [one(number) for number in numbers]
    for kind in KINDS:
        of = [row for row in rows if row.kind == kind]
        if not of:
            continue
        hits: Floats = np.array([row.hit for row in of])
        print(
            f"{kind}: {len(of)} rooms, {sum(row.way for row in of):.0f} m, contacts "
            f"{int((hits > 0).sum())}, faster than 0.1 m/s {int((hits > 0.1).sum())}, fastest "
            f"{hits.max():.2f} m/s; acted in "
            f"{100 * sum(row.acted for row in of) / sum(row.periods for row in of):.1f} %; "
            f"faults {sum(bool(row.faulted) for row in of)}"
        )
    for row in rows:
        if row.hit > 0.1 or row.faulted:
            print(row)


if __name__ == "__main__":
    main()
