"""Keep-out and speed zones: as a scenario has them, or as masks of Nav2's costmap filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from cohelm.core.errors import CohelmError
from cohelm.core.schema import Coordinate, Schema, refuse
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.match.surfaces import MOST_CELLS
from cohelm.plan.zones import CELL, UNZONED, Cells, KeepOut, SpeedZones, Zones, keep_out
from cohelm.ros.masks import KEEP_OUT, SPEED, FilterMask
from cohelm.scenario.worlds.maps import OCCUPIED, OccupancyMap, SpeedMask, read_map, read_speed_mask

Corners = Annotated[list[tuple[Coordinate, Coordinate]], Field(min_length=3, max_length=10_000)]
File = Annotated[str, Field(min_length=1)]
_MOST_IN_A_ROW = 65535
"""Cells, as sent to stations."""


class SpeedZone(Schema):
    """A part of the world where the robot goes slowly."""

    corners_m: Corners
    """Corners [x, y] of a polygon, three or more, in order."""
    speed_mps: Annotated[float, Field(gt=0.0, le=100.0)]
    """Largest speed requested there."""


class ZonesModel(Schema):
    """Where the robot keeps out, and where it goes slowly, though nothing is there to be seen."""

    keep_out_m: list[Corners] = Field(default=[], max_length=10_000)
    """Polygons in which the robot must not be, each a list of corners [x, y]."""
    speed: list[SpeedZone] = Field(default=[], max_length=10_000)
    """Polygons in which it goes slowly; where two lie over each other the lower speed counts."""
    keep_out_file: File | None = None
    """Instead of `keep_out_m`: a mask of map_server, its YAML file relative to this one."""
    speed_file: File | None = None
    """Instead of `speed`: a mask of Nav2's speed filter."""

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        problems: list[tuple[str, str]] = []
        for given, file, name in (
            (self.keep_out_m, self.keep_out_file, "keep_out_m"),
            (self.speed, self.speed_file, "speed"),
        ):
            if given and file is not None:
                key = "keep_out_file" if name == "keep_out_m" else "speed_file"
                problems.append((key, f"there is {name} already; draw all in one of the two"))
        for i, corners in enumerate(self.keep_out_m):
            problems += _flat(f"keep_out_m.{i}", corners)
        for i, zone in enumerate(self.speed):
            problems += _flat(f"speed.{i}.corners_m", zone.corners_m)
        if problems:
            refuse(*problems)
        return self

    def standing_alone(self, folder: Path, requested_by: str) -> ZonesModel:
        """The same with its files by absolute paths; CohelmError where one is not there."""
        update: dict[str, object] = {}
        for key in ("keep_out_file", "speed_file"):
            name = getattr(self, key)
            if name is None:
                continue
            file = (folder / name).absolute()
            if not file.is_file():
                wrong = "is a folder, not a mask's YAML file" if file.is_dir() else "no such file"
                raise CohelmError(f"{requested_by}: zones.{key}: {file}: {wrong}")
            update[key] = str(file)
        return self.model_copy(update=update)

    def read(self, start: Pose) -> Zones:
        """The zones, in the world. Files are taken as they stand, see
        `standing_alone`; what `cohelm map` has drawn begins at `start`. CohelmError for a mask that
        can not be used."""
        keep_out_file, speed_file = (
            None if name is None else Path(name) for name in (self.keep_out_file, self.speed_file)
        )
        read = read_zones(keep_out_file, speed_file, start)
        if self.keep_out_m:
            cells, origin = _drawn([(corners, 1.0) for corners in self.keep_out_m], "keep_out_m")
            read = read._replace(keep_out=keep_out(cells > 0.0, CELL, origin))
        if self.speed:
            from_fast = sorted(self.speed, key=lambda zone: -zone.speed_mps)  # the lowest counts
            cells, origin = _drawn([(one.corners_m, one.speed_mps) for one in from_fast], "speed")
            read = read._replace(slow=SpeedZones(Cells(cells, CELL, origin), False))
        return read


Polygon = tuple[Sequence[tuple[float, float]], float]
"""Corners, and what stands in its cells."""


def _flat(key: str, corners: Sequence[tuple[float, float]]) -> list[tuple[str, str]]:
    """What is wrong with corners between which there is nothing."""
    x, y = np.array(corners).T
    twice = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    if abs(twice) > 2e-4:
        return []
    return [(key, "its corners enclose nothing: give them in order around the zone")]


def _drawn(polygons: Sequence[Polygon], name: str) -> tuple[NDArray[np.float32], Pose]:
    """All cells that polygons cover, the last one's value where several do; and the origin."""
    all_ = np.vstack([np.array(corners, dtype=np.float64) for corners, _ in polygons])
    low = np.floor(all_.min(axis=0) / CELL).astype(int) - 1
    width, height = (np.ceil(all_.max(axis=0) / CELL).astype(int) + 2 - low).tolist()
    if width * height > MOST_CELLS or max(width, height) > _MOST_IN_A_ROW:
        raise CohelmError(
            f"zones.{name}: from {low[0] * CELL:g}, {low[1] * CELL:g} they span {width} x {height} "
            f"cells of {CELL:g} m, more than {MOST_CELLS}, or than {_MOST_IN_A_ROW} in a row: are "
            "all corners in metres?"
        )
    cells = np.zeros((height, width), dtype=np.float32)
    for corners, value in polygons:
        _draw(cells, np.array(corners, dtype=np.float64) / CELL - low, value)
    return cells, Pose(float(low[0]) * CELL, float(low[1]) * CELL, 0.0)


def _draw(cells: NDArray[np.float32], corners: Floats, value: float) -> None:
    """Into all cells whose middle is in a polygon, or through which an edge of it goes. corners:
    (k, 2), in cells from the lower left one's corner."""
    turns = np.zeros(cells.shape, dtype=np.int64)
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way = end - begin
        low, high = sorted((float(begin[1]), float(end[1])))
        rows = np.arange(math.ceil(low - 0.5), math.ceil(high - 0.5))
        if len(rows):
            across = begin[0] + way[0] * (rows + 0.5 - begin[1]) / way[1]
            np.add.at(turns, (rows, np.ceil(across - 0.5).astype(np.int64)), 1)
        ends: list[Floats] = [np.array((0.0, 1.0))]
        for a in (0, 1):  # where the edge enters another column, another row
            if way[a] != 0.0:
                first, last = sorted((begin[a], end[a]))
                lines: Floats = np.arange(math.ceil(first), math.floor(last) + 1, dtype=np.float64)
                ends.append((lines - begin[a]) / way[a])
        shares = np.sort(np.concatenate(ends))
        at = np.floor(begin + (0.5 * (shares[1:] + shares[:-1]))[:, None] * way).astype(np.int64)
        cells[at[:, 1], at[:, 0]] = value
    cells[np.cumsum(turns, axis=1) % 2 == 1] = value


def read_zones(kept_out: Path | None, slow: Path | None, start: Pose) -> Zones:
    """From masks of map_server, on the map's frame; one that `cohelm map` has drawn begins at
    `start`. CohelmError for a mask that can not be used."""
    return Zones(
        None if kept_out is None else _kept_out(read_map(kept_out).placed(start), str(kept_out)),
        None if slow is None else _slow(read_speed_mask(slow), start, str(slow)),
    )


def masked(masks: Sequence[FilterMask], lifted: bool = False) -> Zones:
    """From masks of topics, one of each kind at most. lifted: a mask may mark nothing. CohelmError
    for one that can not be used."""
    made = UNZONED
    for one in masks:
        cells = OccupancyMap(one.cells, one.resolution, one.origin)
        if lifted and not (one.cells > 0).any():
            made = _lifted(made, one)
        elif one.kind == KEEP_OUT:
            made = made._replace(keep_out=_kept_out(cells, one.name))
        else:
            mask = SpeedMask(cells, one.kind == SPEED, one.base, one.multiplier)
            made = made._replace(slow=_slow(mask.checked(one.name), Pose(0.0, 0.0, 0.0), one.name))
    return made


def _lifted(made: Zones, one: FilterMask) -> Zones:
    """With no zone of that kind any more."""
    none = Cells(np.zeros(one.cells.shape, np.float32), one.resolution, one.origin)
    if one.kind == KEEP_OUT:  # not divided as zones are: a coarse grid may have any number of cells
        return made._replace(keep_out=KeepOut(none, np.zeros(one.cells.shape, np.int32)))
    return made._replace(slow=SpeedZones(none, False))


def check(zones: Zones, known: LocalizationMap | None) -> None:
    """Raises CohelmError where a map can not represent the zones."""
    if known is None:
        raise CohelmError(
            "zones stand on the map, and there is none to localise on: give one with --map, or a "
            "scenario with walls"
        )
    rasters = (
        ("keep-out", None if zones.keep_out is None else zones.keep_out.depth),
        ("speed", None if zones.slow is None else zones.slow.limits),
    )
    low, high = Cells(known.gap, known.resolution, known.origin).bounds()
    for name, cells in rasters:
        if cells is None:
            continue
        first, last = cells.bounds()
        if (first >= high).any() or (last <= low).any():
            raise CohelmError(
                f"the {name} zones lie beside the map, from {first[0]:.1f}, {first[1]:.1f} to "
                f"{last[0]:.1f}, {last[1]:.1f}, where the map goes from {low[0]:.1f}, {low[1]:.1f} "
                f"to {high[0]:.1f}, {high[1]:.1f}: correct their corners, or their mask's origin "
                "or resolution"
            )


def _kept_out(made: OccupancyMap, name: str) -> KeepOut:
    marked = made.cells >= OCCUPIED
    if not marked.any():
        raise CohelmError(f"{name}: no cell is occupied, so no zone is marked: draw zones black")
    rows, columns = marked.shape
    parts = max(round(made.resolution / CELL), 1)
    if rows * columns * parts * parts > MOST_CELLS:
        raise CohelmError(
            f"{name}: {columns} x {rows} cells of {made.resolution:g} m are more than {MOST_CELLS} "
            f"of {CELL:g} m: cut the mask to where zones are"
        )
    return keep_out(marked, made.resolution, made.origin)


def _slow(mask: SpeedMask, start: Pose, name: str) -> SpeedZones:
    made, limits = mask.cells.placed(start), mask.limits()
    if not mask.absolute:
        limits = np.where(limits < 100.0, limits / np.float32(100.0), np.float32(0.0))
        if not limits.any():
            raise CohelmError(
                f"{name}: no zone is slower than 100 %: draw them grey, with mode: scale, or give "
                "base and multiplier"
            )
    return SpeedZones(Cells(limits, made.resolution, made.origin), not mask.absolute)
