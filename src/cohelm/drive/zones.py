"""Reads keep-out and speed zones: masks as Nav2's costmap filters have them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.frames import compose, placed
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.match.surfaces import MOST_CELLS
from cohelm.plan.zones import CELL, Cells, KeepOut, SpeedZones, Zones, keep_out
from cohelm.scenario.worlds.maps import OCCUPIED, OccupancyMap, read_map, read_speed_mask


def read_zones(kept_out: Path | None, slow: Path | None, start: Pose) -> Zones | None:
    """From masks of map_server, on the map's frame; one that `cohelm map` has drawn begins at
    `start`. None where none is given. CohelmError for a mask that can not be used."""
    if kept_out is None and slow is None:
        return None
    return Zones(
        None if kept_out is None else _kept_out(kept_out, start),
        None if slow is None else _slow(slow, start),
    )


def check(zones: Zones, known: LocalizationMap | None) -> None:
    """CohelmError where zones can not be told by a map."""
    if known is None:
        raise CohelmError(
            "zones stand on the map, and there is none to localise on: give one with --map, or a "
            "scenario with walls"
        )
    rasters = (
        ("--keep-out", None if zones.keep_out is None else zones.keep_out.depth),
        ("--speed-zones", None if zones.slow is None else zones.slow.limits),
    )
    low, high = _corners(known.gap.shape, known.resolution, known.origin)
    for name, cells in rasters:
        if cells is None:
            continue
        first, last = _corners(cells.values.shape, cells.resolution, cells.origin)
        if (first >= high).any() or (last <= low).any():
            raise CohelmError(
                f"{name}: the mask lies beside the map, from {first[0]:.1f}, {first[1]:.1f} to "
                f"{last[0]:.1f}, {last[1]:.1f}, where the map goes from {low[0]:.1f}, {low[1]:.1f} "
                f"to {high[0]:.1f}, {high[1]:.1f}: correct its origin or resolution"
            )


def _kept_out(path: Path, start: Pose) -> KeepOut:
    made = _on_map(read_map(path), start)
    marked = made.cells >= OCCUPIED
    if not marked.any():
        raise CohelmError(f"{path}: no cell is occupied, so no zone is marked: draw zones black")
    rows, columns = marked.shape
    parts = max(round(made.resolution / CELL), 1)
    if rows * columns * parts * parts > MOST_CELLS:
        raise CohelmError(
            f"{path}: {columns} x {rows} cells of {made.resolution:g} m are more than {MOST_CELLS} "
            f"of {CELL:g} m: cut the mask to where zones are"
        )
    return keep_out(marked, made.resolution, made.origin)


def _slow(path: Path, start: Pose) -> SpeedZones:
    mask = read_speed_mask(path)
    made, limits = _on_map(mask.cells, start), mask.limits()
    if not mask.absolute:
        limits = np.where(limits < 100.0, limits / np.float32(100.0), np.float32(0.0))
        if not limits.any():
            raise CohelmError(
                f"{path}: no zone is slower than 100 %: draw them grey, with mode: scale, or give "
                "base and multiplier"
            )
    return SpeedZones(Cells(limits, made.resolution, made.origin), not mask.absolute)


def _on_map(made: OccupancyMap, start: Pose) -> OccupancyMap:
    return replace(made, origin=compose(start, made.origin)) if made.from_start else made


def _corners(shape: tuple[int, ...], resolution: float, origin: Pose) -> tuple[Floats, Floats]:
    """The smallest and largest x and y of a raster in the map [m]."""
    height, width = shape
    ends = np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=np.float64)
    corners = placed(ends * resolution, origin)
    return corners.min(axis=0), corners.max(axis=0)
