"""The whole loop on published maps, in simulated time: `python -m benchmarks.closed_loop`.

The plant is the twin, driven by the software of real robots: `Session`, with gate, monitors,
planner and guard. The robot has the published map and its start, and the sensors that it has in
campaigns (LiDAR 2 cm, wheels 1.5 % wrong, drifting gyro). A published map is world and map at once;
*gone* removes 30 % of the walls from the world, *missing* from the map, *boxes* puts ten boxes by
the path that are on no map. Seeds below 100 may be tuned on; the tables count from 907 on.

    python -m benchmarks.closed_loop [--variant drawn,gone] [--only NAME] [--seeds 907:910]
        [--into benchmarks/counts/closed_loop.jsonl]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.places import errors, kept, laid, published  # noqa: E402
from cohelm.core.frames import placed  # noqa: E402
from cohelm.core.types import Floats  # noqa: E402
from cohelm.drive.factory import Simulated  # noqa: E402
from cohelm.drive.session import Session, SessionConfig  # noqa: E402
from cohelm.link.messages import Mode  # noqa: E402
from cohelm.perceive.localize.localization_map import LocalizationMap  # noqa: E402
from cohelm.plan.distance_field import swept_clearances  # noqa: E402
from cohelm.plan.elastic_band import tangents  # noqa: E402
from cohelm.plan.path_planner import PathParams  # noqa: E402
from cohelm.robot.gate.modes import GateMode  # noqa: E402
from cohelm.scenario.load import robot  # noqa: E402
from cohelm.scenario.model import Scenario  # noqa: E402
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, OccupancyMap, write_map  # noqa: E402
from cohelm.study.campaign.suites import sensed  # noqa: E402
from tests.perceive.buildings import Artefacts, boxes, building, tour  # noqa: E402
from tests.perceive.drives import along  # noqa: E402

SPEED = 0.5  # [m/s], or three quarters of what the robot can
ROBOTS = ("sally", "turtlebot3_waffle")
"""Each map is driven by the first robot that fits through its whole path: a robot of 0.72 m does
not fit on the map of a desk."""
ROOM, TIGHT = 0.38, 0.33  # from the way to what stands; where there is no other way [m]


class Site(NamedTuple):
    """scenario: with the true world. known: the robot's map."""

    name: str
    scenario: Scenario
    known: LocalizationMap


class LoopResult(NamedTuple):
    name: str
    arrived: bool
    way: float
    """True distance driven [m]."""
    time: float
    """[s]"""
    least: float
    """Smallest clearance while the robot moved [m]."""
    rms: float
    """Errors while not lost [m]."""
    at_99: float
    largest: float
    lost: float
    """Share of the time."""
    wrong: float
    """Share of the time, farther off than WRONG but not lost."""
    longest: float
    """Longest spell of that [s]."""
    mode: str
    spells: tuple[str, ...]
    """The reported reason of each spell lost."""


def carried(name: str) -> dict[str, object]:
    """A robot with the sensors of campaigns, without a camera."""
    model = robot(name)
    fitted = sensed(model).model_copy(update={"camera": None})
    return fitted.model_dump(mode="json", exclude_none=True)


def fitting(made: OccupancyMap, way: list[tuple[float, float]]) -> str:
    """The first robot that fits through, with the planner's clearance [m]."""
    cells = np.argwhere(made.cells >= OCCUPIED)[:, ::-1]
    stands = placed((cells + 0.5) * made.resolution, made.origin)
    line = tangents(np.vstack([np.linspace(a, b, 7, endpoint=False) for a, b in pairwise(way)]))
    for name in ROBOTS[:-1]:
        if (
            swept_clearances(stands, np.array(robot(name).footprint_m), line).min()
            >= PathParams().clearance
        ):
            return name
    return ROBOTS[-1]


def on_a_map(
    name: str, made: OccupancyMap, seed: int, variant: str, length: float, folder: Path
) -> Site:
    """A drive through a published map."""
    place = laid(name, made)
    size = int((place.clear > ROOM).sum())
    way = tour(place, seed, length, ROOM if size > 20_000 else TIGHT)
    world, known = made, made
    if variant == "gone":
        world = without_walls(made, 0.3, seed)
    elif variant == "missing":
        known = without_walls(made, 0.3, seed)
    walls = boxes(place, along(way, SPEED)[0], 10, seed) if variant == "boxes" else []
    write_map(folder, world)
    about = {"world": {"kind": "map", "file": str(folder / "map.yaml")}}
    by = fitting(made, way)
    called = f"{name}, {seed}" if by == ROBOTS[0] else f"{name} ({by}), {seed}"
    return Site(called, scenario(name, way, walls, seed, about, by), known.known())


def in_a_building(seed: int, variant: str, length: float) -> Site:
    """A drive through a generated building."""
    share = {"gone": {"gone": 0.3}, "missing": {"missing": 0.3}}
    place = building(seed, Artefacts(**share.get(variant, {})))
    way = tour(place, seed, length, ROOM)
    walls = place.walls
    if variant == "boxes":
        walls = np.vstack((walls, boxes(place, along(way, SPEED)[0], 10, seed)))
    return Site(place.name, scenario(place.name, way, walls, seed, {}), place.known)


def scenario(
    name: str, way: list[tuple[float, float]], walls: Floats | list[float], seed: int,
    about: dict[str, object], by: str = ROBOTS[0],
) -> Scenario:  # fmt: skip
    speed = min(SPEED, 0.75 * robot(by).limits.speed_mps)
    return Scenario.model_validate({
        "name": name, "robot": carried(by),
        "reference": {"speed_mps": speed, "waypoints_m": way},
        "law": {"filter": "guard", "tracking": {"k_x": 0.9, "k_psi": 2.0}},
        "walls_m": [tuple(w) for w in np.asarray(walls).tolist()],
        "simulation": {"step_s": 0.02, "seed": seed}, **about,
    })  # fmt: skip


def without_walls(made: OccupancyMap, share: float, seed: int) -> OccupancyMap:
    """The map with a share of its occupied cells set free, in pieces of 0.3 to 2 m."""
    rng = np.random.default_rng([seed, 4])
    cells = made.cells.copy()
    solid = np.argwhere(cells >= OCCUPIED)
    there = np.ones(len(solid), dtype=bool)
    while there.mean() > 1.0 - share:
        middle = solid[rng.choice(np.flatnonzero(there))]
        half = 0.5 * rng.uniform(0.3, 2.0) / made.resolution
        there &= np.hypot(*(solid - middle).T) > half
    cells[tuple(solid[~there].T)] = FREE
    return OccupancyMap(cells, made.resolution, made.origin)


def driven(site: Site) -> LoopResult:
    """Drive until it arrives, the time is over, or it faults."""
    made = Simulated(site.scenario, "twin", real_time=False, seed=site.scenario.simulation.seed)
    limit = 2.0 * site.scenario.reference.spline().duration + 30.0
    rows: list[tuple[float, float, float, float, bool]] = []
    lost_at: list[tuple[float, str]] = []
    with Session(SessionConfig(made, known=site.known)) as session:
        gated, loop = session.loop.gated, session.loop

        def until(_: object) -> bool:
            now, truth, seen = gated.now(), gated.truth(), loop.seen
            assert seen is not None
            off = math.hypot(seen.pose.x - truth.pose.x, seen.pose.y - truth.pose.y)
            rows.append((now, *truth.pose[:2], off, seen.lost))
            if seen.lost:
                lost_at.append((now, f"{truth.pose.x:.1f} {truth.pose.y:.1f}: {seen.reason}"))
            stopped = GateMode(gated.gate.mode) == GateMode.FAULTED
            return loop.driver.arrived or now > limit or stopped

        session.run(until, Mode.AUTOMATIC)
        arrived, least = loop.driver.arrived, gated.truth().least_moving
        mode = "" if arrived else f"{GateMode(gated.gate.mode).name} {gated.gate.reason}"
    t = np.array(rows)
    return LoopResult(
        site.name, arrived, float(np.hypot(*np.diff(t[:, 1:3], axis=0).T).sum()), t[-1, 0], least,
        *errors(t[:, 3], t[:, 4] > 0.0, session.plan.period), mode, spells(lost_at),
    )  # fmt: skip


def spells(lost_at: list[tuple[float, str]]) -> tuple[str, ...]:
    """Spells lost: start, duration, place, and first reason."""
    found: list[str] = []
    begun = last = -math.inf
    why = ""
    for now, reason in [*lost_at, (math.inf, "")]:
        if now > last + 0.05:
            if why:
                found.append(f"{begun:.1f} s, for {last - begun:.1f} s, at {why}")
            begun, why = now, reason
        last = now
    return tuple(found)


HEAD = (
    f"{'':34s} {'arrived':>7s} {'way':>5s} {'time':>6s} {'gap':>5s} {'rms':>6s} {'99 %':>6s} "
    f"{'max':>7s} {'lost':>6s} {'wrong':>6s} {'longest':>7s}"
)


def summary(r: LoopResult) -> str:
    return (
        f"{r.name:34s} {'yes' if r.arrived else 'NO':>7s} {r.way:5.0f} {r.time:6.0f} "
        f"{100 * r.least:5.1f} {100 * r.rms:6.2f} {100 * r.at_99:6.1f} {100 * r.largest:7.1f} "
        f"{100 * r.lost:5.1f}% {100 * r.wrong:5.2f}% {r.longest:6.1f}s {r.mode}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="")
    parser.add_argument("--into", type=Path, help="file of results to add a line a drive to")
    parser.add_argument("--variant", default="drawn", help="drawn,gone,missing,boxes")
    parser.add_argument("--seeds", default="907:910", help="of drives on each map")
    parser.add_argument("--buildings", default="0:0", help="seeds of generated ones")
    parser.add_argument("--length", type=float, default=110.0, help="of a drive [m]")
    parser.add_argument("--why", action="store_true", help="tell each time that it was lost")
    given = parser.parse_args()
    seeds, numbers = (
        range(*(int(n) for n in text.split(":"))) for text in (given.seeds, given.buildings)
    )
    for variant in given.variant.split(","):
        print(f"\n{variant}, in cm\n{HEAD}", flush=True)
        with TemporaryDirectory() as folder:
            sites = (
                on_a_map(name, make(), seed, variant, given.length, Path(folder))
                for name, make in published().items() for seed in seeds if given.only in name
            )  # fmt: skip
            for site in sites:
                shown(site, variant, given)
        for seed in numbers:
            shown(in_a_building(seed, variant, given.length), variant, given)


def shown(site: Site, variant: str, given: argparse.Namespace) -> None:
    begun = time.process_time()
    found = driven(site)
    kept(given.into, {"variant": variant, **found._asdict()})
    print(f"{summary(found)}  ({time.process_time() - begun:.0f} s)", flush=True)
    for spell in found.spells if given.why else ():
        print(f"    lost at {spell}", flush=True)


if __name__ == "__main__":
    main()
