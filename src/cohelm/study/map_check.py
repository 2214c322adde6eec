"""Checks what an occupancy map is good for before a robot drives on it: walls, open ends, and
places where a scan of the map itself does not tell the robot's pose."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.files import write_json, writing
from cohelm.core.frames import inverse, placed
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose, Progress
from cohelm.perceive.localize.caution import LocalizerParams
from cohelm.perceive.localize.global_search import candidates, search, search_blocks
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.match.scan_matching import MatchParams, align, independent
from cohelm.perceive.match.surfaces import FlatPoints, flat_points
from cohelm.robot.sensors import Lidar, LidarModel
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from cohelm.sim.grid import Grid
from cohelm.sim.lidar import measure, sight
from cohelm.study.map_files import shades

PLACES = 150
"""Places at which a scan is simulated, at most."""
_SEARCHED = 15_000_000
"""Places that are searched for them, all together: one or two minutes on one core."""
_MOST_SEARCHED = 6_000_000  # for one of them: 240 000 m2 of free ground in cells of 5 cm
_SURE = (
    LocalizerParams().sure
)  # a pose with a larger standard deviation is not reported as known [m]
_ANY = np.diag([4.0, 4.0, 16.0])  # information of a first guess: half a metre, a quarter radian
_REACH = 0.6  # of matching from a place that was searched for [m]
_FOUND = 8  # places of the whole map that fit a scan best, compared with it
_APART, _TURNED = 1.0, 0.5  # farther apart or turned by more, poses are others [m, rad]
_LIKE = 0.15  # ranges nearer to each other than this are alike [m]
_SHARE = 0.95  # of the beams alike, places look alike
_NO_DISCS, _NO_WALLS = np.empty((0, 6)), np.empty((0, 4))


class Alike(NamedTuple):
    """Two poses from which the LiDAR measures the same."""

    pose: Pose
    other: Pose


@dataclass(frozen=True)
class MapCheck:
    """What a map is good for."""

    width_m: float
    height_m: float
    resolution_m: float
    free_m2: float
    wall_m: float
    """Length of the borders between occupied and free cells."""
    thickness_m: float
    """Of walls, the median."""
    thickness_95_m: float
    """95 % of walls are at most as thick."""
    open_m: float
    """Length of the borders between free and unknown cells, and of free ones at the map's edge."""
    places: int
    """Poses from which a scan was simulated."""
    few_features: tuple[Pose, ...]
    """Those where the scan leaves a direction in which the position is not known."""
    alike: tuple[Alike, ...]
    """Those that another place of the map looks like."""


def checked(
    occupancy: OccupancyMap, model: LidarModel, progress: Progress, *, places: int = PLACES,
    seed: int = 1,
) -> MapCheck:  # fmt: skip
    """The check of a map for a LiDAR. places: at most so many, drawn by `seed` from all free ones;
    fewer where more than 4000 m2 are free, so that the time is bounded.

    At each a scan is simulated on the map as drawn, with the LiDAR's noise, and matched with the
    map. Too few features: the standard deviation of the position, in its worst direction, is above
    the localizer's own limit. Alike: another place of the whole map, 1 m away or turned by 0.5 rad
    at least, where 95 % of the ranges are the same within 15 cm. Raises CohelmError for a map
    without occupied or free cells, or with too many of these.
    """
    known, grid, lidar = occupancy.known(), occupancy.grid(), model.lidar()
    rng = np.random.default_rng(seed)
    if not len(known.places):
        raise CohelmError(
            "the map has no free place 20 cm from what is occupied, so nothing to check: see its "
            "thresholds and resolution"
        )
    if len(known.places) > _MOST_SEARCHED:
        raise CohelmError(
            f"{len(known.places)} places of the map are free, and {_MOST_SEARCHED} are the most to "
            "check (about 20 cm apart, or each cell): cut the map, or see its resolution"
        )
    places = min(places, max(_SEARCHED // len(known.places), 1))
    chosen = rng.permutation(len(known.places))[:places]
    few: list[Pose] = []
    alike: list[Alike] = []
    for k, index in enumerate(chosen):
        progress(f"place {k + 1} of {len(chosen)}", k / len(chosen))
        x, y = known.places[index]
        pose = Pose(float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
        ranges = _simulated(pose, lidar, grid)
        measure(lidar, seed, k, ranges)
        flat = _surface_points(ranges, lidar)
        if not _position_sigma(pose, known, flat) <= _SURE:
            few.append(pose)
            continue
        other = _look_alike(pose, ranges, known, grid, lidar, flat)
        if other is not None:
            alike.append(Alike(pose, other))
    occupied, free = occupancy.cells >= OCCUPIED, occupancy.cells == FREE
    r = occupancy.resolution
    median, most = _thickness(occupied, r)
    return MapCheck(
        occupied.shape[1] * r, occupied.shape[0] * r, r, float(free.sum()) * r * r,
        _border(free, occupied) * r, median, most, len(_open_ends(occupancy)) * r, len(chosen),
        tuple(few), tuple(alike),
    )  # fmt: skip


def _simulated(pose: Pose, lidar: Lidar, grid: Grid) -> Floats:
    """True ranges; inf without a return (n,) [m]."""
    ranges = np.empty(len(lidar.beams))
    sight(pose, lidar, _NO_DISCS, _NO_WALLS, grid, ranges)
    ranges[ranges > lidar.range_max] = math.inf
    return ranges


def _surface_points(ranges: Floats, lidar: Lidar) -> FlatPoints:
    """Points of a scan on flat surfaces and their normals, body frame."""
    beams = np.flatnonzero(np.isfinite(ranges))
    ends = placed(lidar.beams[beams] * ranges[beams, None], lidar.mount)
    return flat_points(ends, beams, lidar)


def _position_sigma(pose: Pose, known: LocalizationMap, flat: FlatPoints) -> float:
    """Standard deviation of the position in its worst direction, by the scan alone [m]."""
    params = MatchParams()
    fit = align(known.surfaces, flat, pose, _ANY, params)
    information = independent(known.surfaces, flat, pose, params, fit.rms)
    if not (fit.share > 0.0 and np.linalg.eigvalsh(information)[0] > 1e-9):
        return math.inf
    covariance = np.linalg.inv(information)[:2, :2]
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))


def _look_alike(
    pose: Pose, ranges: Floats, known: LocalizationMap, grid: Grid, lidar: Lidar, flat: FlatPoints
) -> Pose | None:
    """Another pose on the map from which the scan would be the same; None if there is none."""
    state = search(flat.points, known.places, True)
    while not state.over:
        state = search_blocks(state, known, 500)
    params = MatchParams()._replace(reach=_REACH)
    for guess in candidates(state, _FOUND):
        there = align(known.surfaces, flat, guess, _ANY, params).pose
        apart = math.hypot(there.x - pose.x, there.y - pose.y) > _APART
        if not (apart or abs(wrap(there.psi - pose.psi)) > _TURNED):
            continue
        seen = _simulated(there, lidar, grid)
        both = np.isfinite(seen) & np.isfinite(ranges)
        same = ~np.isfinite(seen) & ~np.isfinite(ranges)
        same[both] = np.abs(seen[both] - ranges[both]) < _LIKE
        if same.mean() >= _SHARE:
            return there
    return None


def _thickness(occupied: NDArray[np.bool_], resolution: float) -> tuple[float, float]:
    """Median and 95 % of the thickness of walls, by their length; across them in a row or a column
    of cells [m]."""
    thick: NDArray[np.int64] = np.sort(np.minimum(_runs(occupied), _runs(occupied.T).T)[occupied])
    length: Floats = np.cumsum(1.0 / thick)  # a wall of three cells counts once, not thrice
    median = int(np.argmax(length >= 0.5 * length[-1]))
    most = int(np.argmax(length >= 0.95 * length[-1]))
    return float(thick[median]) * resolution, float(thick[most]) * resolution


def _runs(occupied: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many occupied cells lie next to each other in a cell's row; 0 in others."""
    padded = np.pad(occupied, ((0, 0), (1, 1))).ravel()
    change = np.diff(padded.astype(np.int8), prepend=0)
    begin, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    lengths = np.zeros(padded.size, dtype=np.int64)
    lengths[padded] = np.repeat(end - begin, end - begin)
    return lengths.reshape(len(occupied), -1)[:, 1:-1]


def _border(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> int:
    """Sides of cells of one kind that border on cells of the other."""
    rows = (a[1:] & b[:-1]).sum() + (b[1:] & a[:-1]).sum()
    columns = (a[:, 1:] & b[:, :-1]).sum() + (b[:, 1:] & a[:, :-1]).sum()
    return int(rows + columns)


def _open_ends(occupancy: OccupancyMap) -> Floats:
    """Middles of free cells that border on unknown ones or on the map's edge, one for each such
    side, in cells (n, 2)."""
    free = occupancy.cells == FREE
    beyond = np.pad(occupancy.cells == UNKNOWN, 1, constant_values=True)
    rows, columns = free.shape
    found = [
        np.argwhere(free & beyond[1 + i : 1 + i + rows, 1 + j : 1 + j + columns])
        for i, j in ((0, 1), (0, -1), (1, 0), (-1, 0))
    ]
    return np.asarray(np.vstack(found)[:, ::-1] + 0.5, dtype=np.float64)


def write(folder: Path, occupancy: OccupancyMap, check: MapCheck) -> None:
    """check.png and check.json. Raises CohelmError where the folder can not be written."""
    with writing(folder):
        write_json(folder / "check.json", asdict(check))
        _picture(folder / "check.png", occupancy, check)


def _picture(path: Path, occupancy: OccupancyMap, check: MapCheck) -> None:
    """The map with its open ends, places with too few features, and places that look alike."""
    from matplotlib.figure import Figure

    shown, cells = shades(occupancy.cells >= OCCUPIED, occupancy.cells == FREE, 900)
    rows, columns = shown.shape
    r, origin = occupancy.resolution, occupancy.origin
    figure: Any = Figure(figsize=(8.0, min(max(8.0 * rows / columns, 3.0), 12.0)), dpi=100)
    axes = figure.subplots()
    axes.imshow(
        shown, origin="lower", cmap="gray", vmin=0, vmax=255,
        extent=(0.0, columns * cells * r, 0.0, rows * cells * r),
    )  # fmt: skip

    def own(poses: list[Pose]) -> Floats:
        """In the axes of the map's cells [m]."""
        return placed(np.array([pose[:2] for pose in poses]).reshape(-1, 2), inverse(origin))

    ends = _open_ends(occupancy) * r
    axes.plot(*ends.T, ".", color="tab:cyan", markersize=2, label="open end: free beside unknown")
    axes.plot(
        *own(list(check.few_features)).T, "s", color="tab:orange", markersize=5,
        label="too few features",
    )  # fmt: skip
    here, there = own([a.pose for a in check.alike]), own([a.other for a in check.alike])
    for a, b in zip(here, there, strict=True):
        axes.plot(*np.array([a, b]).T, color="tab:red", linewidth=0.5)
    axes.plot(
        *np.vstack((here, there)).T, "o", color="tab:red", markersize=4,
        label="places that look alike, linked",
    )  # fmt: skip
    axes.set_xlabel("x from the map's corner [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncol=3, fontsize=8)
    figure.tight_layout()
    figure.savefig(path)
