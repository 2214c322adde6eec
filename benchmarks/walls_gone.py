"""Drives where a share of the walls is gone, by a robot that stands while it is lost.

`python -m benchmarks.walls_gone`: the localisation of `closed_loop --variant gone`, by perception
alone and in a fraction of the time. The robot follows its path exactly, brakes to a stand as soon
as it is lost, and drives on once it is localised: a standing robot sees nothing new. A drive ends
after STANDING seconds of standing.

    python -m benchmarks.walls_gone [--only NAME] [--seeds 3100:3103] [--length 110] [--share 0.3]
        [--into FILE]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.closed_loop import ROOM, TIGHT, fitting, spells, without_walls  # noqa: E402
from benchmarks.places import SALLY, errors, kept, laid, published  # noqa: E402
from cohelm.core.types import Pose, Twist  # noqa: E402
from cohelm.perceive.pipeline import Perception, warm_up  # noqa: E402
from cohelm.robot.kinematics import arc  # noqa: E402
from cohelm.robot.model import RobotModel  # noqa: E402
from cohelm.robot.port import Odometry, Readings, Scan  # noqa: E402
from cohelm.scenario.load import robot  # noqa: E402
from cohelm.scenario.worlds.maps import OccupancyMap  # noqa: E402
from cohelm.sim.grid import Grid  # noqa: E402
from cohelm.sim.lidar import scan as cast  # noqa: E402
from tests.perceive.buildings import NO_DISCS, tour  # noqa: E402
from tests.perceive.drives import DELAY, DT, along  # noqa: E402

STANDING = 60.0  # [s]
SLOWING = 1.0  # [m/s^2]
SPEED = 0.5  # [m/s]
NO_WALLS = np.empty((0, 4))


class GoneResult(NamedTuple):
    """As in `closed_loop`, by perception alone; share: of the path that was driven."""

    name: str
    share: float
    rms: float
    at_99: float
    largest: float
    lost: float
    wrong: float
    longest: float
    spells: tuple[str, ...]


class World(NamedTuple):
    """The path through the world, and its obstacles."""

    poses: list[Pose]
    twists: list[Twist]
    grid: Grid


def driven(world: World, perception: Perception, model: RobotModel, seed: int) -> Iterator:
    """True poses and estimates, at every period."""
    assert model.lidar is not None
    rng, lidar = np.random.default_rng(seed), model.lidar.lidar()
    scale = 1.0 + 0.015 * rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.3)
    bias = math.radians(0.02) * rng.choice([-1.0, 1.0])
    every, n = round(1.0 / (model.lidar.rate_hz * DT)), len(lidar.beams)
    odom, truth, past = Pose(0.3, -0.2, 0.5), world.poses[0], [world.poses[0]]
    at, pace, k, waiting, scan = 0.0, 0.0, 0, [], None
    lost = True
    while at < len(world.twists) - 1:
        now = k * DT
        pace = min(max(pace + (-1 if lost else 1) * SLOWING / SPEED * DT, 0.0), 1.0)
        index = int(at)
        twist = Twist(world.twists[index].v * pace, world.twists[index].omega * pace)
        at += pace
        truth = arc(world.poses[index], world.twists[index], (at - index) * DT)
        noisy = Twist(
            twist.v * scale + (0.003 * rng.normal() if twist.v else 0.0),
            twist.omega + bias + math.radians(0.1) * rng.normal(),
        )
        odom = arc(odom, noisy, DT)
        past = [*past[-8:], truth]
        if k % every == 0:
            ranges, piece = np.empty(n), np.empty(n)
            for p in range(4):  # over 80 ms, the newest last
                a, b = p * n // 4, (p + 1) * n // 4
                there = past[max(len(past) - 4 + p, 0)]
                cast(there, lidar, NO_DISCS, NO_WALLS, world.grid, seed, k // every, piece)
                ranges[a:b] = piece[a:b]
            waiting.append((now + DELAY, Scan(now - 3.5 * DT, k // every, ranges, 4 * DT)))
        while waiting and waiting[0][0] <= now + 1e-9:
            scan = waiting.pop(0)[1]
        seen = perception.take(now, Readings(Odometry(now, odom, noisy), scan, None, None))
        lost = seen.lost
        yield now, truth, seen, at / (len(world.twists) - 1)
        k += 1


def followed(name: str, made: OccupancyMap, seed: int, length: float, share: float) -> GoneResult:
    place = laid(name, made)
    size = int((place.clear > ROOM).sum())
    way = tour(place, seed, length, ROOM if size > 20_000 else TIGHT)
    by = fitting(made, way)
    model = SALLY if by == "sally" else robot(by)
    poses, twists = along(way, SPEED)
    world = World(poses, twists, without_walls(made, share, seed).grid())
    perception = Perception(model, place.known, poses[0])
    off, lost, lost_at, stood, done = [], [], [], 0.0, 0.0
    for now, truth, seen, done in driven(world, perception, model, seed):  # noqa: B007
        off.append(math.hypot(seen.pose.x - truth.x, seen.pose.y - truth.y))
        lost.append(seen.lost)
        stood = stood + DT if seen.lost else 0.0
        if seen.lost:
            lost_at.append((now, f"{truth.x:.1f} {truth.y:.1f}: {seen.reason}"))
        if stood > STANDING:
            break
    name = f"{name}, {seed}" if by == "sally" else f"{name} ({by}), {seed}"
    return GoneResult(name, done, *errors(np.array(off), np.array(lost), DT), spells(lost_at))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", default="3100:3103", help="of drives on each map")
    parser.add_argument("--length", type=float, default=110.0, help="of a drive [m]")
    parser.add_argument("--share", type=float, default=0.3, help="of the walls that is gone")
    parser.add_argument("--into", type=Path, help="file of results to add a line a drive to")
    given = parser.parse_args()
    warm_up(SALLY, mapped=True)
    first, last = (int(n) for n in given.seeds.split(":"))
    for seed in range(first, last):
        for name, make in published().items():
            if given.only not in name:
                continue
            begun = time.process_time()
            r = followed(name, make(), seed, given.length, given.share)
            kept(given.into, {"variant": "gone", **r._asdict()})
            print(
                f"{r.name:44s} {100 * r.share:5.0f}% {100 * r.rms:6.2f} {100 * r.at_99:6.1f} "
                f"{100 * r.largest:7.1f} lost {100 * r.lost:5.1f}% wrong {100 * r.wrong:5.2f}% "
                f"{r.longest:6.1f}s ({time.process_time() - begun:.0f} s)",
                flush=True,
            )
            for spell in r.spells:
                print(f"    lost at {spell}", flush=True)


if __name__ == "__main__":
    main()
