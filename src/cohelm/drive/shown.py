"""Messages sent once to stations and records: map, zones, route, outline."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import compose
from cohelm.core.types import Pose
from cohelm.law.reference import Reference, desired
from cohelm.link.bulk_messages import DockPlace, Docks, LineKind, Map, Polyline, Zone, ZoneMap
from cohelm.link.rasters import coarser
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.plan.course import Course, poses_along
from cohelm.plan.docks import Dock
from cohelm.plan.zones import CELL, Cells, Zones
from cohelm.robot.keep.record_pipe import LARGEST

_STEP = 0.1  # spacing of points along a path [m]
_MOST_CELLS = LARGEST - 1000
"""Packed cells of a map that a record or live view is sent [B]."""
NO_ZONES = tuple(
    ZoneMap(what, Pose(0.0, 0.0, 0.0), CELL, math.nan, 0, 0, zlib.compress(b"")) for what in Zone
)
"""Clears the zones of an earlier robot on a station."""


def map_message(known: LocalizationMap) -> Map:
    """The map for the page."""
    cells = np.where(known.gap <= 0.0, 100, 0).astype(np.uint8)
    cells[known.unknown] = 255
    rows, columns = cells.shape
    return Map(
        1, known.origin, known.resolution, columns, rows, 0, 0, columns, rows,
        zlib.compress(np.ascontiguousarray(cells).tobytes()),
    )  # fmt: skip


def recordable(shown: Map | ZoneMap | Polyline) -> Map | ZoneMap | Polyline:
    """The same for records and live views. Of a map that does not fit into one message, cells twice
    as wide, as often as needed."""
    while isinstance(shown, Map) and len(shown.cells) > _MOST_CELLS:
        shown = coarser(shown)
    return shown


def zone_messages(zones: Zones, u_d: float) -> tuple[ZoneMap, ...]:
    """Keep-out and speed zones for the page. u_d: the usual speed [m/s]."""
    made: list[ZoneMap] = []
    kept_out, slow = zones
    if kept_out is not None:
        cells = np.where(kept_out.zone > 0, 100, 0).astype(np.uint8)
        made += _zone_map(Zone.KEEP_OUT, kept_out.depth, cells, u_d)
    if slow is not None:
        limits = slow.limits.values
        share = limits if slow.share else limits / u_d
        percent = np.clip(np.rint(100.0 * share), 1.0, 100.0)
        cells = np.where((limits > 0.0) & (share < 1.0), percent, 0.0).astype(np.uint8)
        made += _zone_map(Zone.SPEED, slow.limits, cells, u_d)
    return tuple(made)


def all_zone_messages(zones: Zones, u_d: float) -> tuple[ZoneMap, ...]:
    """`zone_messages` of each kind; an empty message clears a kind that has no zones."""
    made = {one.what: one for one in (*NO_ZONES, *zone_messages(zones, u_d))}
    return tuple(made.values())


def _zone_map(what: Zone, raster: Cells, cells: NDArray[np.uint8], u_d: float) -> list[ZoneMap]:
    """One message, cropped to the marked cells; none if no cell is marked."""
    marked = [np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0)]
    if not len(marked[0]):
        return []
    (top, bottom), (left, right) = ((int(at[0]), int(at[-1]) + 1) for at in marked)
    side, part = raster.resolution, np.ascontiguousarray(cells[top:bottom, left:right])
    origin = compose(raster.origin, Pose(left * side, top * side, 0.0))
    return [
        ZoneMap(what, origin, side, u_d, right - left, bottom - top, zlib.compress(part.tobytes()))
    ]


def docks_message(docks: Sequence[Dock]) -> Docks:
    """The docks of a site."""
    return Docks(tuple(DockPlace(dock.name, dock.pose, dock.approach) for dock in docks))


def detour(course: Course | None) -> Polyline:
    """The course in use if it differs from the reference's; else no points."""
    points = np.empty((0, 2)) if course is None or course.row == 0 else course.poses[:, :2]
    return Polyline(LineKind.DETOUR, points.astype(np.float32))


def reference_lines(reference: Reference | None) -> tuple[Polyline, Polyline]:
    """The reference as a line, and its waypoints; without one, no points, which clears an earlier
    robot's on a station."""
    if reference is None:
        none = np.empty((0, 2), dtype=np.float32)
        return Polyline(LineKind.REFERENCE, none), Polyline(LineKind.WAYPOINTS, none)
    at = [desired(reference, float(t), False) for t in reference.knots]
    points = np.array([(d.x, d.y) for d in at], dtype=np.float32)
    line = poses_along(reference, _STEP)[:, :2].astype(np.float32)
    return Polyline(LineKind.REFERENCE, line), Polyline(LineKind.WAYPOINTS, points)
