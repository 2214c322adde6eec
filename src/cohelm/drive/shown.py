"""What stations and records are sent once: map, route, outline."""

from __future__ import annotations

import zlib

import numpy as np

from cohelm.law.reference import Reference, desired
from cohelm.link.messages import Line, Map, Polyline
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.plan.course import Course, poses_along

_STEP = 0.1  # between two points of a way [m]


def drawn(known: LocalizationMap) -> Map:
    """The map as a page draws it."""
    cells = np.where(known.gap <= 0.0, 100, 0).astype(np.uint8)
    cells[known.unknown] = 255
    rows, columns = cells.shape
    return Map(
        1, known.origin, known.resolution, columns, rows, 0, 0, columns, rows,
        zlib.compress(np.ascontiguousarray(cells).tobytes()),
    )  # fmt: skip


def detour(course: Course | None) -> Polyline:
    """The course that is driven, where it is not the reference's own; else no points."""
    points = np.empty((0, 2)) if course is None or course.row == 0 else course.poses[:, :2]
    return Polyline(Line.DETOUR, points.astype(np.float32))


def way(reference: Reference) -> tuple[Polyline, Polyline]:
    """The reference as a line, and its way-points."""
    at = [desired(reference, float(t), False) for t in reference.knots]
    points = np.array([(d.x, d.y) for d in at], dtype=np.float32)
    line = poses_along(reference, _STEP)[:, :2].astype(np.float32)
    return Polyline(Line.REFERENCE, line), Polyline(Line.WAYPOINTS, points)
