"""`barn`: the BARN challenge's worlds by the LiDAR alone, judged by its rules; see `about`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.law.govern import PaceParams
from cohelm.law.reference import through
from cohelm.plan.elastic_band import spread
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.load import robot
from cohelm.scenario.worlds.barn import Barn, read_barn, read_collection
from cohelm.sim.setup import with_pilot
from cohelm.sim.world import Body, world
from cohelm.study.campaign.data import data_folder
from cohelm.study.campaign.episode import PAPER, Episode, EpisodeGoal, crossing

SPEED = 1.5
"""Of the reference, where there is room [m/s]."""

LIDAR = LidarModel(noise_m=0.01, mount_x_m=0.12, rate_hz=30.0)
"""As the challenge's: 720 beams over 270 degrees."""

PACE = PaceParams(lateral=2.5, yaw_rate=3.0, deceleration=3.0, rise=4.0, fall=8.0)
GAINS = PAPER._replace(k_x=1.0, k_psi=5.0, u_d=SPEED)
"""Of the pilot: Jackal is quicker than the paper's robot. The paper's law has its own."""


def files(folder: Path) -> tuple[Path, list[Path]]:
    """The folder that the worlds are in, which may be `barn` in the given one; and those files in
    it that are of worlds."""
    inside = data_folder(folder, "barn")
    if (inside / "worlds.json").exists():
        return inside, [inside / "worlds.json"]
    return inside, sorted([*inside.rglob("world_*.world*"), *inside.rglob("path_*.npy")])


def read(folder: Path) -> tuple[Barn, ...]:
    """The worlds in a folder, or in `barn` in it: worlds.json, or pairs as the challenge has them,
    world_N.world (or .gz) and path_N.npy.

    Raises CohelmError where there are none.
    """
    inside, there = files(folder)
    reach = robot("jackal").reach
    if there == [inside / "worlds.json"]:
        found = read_collection(there[0], reach)
        return tuple(found[number] for number in sorted(found))
    pairs = {
        int(file.name.split(".")[0].removeprefix("world_")): file
        for file in there
        if file.name.split(".")[0].removeprefix("world_").isdigit()
    }
    worlds: list[Barn] = []
    for number, file in sorted(pairs.items()):
        paths = sorted(inside.rglob(f"path_{number}.npy"))
        if not paths:
            raise CohelmError(f"{file}: there is no path_{number}.npy in {inside}; fetch it too")
        worlds.append(read_barn(file, paths[0], reach, number))
    if not worlds:
        raise CohelmError(
            f"{inside}: has neither worlds.json nor world_N.world with path_N.npy; give the folder "
            "of the BARN challenge's worlds with --data"
        )
    return tuple(worlds)


def case(worlds: tuple[Barn, ...], seed: int, number: int) -> Episode:
    """Episode `number` of the campaign with this seed."""
    barn = worlds[number % len(worlds)]
    jackal = robot("jackal")
    bodies = [Body((d[0], d[1], 0.0, 0.0, d[4], d[5])) for d in barn.discs.tolist()]
    setup = crossing(
        jackal, barn.start, barn.goal, through(spread(barn.route, 0.5), SPEED),
        world((bodies, barn.walls)), tuple(f"cylinder_{i}" for i in range(len(bodies))),
        barn.time_limit,
        int(np.random.default_rng([seed, number // len(worlds)]).integers(2**31)),
    )  # fmt: skip
    setup = replace(setup, start=barn.start)
    goal = EpisodeGoal(*barn.goal, barn.near_goal, barn.optimal_time)
    piloted = with_pilot(setup, PACE, (LIDAR,), gains=GAINS)
    return Episode("barn", number, f"world {barn.number}", piloted, goal, robot=jackal)
