"""Localisation on published maps and in generated buildings: `python -m benchmarks.places`.

Perception alone, along synthetic drives: scans are cast in the true world, the robot has the map.
Published maps are read where they are there, beside the checkout; such a map is world and map
at once, as in a simulator. Buildings are drawn by `tests/perceive/buildings.py`; seeds below 100
may be tuned on, those from 100 on are for the table in docs/perceive.md.

    python -m benchmarks.places [drives] [beside] [kidnaps] [cold] [foreign] [mapping] [--only NAME]
        [--seeds 100:105]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from scipy import ndimage  # noqa: E402

from benchmarks.other_localizers import Other, ParticleFilter, PlainIcp  # noqa: E402
from cohelm.core.frames import between, compose  # noqa: E402
from cohelm.core.types import Floats, Pose, Twist, disc, discs  # noqa: E402
from cohelm.perceive.map.mapper import Mapper  # noqa: E402
from cohelm.perceive.pipeline import Perception, warm_up  # noqa: E402
from cohelm.robot.sensors import LidarModel  # noqa: E402
from cohelm.scenario.load import robot  # noqa: E402
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap, read_map  # noqa: E402
from tests.perceive.buildings import (  # noqa: E402
    NO_DISCS,
    Artefacts,
    Place,
    boxes,
    building,
    loop_errors,
    surveying,
    tour,
)
from tests.perceive.drives import DT, LIDAR, Moment, Shift, along, drive, shifted  # noqa: E402

DATA = ROOT.parent / "shared" / "data" / "maps"
SALLY = robot("sally").model_copy(update={"lidar": LIDAR})
POOR = LidarModel(
    beams=180, field_of_view_deg=270.0, range_max_m=12.0, rate_hz=5.0, noise_m=0.05, mount_x_m=0.3
)
WRONG = 0.3
"""Farther off than this a pose is wrong [m]."""
SLOW = 10.0
"""99 % of scans should take no longer [ms]."""
NO_WALLS: Floats = np.empty((0, 4))


class Result(NamedTuple):
    name: str
    way: float
    """[m]"""
    rms: float
    at_99: float
    largest: float
    lost: float
    """Shares of the time."""
    wrong: float
    """Wrong but not lost."""
    longest: float
    """Longest spell wrong but not lost [s]."""
    sigmas: float
    """Error over reported sigma, 95 %."""
    ms: float
    """Processor time of a scan, median, and 99 %."""
    ms_99: float
    slow: float
    """Share of the scans that took longer than SLOW."""
    end: float
    """Error at the end [m]; inf if lost."""


class Errors(NamedTuple):
    """Errors of reported poses while not lost [m]; shares of the time."""

    rms: float
    at_99: float
    largest: float
    lost: float
    wrong: float
    """Farther off than WRONG, but not lost."""
    longest: float
    """Longest spell of that [s]."""


def errors(off: Floats, lost: NDArray[np.bool_], period: float) -> Errors:
    """off: (n,), errors at steps of `period` [m, s]. lost: (n,), whether it was reported lost."""
    sure = off[~lost] if not lost.all() else np.array([math.nan])
    wrong = (off > WRONG) & ~lost
    run = longest = 0
    for flag in wrong:
        run = run + 1 if flag else 0
        longest = max(longest, run)
    return Errors(
        float(np.sqrt((sure**2).mean())), float(np.quantile(sure, 0.99)), float(sure.max()),
        float(lost.mean()), float(wrong.mean()), longest * period,
    )  # fmt: skip


def published() -> dict[str, Callable[[], OccupancyMap]]:
    """The published maps that are available."""
    found: dict[str, Callable[[], OccupancyMap]] = {}
    for file in sorted(DATA.glob("*.yaml")):
        found[file.stem] = lambda file=file: read_map(file)
    listed = DATA / "maps.json"
    for name, about in json.loads(listed.read_text()).items() if listed.exists() else ():
        found[name] = lambda about=about: pictured(about)
    return found


def pictured(about: dict[str, Any]) -> OccupancyMap:
    pixels = np.flipud(np.asarray(Image.open(DATA / about["png"]).convert("L")))
    cells = np.full(pixels.shape, UNKNOWN, dtype=np.int8)
    cells[pixels == 0], cells[pixels == 255] = OCCUPIED, FREE
    return OccupancyMap(cells, about["resolution"], Pose(*about["origin_xy"], 0.0))


def laid(name: str, made: OccupancyMap) -> Place:
    """A published map as a world."""
    assert made.origin.psi == 0.0
    every = max(round(0.1 / made.resolution), 1)
    side = every * made.resolution
    clear = ndimage.distance_transform_edt(made.cells == FREE) * made.resolution
    clear = clear[every // 2 :: every, every // 2 :: every]
    assert abs(side - 0.1) < 1e-9
    return Place(name, NO_WALLS, made.grid(), made.known(), clear, np.array(made.origin[:2]))


def followed(
    place: Place, way: list[tuple[float, float]], seed: int, *, boxed: int = 0,
    model: LidarModel = LIDAR, error: float = 0.015, speed: float = 0.5,
    other: type[Other] | None = None, name: str = "",
) -> Result:  # fmt: skip
    """A drive with known start, by our perception or by another method."""
    poses, twists = along(way, speed)
    walls = place.walls
    if boxed:
        walls = np.vstack((walls, boxes(place, poses, boxed, seed)))
    perception = (
        Perception(SALLY.model_copy(update={"lidar": model}), place.known, poses[0])
        if other is None else other(model.lidar(), place.known, poses[0])
    )  # fmt: skip
    off, lost, sigmas, times = [], [], [], []
    trace = []
    for moment in drive(
        poses, twists, seed, around=NO_DISCS, walls=walls, grid=place.grid, model=model,
        error=error,
    ):  # fmt: skip
        begun = time.thread_time()
        seen = perception.take(moment.now, moment.readings)
        took = 1e3 * (time.thread_time() - begun)
        if not moment.scanned:
            continue
        times.append(took)
        e = np.array([seen.pose.x - moment.truth.x, seen.pose.y - moment.truth.y])
        off.append(float(np.hypot(*e)))
        lost.append(seen.lost)
        sigmas.append(math.sqrt(max(float(e @ np.linalg.solve(seen.covariance[:2, :2], e)), 0.0)))
        if TRACE:
            trace.append((moment.now, *moment.truth, *seen.pose, seen.lost, seen.reason))
    if TRACE:
        traces.append((name or place.name, seed, trace))
    away = np.array(lost)
    return Result(
        name or place.name, 0.5 * len(poses) * DT,
        *errors(np.array(off), away, 1.0 / model.rate_hz),
        float(np.quantile(np.array(sigmas)[~away], 0.95)) if not away.all() else math.nan,
        float(np.median(times)), float(np.quantile(times, 0.99)),
        float((np.array(times) > SLOW).mean()), math.inf if lost[-1] else off[-1],
    )  # fmt: skip


def kept(path: Path | None, row: dict[str, object]) -> None:
    """A line of a results file, from which `tools/tables.py` writes the tables of the docs; `code`
    is the fingerprint of the perception."""
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({**row, "code": CODE}) + "\n")


def fingerprint(folder: Path) -> str:
    """Fingerprint of the code in a folder: counts are valid for one code only."""
    whole = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        whole.update(file.read_bytes())
    return whole.hexdigest()[:8]


CODE = fingerprint(ROOT / "src" / "cohelm" / "perceive")


def timed(ms: list[float]) -> dict[str, float]:
    """Processor time of scans: number, median [ms], share of them above 10 ms."""
    a = np.array(ms)
    return {"scans": len(a), "ms": float(np.median(a)), "slow": float((a > SLOW).mean())}


TRACE = False
traces: list[Any] = []
HEAD = (
    f"{'':44s} {'way':>5s} {'rms':>6s} {'99 %':>6s} {'max':>7s} {'lost':>6s} {'wrong':>6s} "
    f"{'longest':>7s} {'e/s 95':>6s} {'ms':>5s} {'99 %':>5s} {'end':>6s}"
)


def summary(r: Result) -> str:
    return (
        f"{r.name:44s} {r.way:5.0f} {100 * r.rms:6.1f} {100 * r.at_99:6.1f} "
        f"{100 * r.largest:7.1f} {100 * r.lost:5.1f}% {100 * r.wrong:5.1f}% {r.longest:6.1f}s "
        f"{r.sigmas:6.1f} {r.ms:5.2f} {r.ms_99:5.1f} {100 * r.end:6.1f}"
    )


VARIANTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "as drawn": ({}, {}),
    "ten new boxes": ({}, {"boxed": 10}),
    "30 % missing on the map": ({"missing": 0.3}, {}),
    "30 % drawn, but gone": ({"gone": 0.3}, {}),
    "odometry 5 %, 5 cm, 180 beams, 5 Hz": ({}, {"model": POOR, "error": 0.05}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tables", nargs="*", default=["drives"])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--variant", default="")
    parser.add_argument("--seeds", default="100:104", help="of buildings")
    parser.add_argument("--drives", type=int, default=3, help="on each published map")
    parser.add_argument("--length", type=float, default=120.0)
    parser.add_argument(
        "--seed", type=int, default=907, help="of what is driven; of drives, the first"
    )
    parser.add_argument("--count", type=int, default=0, help="of kidnaps on each map")
    parser.add_argument("--senses", default="", choices=SENSES, help="of kidnaps and cold starts")
    parser.add_argument("--alike", action="store_true", help="buildings whose rooms look alike")
    parser.add_argument("--into", type=Path, help="file of results to add a line a drive to")
    given = parser.parse_args()
    first, last = (int(n) for n in given.seeds.split(":"))
    warm_up(SALLY, mapped=True)
    if "drives" in given.tables:
        drives(given, first, last)
    if "beside" in given.tables:
        beside(given, first, last)
    if "kidnaps" in given.tables:
        kidnaps(given, first, last)
    if "cold" in given.tables:
        cold(given, first, last)
    if "foreign" in given.tables:
        foreign(given, first, last)
    if "mapping" in given.tables:
        for alike in (False, True):
            mapping(first, last, alike)


def drives(given: argparse.Namespace, first: int, last: int) -> None:
    """Drives with known start, with errors of maps and sensors."""
    print(HEAD)
    rows: dict[str, list[Result]] = {}
    variants = {name: how for name, how in VARIANTS.items() if given.variant in name}

    def one(place: Place, seed: int, length: float, room: float, variant: str) -> None:
        way, how = tour(place, seed, length, room), VARIANTS[variant][1]
        found = followed(place, way, seed, name=f"{place.name}, {seed}, {variant}", **how)
        row = {"variant": variant, **found._asdict(), "name": place.name, "seed": seed}
        kept(given.into, row)
        rows.setdefault(variant, []).append(found)
        print(summary(found), flush=True)

    for name, make in published().items():
        if given.only not in name:
            continue
        place = laid(name, make())
        large = place.clear.size > 20_000
        for seed in range(given.seed, given.seed + given.drives):
            for variant, (artefacts, _) in variants.items():
                if not artefacts:
                    one(place, seed, *((given.length, 0.38) if large else (20.0, 0.3)), variant)
    for seed in range(first, last):
        for variant, (artefacts, _) in variants.items():
            if given.only in f"building {seed}":
                one(building(seed, Artefacts(**artefacts)), seed, given.length, 0.38, variant)
    print(HEAD)
    for variant, found in rows.items():
        print(summary(summed(variant, found)))


def mapping(first: int, last: int, alike: bool) -> None:
    """Buildings mapped from drives of 150 to 2000 m, with or without rooms that look alike."""
    print(f"{'':20s} {'way':>6s} {'mean':>7s} {'99 %':>7s} {'max':>7s} {'false':>6s} {'s/km':>6s}")
    for seed in range(first, last):
        lidar, seen, truth = surveying(seed, alike)
        way = float(np.hypot(*np.diff(np.array(truth)[:, :2], axis=0).T).sum())
        begun = time.process_time()
        survey = Mapper(lidar)
        for sweep in seen:
            survey.add(sweep)
        found = survey.finished()
        took = time.process_time() - begun
        off = loop_errors(found.poses, truth)
        name = f"building {seed}" + (", alike" if alike else "")
        if not len(off):
            print(f"{name:20s} {way:6.0f}  never came by again", flush=True)
            continue
        # of the pairs of scans that were closed, those that lie off the truth
        false = sum(
            math.hypot(*between(between(truth[a], truth[b]),
                                between(found.poses[a], found.poses[b]))[:2]) > WRONG
            for a, b in found.loops
        )  # fmt: skip
        print(
            f"{name:20s} {way:6.0f} {100 * off.mean():7.1f} {100 * np.quantile(off, 0.99):7.1f} "
            f"{100 * off.max():7.1f} {false:6d} {1e3 * took / way:6.1f}",
            flush=True,
        )


def beside(given: argparse.Namespace, first: int, last: int) -> None:
    """The same drives by our perception, a particle filter and plain ICP."""
    print(HEAD)
    methods = {"cohelm": None, "particle filter (AMCL)": ParticleFilter, "plain ICP": PlainIcp}
    rows: dict[tuple[str, str], list[Result]] = {}
    for place in places_of(given, first, last, small=True):
        large = place.clear.size > 20_000
        length, room = (given.length, 0.38) if large else (20.0, 0.3)
        way = tour(place, given.seed, length, room)
        for variant in ("as drawn", "ten new boxes"):
            if given.variant and given.variant not in variant:
                continue
            for name, method in methods.items():
                found = followed(
                    place, way, given.seed, other=method, name=f"{place.name}, {variant}, {name}",
                    **VARIANTS[variant][1],
                )  # fmt: skip
                row = {"variant": variant, "method": name, **found._asdict(), "name": place.name}
                kept(given.into, {**row, "seed": given.seed})
                rows.setdefault((variant, name), []).append(found)
                print(summary(found), flush=True)
    for (variant, name), found in rows.items():
        print(summary(summed(f"{variant}, {name}", found)))


def summed(name: str, rows: list[Result]) -> Result:
    """Summary of many drives: means of the shares, worst of the rest."""
    a = np.array([r[1:] for r in rows])
    return Result(
        f"{len(rows)} x {name}", a[:, 0].sum(), float(np.sqrt(np.nanmean(a[:, 1] ** 2))),
        float(np.nanmax(a[:, 2])), float(np.nanmax(a[:, 3])), a[:, 4].mean(), a[:, 5].mean(),
        a[:, 6].max(), float(np.nanmedian(a[:, 7])), float(np.median(a[:, 8])), a[:, 9].max(),
        a[:, 10].mean(), a[:, 11].max(),
    )  # fmt: skip


def places_of(given: argparse.Namespace, first: int, last: int, small: bool = False) -> list[Place]:
    found = [laid(name, make()) for name, make in published().items() if given.only in name]
    found = [p for p in found if small or p.clear.size > 20_000]
    wanted = [s for s in range(first, last) if given.only in f"building {s}"]
    return found + [building(s, alike=given.alike) for s in wanted]


KINDS = ("moved 2 m", "moved 2 m, turned", "told 1 m, 20 deg", "started 1 m, 20 deg")
SENSES: dict[str, dict[str, Any]] = {
    "": {}, "poor": {"model": POOR, "error": 0.05}, "people": {"people": 6},
}  # fmt: skip
"""Of kidnaps and cold starts: LiDAR, odometry, and walkers."""


class Kidnap(NamedTuple):
    """On a path, from step `start` on: after 3 s moved by `shift` at once, or given an initial pose
    that is off by `told`; or given that at its start, and no later."""

    start: int
    shift: Shift
    told: Pose | None
    seed: int
    at_start: bool = False


class WorstAttack(NamedTuple):
    """last: when it was last lost or more than 0.2 m off after the push [s]; longest: spell wrong
    but not lost [s]; trace: of each step since the push, time, truth, estimate, lost, reason; ms:
    time of each scan."""

    last: float
    longest: float
    trace: list[tuple[float, Pose, Pose, bool, str]]
    ms: list[float]


def pushed(place: Place, poses: list[Pose], kind: str, seed: int, count: int) -> list[Kidnap]:
    """A random push to where the rest of the path can be driven; turned, in any direction."""
    rng, found = np.random.default_rng([seed, 9]), []
    for _ in range(count):
        k = int(rng.integers(0, len(poses) - 600))
        shift, off = (0.0, 0.0, 0.0), None
        while kind.startswith("moved"):
            turn = rng.uniform(-math.pi, math.pi)
            shift = (2.0 * math.cos(turn), 2.0 * math.sin(turn), 0.0)
            if kind.endswith("turned"):
                shift = (*shift[:2], rng.uniform(-math.pi, math.pi))
            at, on = poses[k + 150], poses[k + 150 : k + 600 : 10]
            there = Pose(at.x + shift[0], at.y + shift[1], at.psi + shift[2])
            path = (compose(there, between(at, p)) for p in on)
            if all(_clear(place, p.x, p.y) > 0.25 for p in path):
                break
            k = int(rng.integers(0, len(poses) - 600))
        else:
            turn = rng.uniform(-math.pi, math.pi)
            psi = math.radians(20.0 * rng.choice([-1, 1]))
            off = Pose(math.cos(turn), math.sin(turn), psi)
        found.append(
            Kidnap(k, shift, off, int(rng.integers(1_000_000)), kind.startswith("started"))
        )
    return found


def walkers(way: list[Pose], count: int, seed: int) -> Callable[[float], Floats]:
    """Walkers to and fro beside the driven path, never nearer than 0.8 m to the robot."""
    rng, t = np.random.default_rng([seed, 11]), DT * np.arange(len(way))
    xy = np.array(way)[:, :2]
    found: list[Floats] = []

    def at(one: Floats, t: Floats | float) -> Floats:
        x, y, dx, dy, speed, begun = one
        leg = math.hypot(dx, dy)
        far = np.mod(begun + speed * np.asarray(t), 2.0 * leg)
        share = (leg - np.abs(far - leg)) / leg
        return np.stack((x + share * dx, y + share * dy), axis=-1)

    for _ in range(1000):
        if len(found) == count:
            break
        near = xy[rng.integers(len(xy))] + rng.uniform(-2.0, 2.0, 2)
        leg, turn = rng.uniform(1.0, 5.0), rng.uniform(-math.pi, math.pi)
        one = np.array([
            *near, leg * math.cos(turn), leg * math.sin(turn), rng.uniform(0.6, 1.4),
            rng.uniform(0.0, 10.0),
        ])  # fmt: skip
        if np.hypot(*(at(one, t) - xy).T).min() > 0.8:
            found.append(one)
    return lambda t: discs(*(disc(*at(one, t).tolist(), 0.2) for one in found))


def recovered(
    place: Place, poses: list[Pose], twists: list[Twist], one: Kidnap, *,
    model: LidarModel = LIDAR, error: float = 0.015, people: int = 0,
) -> WorstAttack:  # fmt: skip
    """9 s from the push on."""
    k = one.start
    way, off = poses[k : k + 600], one.told
    pushes = () if off else ((3.0, one.shift),)
    begun = _beside(way[0], off) if off and one.at_start else way[0]
    around = NO_DISCS
    if people:
        around = walkers(shifted(way, pushes), people, one.seed)
    perception = Perception(SALLY.model_copy(update={"lidar": model}), place.known, begun)
    from_ = 0.0 if one.at_start else 3.0
    last = run = longest = 0.0
    placed, trace, ms = one.at_start, [], []
    for moment in drive(
        way, twists[k : k + 599], one.seed, around=around, walls=place.walls, grid=place.grid,
        pushes=pushes, model=model, error=error,
    ):  # fmt: skip
        t = moment.truth
        if moment.now >= 3.0 and off and not placed:
            placed = True
            perception.place(_beside(t, off))
        clock = time.thread_time()
        seen = perception.take(moment.now, moment.readings)
        if moment.scanned:
            ms.append(1e3 * (time.thread_time() - clock))
        e = math.hypot(seen.pose.x - t.x, seen.pose.y - t.y)
        since = moment.now - from_
        if since < 0.1:
            continue
        if seen.lost or e > 0.2:
            last = since
        run = run + DT if not seen.lost and e > WRONG else 0.0
        longest = max(longest, run)
        trace.append((since, t, seen.pose, seen.lost, seen.reason))
    return WorstAttack(last, longest, trace, ms)


def circumstances(given: argparse.Namespace) -> str:
    """Disturbances of a drive."""
    return ", ".join(filter(None, (given.senses, "alike" if given.alike else "")))


def _beside(truth: Pose, off: Pose) -> Pose:
    return Pose(truth.x + off.x, truth.y + off.y, truth.psi + off.psi)


def kidnaps(given: argparse.Namespace, first: int, last: int) -> None:
    """Moved by 2 m at once while driving, turned as well or not; given a pose 1 m and 20 degrees
    off, or given that at its start."""
    print(
        f"{'':54s} {'found':>8s} {'in 3 s':>6s} {'median':>7s} {'99 %':>7s} {'last':>7s} "
        f"{'ms':>5s} {'99 %':>5s} wrong and sure > 1 s"
    )
    count = given.count or (5 if given.quick else 12)
    for place in places_of(given, first, last):
        poses, twists = along(tour(place, given.seed, 80.0 if given.quick else 160.0), 0.5)
        for kind in KINDS:
            if given.variant and kind not in given.variant.split(";"):
                continue
            times, ms, wrong = [], [], 0
            for one in pushed(place, poses, kind, given.seed, count):
                found = recovered(place, poses, twists, one, **SENSES[given.senses])
                times.append(found.last)
                ms += found.ms
                wrong += found.longest > 1.0
                if found.longest > 1.0 or found.last > 8.5:
                    print(
                        f"    from {one.start}: {found.last:.1f} s, wrong and sure for "
                        f"{found.longest:.1f} s",
                        flush=True,
                    )
                row = {"name": place.name, "kind": kind, "senses": circumstances(given)}
                row |= {"seed": given.seed, "start": one.start}
                row |= {"last": found.last, "longest": found.longest, **timed(found.ms)}
                kept(given.into, row)
            t = np.array(times)
            name = f"{place.name}, {kind}" + (f", {given.senses}" if given.senses else "")
            print(
                f"{name:54s} {(t < 8.5).sum():3d}/{count:3d} {(t < 3.0).sum():6d} "
                f"{np.median(t):6.2f}s {np.quantile(t, 0.99):6.2f}s {t.max():6.2f}s "
                f"{np.median(ms):5.2f} {np.quantile(ms, 0.99):5.1f} {wrong}",
                flush=True,
            )


def _clear(place: Place, x: float, y: float) -> float:
    j, i = ((np.array([x, y]) - place.low) / 0.1).astype(int)
    rows, columns = place.clear.shape
    return float(place.clear[i, j]) if 0 <= i < rows and 0 <= j < columns else 0.0


def cold(given: argparse.Namespace, first: int, last: int) -> None:
    """Started without a pose, and driven for 15 s, or until it has been right for two: twelve times
    on each map, four times in each building."""
    print(f"{'':44s} {'right within 10 s':>18s} {'median':>7s} ever wrong and sure")
    how = dict(SENSES[given.senses])
    people, model = how.pop("people", 0), how.get("model", LIDAR)
    times, wrongs = [], 0
    for place in places_of(given, first, last, small=True):
        large = place.clear.size > 20_000
        way = tour(place, given.seed, 160.0, 0.38 if large else 0.3)
        poses, twists = along(way, 0.5)
        rng = np.random.default_rng([given.seed, 10])
        count = given.count or (4 if place.walls.size else 12)
        own, wrong = [], 0
        for _ in range(count):
            k = int(rng.integers(0, len(poses) - 750))
            robot = SALLY.model_copy(update={"lidar": model})
            perception, first_right, bad = Perception(robot, place.known), math.inf, 0.0
            seed = int(rng.integers(1_000_000))
            on = poses[k : k + 750]
            around = walkers(on, people, seed) if people else NO_DISCS
            for moment in drive(
                on, twists[k : k + 749], seed, around=around, walls=place.walls, grid=place.grid,
                **how,
            ):  # fmt: skip
                seen = perception.take(moment.now, moment.readings)
                if seen.lost:
                    continue
                e = math.hypot(seen.pose.x - moment.truth.x, seen.pose.y - moment.truth.y)
                bad += DT if e > WRONG else 0.0
                if e < 0.2:
                    first_right = min(first_right, moment.now)
                if moment.now > first_right + 2.0:
                    break
            own.append(first_right)
            wrong += bad > 0.0
            row = {"name": place.name, "kind": "cold", "senses": circumstances(given)}
            row |= {"seed": given.seed, "start": k, "right": first_right, "wrong": bad}
            kept(given.into, row)
            if bad > 0.0 or first_right > 10.0:
                print(
                    f"    {place.name}, {seed}, from {k}: right at {first_right:.1f} s, wrong and "
                    f"sure for {bad:.1f} s; {seen.reason}"
                )
        t = np.array(own)
        print(
            f"{place.name:44s} {(t <= 10.0).sum():8d} of {count:3d} {np.median(t):9.2f}s {wrong}",
            flush=True,
        )
        times, wrongs = [*times, *own], wrongs + wrong
    t = np.array(times)
    print(f"{'all':44s} {(t <= 10.0).sum():8d} of {len(t):3d} {np.median(t):9.2f}s {wrongs}")


FOREIGN_S = 90.0
"""So long a drive with another place's map [s]."""


def mirrored(made: OccupancyMap) -> OccupancyMap:
    """The same left for right, as of a scanner that is mounted upside down."""
    return replace(made, cells=made.cells[:, ::-1].copy())


def sure_again(
    perception: Perception, moments: Iterable[Moment], start: Pose | None
) -> tuple[bool, float, float]:
    """Whether the robot was lost, for how long it then believed a pose all the same, and when it
    began to [s]. The start, which is believed at first, does not count."""
    believed, was_lost, sure, began = start is None, False, 0.0, math.inf
    for moment in moments:
        lost = perception.take(moment.now, moment.readings).lost
        believed = believed or not lost
        was_lost = was_lost or (believed and lost)
        if was_lost and not lost:
            sure, began = sure + DT, min(began, moment.now)
    return was_lost, sure, began


def foreign(given: argparse.Namespace, first: int, last: int) -> None:
    """Driven with a map of somewhere else, or of the same place mirrored: without a start, and from
    one somewhere on that map. Whatever pose is believed once it was lost is wrong."""
    maps = {name: make() for name, make in published().items() if given.only in name}
    worlds = [*(laid(name, made) for name, made in maps.items())]
    worlds += [building(s, alike=given.alike) for s in range(first, last)]
    print(f"{'':60s} {'ever sure':>10s} {'for':>8s}, first after")
    drives, sure_ones, all_sure = 0, 0, 0.0
    for i, world in enumerate(worlds):
        other = worlds[(i + 1) % len(worlds)]
        given_maps = [(other.name, other.known)]
        if world.name in maps:
            given_maps.append(("itself mirrored", mirrored(maps[world.name]).known()))
        way = tour(world, given.seed, 160.0, 0.38 if world.clear.size > 20_000 else 0.3)
        poses, twists = along(way, 0.5)
        rng = np.random.default_rng([given.seed, 11])
        steps = min(round(FOREIGN_S / DT), len(poses) - 2)
        for name, known in given_maps:
            for start in (None, Pose(*known.places[rng.integers(len(known.places))][:2], 0.0)):
                k = int(rng.integers(0, len(poses) - 1 - steps))
                seed = int(rng.integers(1_000_000))
                on, by = poses[k : k + steps + 1], twists[k : k + steps]
                moments = drive(on, by, seed, NO_DISCS, world.walls, grid=world.grid)
                was_lost, sure, began = sure_again(Perception(SALLY, known, start), moments, start)
                drives, sure_ones, all_sure = drives + 1, sure_ones + (sure > 0.0), all_sure + sure
                how = "no start" if start is None else "started"
                row = {"name": world.name, "kind": f"foreign, {how}", "map": name, "sure": sure}
                kept(given.into, row | {"seed": given.seed, "began": began, "lost": was_lost})
                where = f"{world.name} on {name}, {how}"
                print(f"{where:60s} {sure > 0.0!s:>10s} {sure:6.1f} s, {began:.1f} s", flush=True)
    print(f"{'all':60s} {sure_ones:4d} of {drives:3d} {all_sure:6.1f} s of {drives * FOREIGN_S} s")


if __name__ == "__main__":
    main()
