"""Docks as a scenario has them, and whether a robot can dock there by a map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from cohelm.core.errors import CohelmError
from cohelm.core.frames import placed
from cohelm.core.schema import Coordinate, Schema
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.plan.distance_field import swept_clearances
from cohelm.plan.docks import Dock, poses_to
from cohelm.plan.zones import Cells, Zones, covering

OFF = math.sqrt(0.5)
"""A surface is no farther from the middle of its cell than so many sides of one."""


class DockModel(Schema):
    """A named place that the robot drives into, straight and slowly."""

    name: Annotated[str, Field(min_length=1, max_length=24)]
    """What to call it; names differ."""
    x_m: Coordinate
    """World x of the docked robot's centre."""
    y_m: Coordinate
    """World y of the docked robot's centre."""
    heading_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]
    """Where the docked robot looks, counter-clockwise from x; it drives in forwards."""
    approach_m: Annotated[float, Field(ge=0.3, le=5.0)] = 1.0
    """Length of the straight way that ends there."""
    margin_m: Annotated[float, Field(gt=0.0, le=1.0)]
    """Clearance that it keeps on that way, instead of the guard's soft_margin_m; not less than the
    robot's hard margin, errors of its sensors included."""
    speed_mps: Annotated[float, Field(ge=0.02, le=0.5)] = 0.15
    """Largest speed requested on it."""
    within_s: Annotated[float, Field(ge=1.0, le=600.0)] = 40.0
    """Docking, or undocking, that takes longer is given up."""

    def dock(self) -> Dock:
        """The same as numbers."""
        return Dock(
            self.name, Pose(self.x_m, self.y_m, self.heading_rad), self.approach_m, self.margin_m,
            self.speed_mps, self.within_s,
        )  # fmt: skip


def checked(
    docks: Sequence[DockModel], outline: Floats, hard_margin: float,
    known: LocalizationMap | None, zones: Zones,
) -> tuple[Dock, ...]:  # fmt: skip
    """The docks of a robot at its site; CohelmError where it could not dock at one.

    outline: (k, 2), body frame [m]. hard_margin: of its guard [m]. known: the map.
    """
    if docks and known is None:
        raise CohelmError(
            "docks stand on the map, and there is none to localise on: give one with --map, or a "
            "scenario with walls"
        )
    made = tuple(model.dock() for model in docks)
    for dock in made:
        problem = _wrong(dock, outline, hard_margin, known, zones)
        if problem:
            raise CohelmError(f"dock {dock.name}: {problem}")
    return made


def _wrong(
    dock: Dock, outline: Floats, hard_margin: float, known: LocalizationMap | None,
    zones: Zones,
) -> str:  # fmt: skip
    """Why no robot could dock there; empty: nothing on the map prevents it."""
    if dock.margin < hard_margin - 1e-6:
        return (
            f"margin_m is {dock.margin:g}, less than the {math.ceil(1e3 * hard_margin) / 1e3:g} m "
            "that this robot's guard always keeps: give at least that"
        )
    if known is None:
        return ""
    poses = poses_to(dock)
    for (x, y, _), what in (
        (poses[-1], "the docked robot"),
        (poses[0], "its approach's beginning"),
    ):
        if not _on_map(known, x, y):
            return f"{what}, at {x:.2f}, {y:.2f}, is not where the map knows of free ground"
    if problem := no_room(dock, outline, occupied(known), known.resolution):
        return f"{problem}: correct its pose, or shorten approach_m"
    kept_out = zones.keep_out
    if kept_out is not None:
        body = covering(outline, kept_out.depth.resolution)
        for pose in poses:
            if kept_out.depth.at(placed(body, Pose(*pose))).any():
                return "its approach leads through a keep-out zone"
    return ""


def no_room(dock: Dock, outline: Floats, surfaces: Floats, resolution: float) -> str:
    """Why a robot with this outline would not fit there, by a map's walls; empty: it does.

    outline: (k, 2), body frame. surfaces: (p, 2), the middles of the map's occupied cells.
    resolution: their size [m].
    """
    poses = poses_to(dock)
    gaps = swept_clearances(surfaces, outline, poses)
    if gaps[-1] <= 0.0:
        return "the docked robot would stand in a wall"
    tight = int(np.argmin(gaps))
    if gaps[tight] > 0.0 and gaps[tight] >= dock.margin - OFF * resolution:
        return ""
    x, y, _ = poses[tight]
    there = "docked" if tight == len(poses) - 1 else f"on its approach, at {x:.2f}, {y:.2f},"
    room = f"{100.0 * gaps[tight]:.0f} cm" if gaps[tight] > 0.0 else "nothing"
    return f"{there} the robot has {room} to a wall, less than margin_m, {dock.margin:g}"


def _on_map(known: LocalizationMap, x: float, y: float) -> bool:
    free = Cells((~known.unknown).astype(np.float32), known.resolution, known.origin)
    return bool(free.at(np.array([(x, y)]))[0] > 0.0)


def occupied(known: LocalizationMap) -> Floats:
    """The middles of all occupied cells, (p, 2) [m]."""
    cells = Cells(known.gap, known.resolution, known.origin)
    return cells.centres(*np.nonzero(known.gap <= 0.0))
