"""The BARN challenge (Perille et al. 2020; Xu et al. 2022): worlds, reference paths, limits."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, cast

import numpy as np
from numpy.lib.format import read_array
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.scenario.worlds.file import contents, faults
from cohelm.scenario.worlds.gazebo import read_gazebo

_RADIUS = 0.075  # of the cylinders; a path cell is twice as wide [m]
_FIRST_CELL = (-4.575, 5.075)  # centre of cell (0, 0) of a path in the Gazebo world [m]
_START = Pose(-2.25, 3.0, 1.57)
_GOAL = (-2.25, 13.0)
_NEAR_GOAL = 1.0  # [m]
_TIME_LIMIT = 100.0  # [s]
_OPTIMAL_SPEED = 2.0  # the challenge's idea of the fastest drive along the path [m/s]


@dataclass(frozen=True)
class Barn:
    """One world of the challenge, world frame of Gazebo."""

    number: int
    discs: Floats
    """(n, 6), the cylinders at rest; r_i is the radius plus the reach given."""
    walls: Floats
    """(s, 4), outlines of other shapes; the challenge's own worlds have none."""
    path: Floats
    """(m, 2) centres of the cells of the reference path, which starts and ends in the field [m]."""
    start: Pose
    goal: tuple[float, float]
    near_goal: float
    """Nearer to the goal than this, the robot has arrived [m]."""
    time_limit: float
    """[s]"""
    left_out: tuple[str, ...] = ()
    """As in `GazeboObstacles`."""

    @property
    def route(self) -> Floats:
        """From the start along the path to the goal, each point once in a row, (k, 2) [m]."""
        points = np.vstack((self.start[:2], self.path, self.goal))
        moved = np.hypot(*np.diff(points, axis=0).T) > 1e-6
        return points[np.concatenate(([True], moved))]

    @property
    def waypoints(self) -> list[tuple[float, float]]:
        """Along the route, some half a metre apart [m]."""
        route = self.route
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))))
        at = np.linspace(0.0, float(along[-1]), max(round(float(along[-1]) / 0.5), 1) + 1)
        x, y = (np.interp(at, along, route[:, c]).tolist() for c in (0, 1))
        return list(zip(x, y, strict=True))

    @property
    def optimal_time(self) -> float:
        """OT of the challenge's score: the length of the route at 2 m/s [s]."""
        return float(np.hypot(*np.diff(self.route, axis=0).T).sum()) / _OPTIMAL_SPEED


def read_barn(world: Path | str, path: Path | str, reach: float, number: int = -1) -> Barn:
    """A world from the challenge's own files: `world_N.world` (or .gz) and `path_N.npy`.

    reach: as in `read_gazebo` [m]. Raises CohelmError where either can not be used.
    """
    seen = read_gazebo(world, reach)
    return Barn(
        number, seen.discs, seen.walls, read_path(path), _START, _GOAL, _NEAR_GOAL, _TIME_LIMIT,
        seen.left_out,
    )  # fmt: skip


def read_path(path: Path | str) -> Floats:
    """A reference path of the challenge: cells (m, 2) in a .npy file, to metres (m, 2).

    Cell (i, j) is centred at (-4.575 + 0.15 i, 5.075 + 0.15 j) in the Gazebo world.
    Raises CohelmError where the file is not such an array.
    """
    data = io.BytesIO(contents(path, "a BARN path_N.npy"))
    try:
        cells = cast(NDArray[np.generic], read_array(data, allow_pickle=False))
    except Exception as error:  # whatever NumPy makes of damaged bytes
        raise CohelmError(
            f"{path}: is not a whole NumPy .npy array of numbers ({error}); fetch it again"
        ) from error
    if cells.dtype.kind not in "iuf":
        raise CohelmError(f"{path}: holds {cells.dtype}, not numbers; give a BARN path_N.npy")
    points = cells.astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) == 0:
        raise CohelmError(f"{path}: a path has shape (m, 2), this array has {points.shape}")
    if not np.isfinite(points).all():
        raise CohelmError(f"{path}: a path must be finite numbers; fetch it again")
    return np.array(_FIRST_CELL) + 2.0 * _RADIUS * points


Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]
Point = Annotated[list[Number], Field(min_length=2, max_length=2)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class _Meta(_Strict):
    radius: Annotated[Number, Field(gt=0.0)] = _RADIUS
    start: Annotated[list[Number], Field(min_length=3, max_length=3)] = list(_START)
    goal: Point = list(_GOAL)
    goal_tol: Annotated[Number, Field(gt=0.0)] = _NEAR_GOAL
    timeout_s: Annotated[Number, Field(gt=0.0)] = _TIME_LIMIT


class _World(_Strict):
    id: int
    cyl: list[Point]
    path: Annotated[list[Point], Field(min_length=1)]


class _Collection(_Strict):
    meta: _Meta = _Meta()
    worlds: list[_World]


def read_collection(path: Path | str, reach: float) -> dict[int, Barn]:
    """Many worlds from one JSON file, by their number.

    The file holds `worlds`, each with its `id`, centres `cyl` and `path` [m], and `meta` with
    `radius`, `start`, `goal`, `goal_tol` and `timeout_s`, which default to the challenge's.
    Raises CohelmError where it does not.
    """
    try:
        collection = _Collection.model_validate_json(contents(path, "a JSON file of BARN worlds"))
    except ValidationError as error:
        raise faults(path, error) from error
    meta = collection.meta
    found: dict[int, Barn] = {}
    for world in collection.worlds:
        if world.id in found:
            raise CohelmError(f"{path}: world {world.id} is there twice; remove one")
        discs = np.zeros((len(world.cyl), 6))
        discs[:, :2] = np.array(world.cyl).reshape(-1, 2)
        discs[:, 4:] = meta.radius, meta.radius + reach
        found[world.id] = Barn(
            world.id, discs, np.empty((0, 4)), np.array(world.path), Pose(*meta.start),
            (meta.goal[0], meta.goal[1]), meta.goal_tol, meta.timeout_s,
        )  # fmt: skip
    return found


def score(optimal_time: float, time: float, arrived: bool) -> float:
    """The challenge's score since 2026: OT / clip(AT, 2 OT, 8 OT) on arrival, else 0."""
    if not (arrived and math.isfinite(time)):
        return 0.0
    return optimal_time / min(max(time, 2.0 * optimal_time), 8.0 * optimal_time)
