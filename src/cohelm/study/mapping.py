"""Makes a map from a recorded drive: mapper, grid, files and picture."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.mapper import Glimpse, Survey, Surveyed, glimpses
from cohelm.perceive.map.raster import Raster, raster
from cohelm.record.replay import Replayed
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.worlds.carmen import read_log
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap, write_map

_MAGIC = b"\x89MCAP"
_DRAWN = 2500  # scans that go into the grid, at most
_NO_RETURN = 0.98  # of the range: farther ends are taken for none
_FARTHEST = 25.0  # and no beam is drawn farther than this [m]
_LOOK_AGAIN = 1.0  # a growing record is read so often [s]
_ENDED = 10.0  # and has ended if nothing came for this long [s]

Told = Callable[[str, float], None]


class Drive(NamedTuple):
    """What mapping needs of a record."""

    odometry: list[Odometry]
    scans: list[Scan]
    lidar: LidarModel
    whole: bool = True
    """Whether the record was finished, and is not damaged."""


@dataclass(frozen=True)
class Result:
    """What came out, for a person or a program."""

    scans: int
    empty_scans: int
    """Without a single return."""
    record_whole: bool
    """Whether the record was finished; from a damaged one the map is made as far as it goes."""
    places: int
    loops: int
    odometry_scale: float
    travelled_m: float
    width_m: float
    height_m: float
    resolution_m: float
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        return asdict(self)


def drive(path: Path, robot: RobotModel | None = None) -> Drive:
    """Odometry and scans of a record: our MCAP, any with /odom and /scan, or a CARMEN log.

    robot: whose LiDAR it was, where an MCAP record does not say. Raises CohelmError where the
    file is neither, or holds nothing to map.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            mcap = file.read(len(_MAGIC)) == _MAGIC
    except OSError as error:
        raise CohelmError(f"{path} can not be read ({error.strerror}): check the name") from error
    if not mcap:
        return Drive(*read_log(path))
    replayed = Replayed(path, robot)
    lidar = replayed.model.lidar
    if lidar is None:
        raise CohelmError(f"{path}: the robot {replayed.model.name} has no LiDAR to map with")
    return Drive(replayed.odometry, replayed.scans, lidar, replayed.whole)


def mapped(
    path: Path, folder: Path, resolution: float, told: Told, *, live: bool = False,
    robot: RobotModel | None = None,
) -> Result:  # fmt: skip
    """Map a record into a folder: map.yaml, map.pgm, map.png, trajectory.csv, mapping.json.

    live: the record is still being written; go on until nothing more comes, or Ctrl-C.
    """
    begun = time.perf_counter()
    given = _begun(path, robot) if live else drive(path, robot)
    survey = Survey(given.lidar.lidar())
    seen: list[Glimpse] = []
    try:
        grown = time.monotonic()
        while True:
            new = _new(given, seen, live)
            for k, glimpse in enumerate(new):
                survey.add(glimpse)
                seen.append(glimpse)
                if k % 20 == 0:
                    at = f"scan {len(seen)}, {len(survey.places)} places"
                    told(at, 0.0 if live else 0.6 * k / len(new))
            if not live:
                break
            grown = time.monotonic() if new else grown
            if time.monotonic() - grown > _ENDED:
                break
            time.sleep(_LOOK_AGAIN)
            given = drive(path, robot)
    except KeyboardInterrupt:
        if not (live and seen):
            raise  # of a live drive, Ctrl-C is the usual end
    if not seen:
        raise CohelmError(f"{path}: no scan came while there was odometry: record both")
    empty = sum(1 for glimpse in seen if not len(glimpse.points))
    if empty == len(seen):
        raise CohelmError(
            f"{path}: not one of its {len(seen)} scans has a return in it, so there is nothing to "
            "map: check the LiDAR, or --robot for its range"
        )
    made = survey.finished(lambda share: told("closing loops", 0.6 + 0.3 * share))
    told("drawing", 0.9)
    drawn = _drawn(made, seen, given.lidar, resolution)
    result = _result(made, drawn, empty, given.whole or live, time.perf_counter() - begun)
    _save(folder, made, drawn, seen, result)
    return result


def _begun(path: Path, robot: RobotModel | None) -> Drive:
    """What is there of a record that is being written, as soon as something is."""
    end = time.monotonic() + _ENDED
    while True:
        try:
            return drive(path, robot)
        except CohelmError:
            if time.monotonic() > end:
                raise
        time.sleep(_LOOK_AGAIN)


def _new(given: Drive, seen: list[Glimpse], live: bool) -> list[Glimpse]:
    last = seen[-1].stamp if seen else -math.inf
    later = [s for s in given.scans if s.stamp + s.duration > last + 1e-6]
    if seen and not later:
        return []
    try:
        return glimpses(given.lidar.lidar(), given.odometry, later)
    except CohelmError:
        if seen or live:
            return []
        raise


def _drawn(made: Surveyed, seen: list[Glimpse], lidar: LidarModel, resolution: float) -> Raster:
    every = max(1, -(-len(seen) // _DRAWN))
    mount = lidar.lidar().mount
    reach = min(_NO_RETURN * lidar.range_max_m, _FARTHEST)
    ends: list[Floats] = []
    for glimpse in seen[::every]:
        far = np.hypot(glimpse.points[:, 0] - mount.x, glimpse.points[:, 1] - mount.y)
        ends.append(glimpse.points[far < reach])
    return raster(made.poses[::every], ends, mount, resolution)


def occupancy(drawn: Raster) -> OccupancyMap:
    """The grid as map_server publishes it."""
    occupied = drawn.occupied()
    cells = np.where(occupied, OCCUPIED, np.where(drawn.free(), FREE, UNKNOWN)).astype(np.int8)
    return OccupancyMap(cells, drawn.resolution, drawn.origin, from_start=True)


def _result(made: Surveyed, drawn: Raster, empty: int, whole: bool, seconds: float) -> Result:
    path = np.array([pose[:2] for pose in made.poses])
    rows, columns = drawn.hits.shape
    return Result(
        scans=len(made.poses),
        empty_scans=empty,
        record_whole=whole,
        places=len(made.places),
        loops=len(made.loops),
        odometry_scale=made.scale,
        travelled_m=float(np.hypot(*np.diff(path, axis=0).T).sum()),
        width_m=columns * drawn.resolution,
        height_m=rows * drawn.resolution,
        resolution_m=drawn.resolution,
        seconds=seconds,
    )


def _save(folder: Path, made: Surveyed, drawn: Raster, seen: list[Glimpse], result: Result) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_map(folder, occupancy(drawn))
        rows = np.column_stack(([g.stamp for g in seen], np.array(made.poses)))
        np.savetxt(
            folder / "trajectory.csv", rows, "%.6f", ",", header="t_s,x_m,y_m,psi_rad", comments=""
        )
        text = json.dumps(result.as_dict(), indent=2)
        (folder / "mapping.json").write_text(text + "\n", encoding="utf-8")
        picture(folder / "map.png", drawn, made.poses, made.loops)
    except OSError as error:
        raise CohelmError(
            f"{folder} can not be written ({error.strerror}): choose another folder with --out"
        ) from error


def picture(path: Path, drawn: Raster, poses: list[Pose], loops: list[tuple[int, int]]) -> None:
    """The map with the way driven, and the loops that were closed."""
    from matplotlib.figure import Figure

    shown = np.where(drawn.occupied(), 0, np.where(drawn.free(), 255, 190)).astype(np.uint8)
    rows, columns = shown.shape
    x, y, r = drawn.origin.x, drawn.origin.y, drawn.resolution
    wide = 7.0
    figure: Any = Figure(figsize=(wide, min(max(wide * rows / columns, 3.0), 12.0)), dpi=90)
    axes = figure.subplots()
    axes.imshow(
        shown, origin="lower", cmap="gray", vmin=0, vmax=255,
        extent=(x, x + columns * r, y, y + rows * r),
    )  # fmt: skip
    way = np.array([pose[:2] for pose in poses])
    for a, b in loops[:: max(1, len(loops) // 200)]:
        axes.plot(way[[a, b], 0], way[[a, b], 1], color="tab:orange", linewidth=0.5)
    axes.plot(way[:, 0], way[:, 1], color="tab:blue", linewidth=0.8)
    axes.plot(way[0, 0], way[0, 1], "o", color="tab:green", markersize=4)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.tight_layout()
    figure.savefig(path)
