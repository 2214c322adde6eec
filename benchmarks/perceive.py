"""Localisation, mapping and movers against the truth: `python benchmarks/perceive.py`.

`--quick` runs a few of each; name tables to run only those. The lab is driven with 1-2 % of
odometry error, a gyro that drifts, and a LiDAR of 2 cm noise at 10 Hz that sweeps for 75 ms and
reports 50 ms later. Real data are read from ../shared/data where that is there, and the Killian
Court log from where COHELM_KILLIAN says it is.
"""

from __future__ import annotations

import functools
import math
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # the drives are the tests' own

from benchmarks import intel, killian_edges  # noqa: E402
from cohelm.core.frames import between, compose, inverse  # noqa: E402
from cohelm.core.scalars import wrap  # noqa: E402
from cohelm.core.types import Floats, Pose, Twist, disc  # noqa: E402
from cohelm.perceive.localize.localization_map import (  # noqa: E402
    LocalizationMap,
    free_at,
    gap_at,
    map_from_occupancy,
)
from cohelm.perceive.map.mapper import Mapper, MappingResult  # noqa: E402
from cohelm.perceive.map.mapping_scans import mapping_scans  # noqa: E402
from cohelm.perceive.map.raster import raster  # noqa: E402
from cohelm.perceive.pipeline import Perception, Seen, warm_up  # noqa: E402
from cohelm.robot.kinematics import arc  # noqa: E402
from cohelm.scenario.load import robot  # noqa: E402
from cohelm.scenario.worlds.tracks import read_tracks  # noqa: E402
from cohelm.study.map_files import occupancy  # noqa: E402
from tests.perceive import killian  # noqa: E402
from tests.perceive.drives import (  # noqa: E402
    CONES,
    DT,
    LIDAR,
    START,
    TOUR,
    along,
    drive,
    lab_map,
)

DATA = ROOT.parent / "shared" / "data"
SALLY = robot("sally").model_copy(update={"lidar": LIDAR})
QUICK = "--quick" in sys.argv[1:]
HOME = [(-0.5, -1.75), (-0.6, -0.5), (-0.5, 0.8), (0.0, 2.5)]
Row = tuple[str, ...]


def main() -> None:
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(__doc__)
        return
    console = Console()
    truth = map_from_occupancy(*lab_map())
    warm_up(SALLY, mapped=True)
    wanted = [a for a in sys.argv[1:] if not a.startswith("-")]
    some = not wanted or {"mapping", "localisation"} & set(wanted)
    own = surveyed() if some else (truth, [])
    for name, heads, rows in (
        ("mapping", ("drive", "ATE rms", "largest", "heading", "CPU a scan"), lambda: own[1]),
        ("localisation", ("map, seed", "rms", "99 %", "largest", "heading", "ms median", "99 %"),
         lambda: localised({"drawn from the truth": truth, "the robot's own": own[0]})),
        ("pushes", ("of 1-2 m", "found again", "median", "last", "believed wrongly after 1 s"),
         lambda: pushed(truth, 6 if QUICK else 60)),
        ("cold starts", ("", "found", "says it is not sure", "wrong and sure", "median s"),
         lambda: cold(truth, 6 if QUICK else 60)),
        ("movers", ("scene", "seen of those in view", "false", "place", "velocity", "covered"),
         crowds),
        ("Intel", ("mapped from", "relations", "mean", "median", "99 %", "largest", "heading"),
         lab_of_intel),
        ("Killian Court", ("trajectory", "ATE rms", "largest", "loop edges", "mean", "median",
         "0.5 m and more", "heading mean", "CPU"), court),
        ("Killian's edges", ("", "edges", "off in the mean", "along", "across"), court_edges),
    ):  # fmt: skip
        if wanted and name.split()[0].removesuffix("'s") not in wanted:
            continue
        table = Table(*heads, title=name, title_justify="left")
        for row in rows():
            table.add_row(*row)
        console.print(table)


def surveyed() -> tuple[LocalizationMap, list[Row]]:
    """The lab mapped by driving through it, and the errors. The map lies in the true frame."""
    rows: list[Row] = []
    made: LocalizationMap | None = None
    for seed in range(1 if QUICK else 4):
        odometry, scans, true = [], {}, {}
        for moment in drive(*along(TOUR + HOME), seed):
            odometry.append(moment.readings.odometry)
            true[round(moment.now, 2)] = moment.truth
            if moment.readings.scan is not None:
                scans[moment.readings.scan.number] = moment.readings.scan
        seen = mapping_scans(LIDAR.lidar(), odometry, list(scans.values()))
        begun = time.process_time()
        survey = Mapper(LIDAR.lidar())
        for sweep in seen:
            survey.add(sweep)
        found = survey.finished()
        took = 1e3 * (time.process_time() - begun) / len(seen)
        truth = [true[round(g.stamp, 2)] for g in seen]
        off, heading, frame = fitted(found, truth)
        rows.append((
            f"lab, {seed}", cm(rms(off)), cm(off.max()), deg(heading.max()), f"{took:.1f} ms",
        ))  # fmt: skip
        if made is None:
            poses = [compose(frame, pose) for pose in found.poses]
            drawn = raster(poses, [g.points for g in seen], LIDAR.lidar().mount, 0.025)
            made = occupancy(drawn).known()
    assert made is not None
    return made, rows


def fitted(found: MappingResult, truth: list[Pose]) -> tuple[Floats, Floats, Pose]:
    """Errors after the best rigid fit, and that fit: the pose of the map in the world."""
    a, b = np.array(found.poses), np.array(truth)
    ma, mb = a[:, :2].mean(axis=0), b[:, :2].mean(axis=0)
    u, _, v = np.linalg.svd((a[:, :2] - ma).T @ (b[:, :2] - mb))
    turn = v.T @ np.diag([1.0, np.linalg.det(v.T @ u.T)]) @ u.T
    shift = mb - turn @ ma
    frame = Pose(float(shift[0]), float(shift[1]), math.atan2(turn[1, 0], turn[0, 0]))
    off = np.hypot(*(a[:, :2] @ turn.T + shift - b[:, :2]).T)
    heading = np.abs([wrap(p + frame.psi - q) for p, q in zip(a[:, 2], b[:, 2], strict=True)])
    return off, heading, frame


def localised(maps: dict[str, LocalizationMap]) -> Iterator[Row]:
    path = along(TOUR)
    for name, on in maps.items():
        for seed in range(10, 11 if QUICK else 14):
            perception, off, heading, times = Perception(SALLY, on, START), [], [], []
            for moment in drive(*path, seed):
                begun = time.perf_counter()
                seen = perception.take(moment.now, moment.readings)
                took = time.perf_counter() - begun
                if moment.scanned:
                    times.append(1e3 * took)
                if moment.readings.scan is not None:
                    off.append(apart(seen.pose, moment.truth))
                    heading.append(abs(wrap(seen.pose.psi - moment.truth.psi)))
                    assert not seen.lost
            e = np.array(off)
            yield (
                f"{name}, {seed}", cm(rms(e)), cm(np.quantile(e, 0.99)), cm(e.max()),
                deg(max(heading)), f"{np.median(times):.2f}", f"{np.quantile(times, 0.99):.2f}",
            )  # fmt: skip


def pushed(on: LocalizationMap, count: int) -> Iterator[Row]:
    """Dragged 1-2 m aside within a second, unseen by the wheels, then turned slowly."""
    poses, twists = along(TOUR)
    rng = np.random.default_rng(5)
    back, wrong = [], 0
    for _ in range(count):
        k, end = 0, Pose(0.0, 0.0, 0.0)
        while True:
            k = int(rng.integers(0, len(poses) - 400))
            way, where = rng.uniform(1.0, 2.0), rng.uniform(-math.pi, math.pi)
            p = poses[k + 100]
            end = Pose(
                p.x + way * math.cos(where), p.y + way * math.sin(where),
                p.psi + rng.uniform(-0.8, 0.8),
            )  # fmt: skip
            if free_at(on, end.x, end.y) and gap_at(on, end.x, end.y) > 0.4:
                break
        start = poses[k + 100]
        drag = [
            Pose(*(a + (b - a) * i / 50 for a, b in zip(start, end, strict=True)))
            for i in range(1, 51)
        ]
        after, turning = [end], [Twist(0.0, 0.0 if i < 50 else 0.4) for i in range(250)]
        for twist in turning:
            after.append(arc(after[-1], twist, DT))
        path = poses[k : k + 100] + drag + after[1:]
        moved = twists[k : k + 100] + [Twist(0.0, 0.0)] * 50 + turning
        perception = Perception(SALLY, on, poses[k])
        found, bad, let_go = None, False, 150 * DT
        for moment in drive(path, moved, int(rng.integers(1_000_000))):
            seen = perception.take(moment.now, moment.readings)
            since = moment.now - let_go
            if since < 0.2:
                continue
            near = apart(seen.pose, moment.truth) < 0.1
            if not seen.lost and near and found is None:
                found = since
            bad |= since > 1.0 and not seen.lost and not near
        wrong += bad
        if found is not None:
            back.append(found)
    yield (
        f"{count}", f"{len(back)}", f"{np.median(back):.2f} s", f"{max(back):.2f} s", f"{wrong}",
    )  # fmt: skip


def cold(on: LocalizationMap, count: int) -> Iterator[Row]:
    """Cold starts anywhere in the lab, with up to two people who are on no map."""
    poses, twists = along(TOUR)
    for kind in ("standing, turned anyhow", "driving the tour"):
        rng = np.random.default_rng(6)
        found, unsure, wrong, times = 0, 0, 0, []
        for _ in range(count):
            if kind.startswith("standing"):
                x, y = on.places[rng.integers(len(on.places))].tolist()
                path, moved = [Pose(x, y, rng.uniform(-math.pi, math.pi))] * 250, []
            else:
                k = int(rng.integers(0, len(poses) - 600))
                path, moved = poses[k : k + 600], twists[k : k + 599]
            people = [
                disc(path[0].x + rng.normal(0, 2.5), path[0].y + rng.normal(0, 2.5), 0.25)
                for _ in range(int(rng.integers(0, 3)))
            ]
            clear = [
                p for p in people if min(math.hypot(p[0] - q.x, p[1] - q.y) for q in path) > 0.8
            ]
            around = np.vstack([CONES, np.array(clear).reshape(-1, 6)])
            perception, first, bad = Perception(SALLY, on), None, False
            for moment in drive(path, moved, int(rng.integers(1_000_000)), around=around):
                seen = perception.take(moment.now, moment.readings)
                if moment.readings.scan is not None and not seen.lost:
                    first = moment.now if first is None else first
                    bad |= apart(seen.pose, moment.truth) > 0.2
            wrong += bad
            unsure += first is None
            found += first is not None and not bad
            times += [first] if first is not None else []
        yield (
            kind, f"{found} of {count}", f"{unsure}", f"{wrong}",
            f"{np.median(times):.1f}" if times else "-",
        )  # fmt: skip


def crowds() -> Iterator[Row]:
    path = along(TOUR)
    yield watched("lab, nobody about", path, lambda t: CONES)

    def walkers(t: float) -> Floats:
        far = (1.0 * t) % 24.0
        return np.vstack([CONES, [
            disc(2 + 1.2 * math.cos(0.6 * t), -1.5 + 1.5 * math.sin(0.6 * t), 0.25),
            disc(8 + 0.1 * (t % 30.0), -1.5, 0.1),
            disc(-2 + (far if far < 12 else 24 - far), 4.45, 0.25),
        ]])  # fmt: skip

    yield watched("lab, two people and a slow thing", path, walkers)
    for name in ("eth", "hotel"):
        file = DATA / "crowd" / f"{name}.csv"
        if not file.exists():
            continue
        tracks = read_tracks(file)
        times = np.array([t.times[0] for t in tracks])
        busy = float(np.median(times))
        middle = np.concatenate([t.points for t in tracks]).mean(axis=0)

        def people(t: float, begin: float = busy, tracks: list = tracks) -> Floats:
            now = begin + t
            rows = [
                disc(float(np.interp(now, p.times, p.points[:, 0])),
                     float(np.interp(now, p.times, p.points[:, 1])), 0.25)
                for p in tracks if p.times[0] <= now <= p.times[-1]
            ]  # fmt: skip
            return np.array(rows, dtype=float).reshape(-1, 6)

        seconds = 20 if QUICK else 90
        spot = Pose(float(middle[0]), float(middle[1]), 0.0)
        turning = [Twist(0.0, 0.1)] * round(seconds / DT)
        poses = [spot]
        for twist in turning:
            poses.append(arc(poses[-1], twist, DT))
        yield watched(name, (poses, turning), people, walls=np.empty((0, 4)))


def watched(
    name: str, path: tuple[list[Pose], list[Twist]], around: Callable[[float], Floats],
    walls: Floats | None = None,
) -> Row:  # fmt: skip
    """Reported movers against true walkers within 6 m, with five beams on them for 0.6 s."""
    perception = Perception(SALLY)
    more = {} if walls is None else {"walls": walls}
    reported = seen_ = false = there = 0
    place: list[float] = []
    speed: list[float] = []
    covered: list[bool] = []
    in_view: dict[int, float] = {}
    for moment in drive(*path, 3, around=around, **more):
        seen = perception.take(moment.now, moment.readings)
        if not moment.scanned:
            continue
        found = in_world(seen, moment.truth)
        true, before = around(moment.now), around(moment.now - 0.1)
        used: set[int] = set()
        for k, person in enumerate(true if len(before) else true[:0]):
            same = before[np.argmin(np.hypot(*(before[:, :2] - person[:2]).T))]
            velocity = (person[:2] - same[:2]) / 0.1
            walks = 0.15 < np.hypot(*velocity) < 3.0
            visible = walks and beams_on(moment.readings.scan.ranges, moment.truth, person) >= 5
            in_view[k] = in_view.get(k, 0.0) + 0.1 if visible else 0.0
            gaps = np.hypot(*(found[:, :2] - person[:2]).T) if len(found) else np.empty(0)
            i = int(gaps.argmin()) if len(gaps) and gaps.min() < 0.6 else -1
            if i >= 0:
                used.add(i)
            if in_view[k] > 0.6:
                there += 1
                if i >= 0:
                    seen_ += 1
                    place.append(float(gaps[i]))
                    speed.append(float(np.hypot(*(found[i, 2:4] - velocity))))
                    covered.append(bool(gaps[i] + person[4] <= found[i, 4] + 0.05))
        reported += len(found)
        false += len(found) - len(used)
    return (
        name, f"{seen_} of {there}", f"{false} of {reported}",
        cm(np.mean(place)) if place else "-", f"{np.mean(speed):.2f} m/s" if speed else "-",
        f"{100 * np.mean(covered):.0f} %" if covered else "-",
    )  # fmt: skip


def in_world(seen: Seen, truth: Pose) -> Floats:
    frame = compose(truth, inverse(seen.pose))
    c, s = math.cos(frame.psi), math.sin(frame.psi)
    turn, found = np.array([[c, s], [-s, c]]), seen.movers.copy()
    found[:, :2] = found[:, :2] @ turn + (frame.x, frame.y)
    found[:, 2:4] = found[:, 2:4] @ turn
    return found


def beams_on(ranges: Floats, pose: Pose, person: Floats) -> int:
    """Beams of a scan that end on a person, within 6 m."""
    lidar = LIDAR.lidar()
    sensor = compose(pose, lidar.mount)
    if math.hypot(person[0] - sensor.x, person[1] - sensor.y) > 6.0:
        return 0
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    ends = (lidar.beams * np.where(np.isfinite(ranges), ranges, 99.0)[:, None]) @ np.array(
        [[c, s], [-s, c]]
    ) + (sensor.x, sensor.y)
    return int((np.abs(np.hypot(*(ends - person[:2]).T) - person[4]) < 0.12).sum())


def lab_of_intel() -> Iterator[Row]:
    """From the log's own poses, and from the odometry between its scans."""
    if not intel.LOG.exists():
        return
    for odometry, poses in (
        ("the log's own poses", intel.surveyed().poses),
        ("odometry alone", intel.surveyed(raw=True).poses),
    ):
        found = intel.errors(poses)
        for name, among in (("of one line", found.alone), ("all", np.full(len(found.off), True))):
            off, heading = found.off[among], found.heading[among]
            yield (
                odometry, f"{name}, {len(off)}", cm(np.mean(off)), cm(np.median(off)),
                cm(np.quantile(off, 0.99)), cm(off.max()), deg(np.mean(heading)),
            )  # fmt: skip


def court() -> Iterator[Row]:
    """Against the published solution, and the edges between scans that met."""
    if killian.FILE is None:
        return
    log = killian.read(killian.FILE)
    for name, odometry in (("sequential edges", log.odometry), ("the log's own poses", log.poses)):
        found, took = court_mapped(odometry is log.odometry)
        if odometry is log.odometry:
            yield against(log, name, found._replace(poses=odometry), "-")
        yield against(log, f"mapped from {name}", found, f"{took:.0f} s")


@functools.cache
def court_mapped(drifting: bool) -> tuple[MappingResult, float]:
    """From the sequential edges, which drift, or the log's own poses; and processor time [s]."""
    assert killian.FILE is not None
    log = killian.read(killian.FILE)
    begun = time.process_time()
    survey = Mapper(log.lidar)
    for sweep, pose in zip(log.seen, log.odometry if drifting else log.poses, strict=True):
        survey.add(sweep._replace(pose=pose))
    return survey.finished(), time.process_time() - begun


def court_edges() -> Iterator[Row]:
    """Errors of the reference edges themselves, and the fit of scans to them and to the map."""
    if killian.FILE is None:
        return
    log = killian.read(killian.FILE)
    off = killian_edges.contradictions(log) / math.sqrt(2.0)
    yield (
        "one edge, by others and the sequential edges", f"{len(off)}",
        cm(np.hypot(*off.T).mean()), cm(rms(off[:, 0])), cm(rms(off[:, 1])),
    )  # fmt: skip
    for what, one in zip(("kept", "left out"), killian_edges.among_themselves(log), strict=True):
        name = f"off the poses by the edges alone, it being {what}"
        yield name, f"{len(one)}", cm(one.mean()), "", ""
    ours = court_mapped(True)[0].poses
    apart, seen = killian_edges.unseen(log, ours)
    for what, some in (("all", seen | True), ("seen in every direction", seen)):
        along, across = apart[some].T
        mean = np.hypot(along, across).mean()
        yield f"off our map, {what}", f"{some.sum()}", cm(mean), cm(along.mean()), cm(across.mean())
    found = killian_edges.decided(log, ours)
    for least in (0.05, 0.02):
        some = found.lead > least
        for what, along in (("an edge", found.edge), ("our map", found.ours)):
            name = f"{what}, off where all scans around both ends fit {least:.0%} better"
            yield name, f"{some.sum()}", "", cm(np.abs(along[some]).mean()), ""
    lies, firm = killian_edges.fits(log, ours)
    for what, one in (("points of a scan off what was seen", lies), ("off the best match", firm)):
        for k, name in enumerate(("at the edges", "on our map")):
            yield f"{what}, {name}", f"{len(one)}", cm(one[:, k].mean()), "", ""


def against(log: killian.Log, name: str, found: MappingResult, took: str) -> Row:
    off, _, _ = fitted(found, log.poses)
    errors = [between(true, between(found.poses[a], found.poses[b])) for a, b, true in log.loops]
    gaps = np.array([math.hypot(e.x, e.y) for e in errors])
    return (
        name, f"{rms(off):.2f} m", f"{off.max():.2f} m", f"{len(gaps)}", cm(gaps.mean()),
        cm(np.median(gaps)), f"{(gaps >= 0.5).sum()}",
        deg(np.mean([abs(e.psi) for e in errors])), took,
    )  # fmt: skip


def apart(a: Pose, b: Pose) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))


def cm(metres: float) -> str:
    return f"{100.0 * metres:.1f} cm"


def deg(radians: float) -> str:
    return f"{math.degrees(radians):.2f} deg"


if __name__ == "__main__":
    main()
