"""Makes a localization map from known walls and discs."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap, map_from_occupancy

_CELL = 0.025  # [m]
_NO_DISCS: Floats = np.empty((0, 3))


def map_from_geometry(walls: Floats, inside: Pose, discs: Floats = _NO_DISCS) -> LocalizationMap:
    """The map of these: what can be reached from `inside` is free.

    walls: (s, 4) segments [m]. discs: (n, 3), x, y, radius of round things [m]. Raises
    CohelmError where there is no wall to localise by.
    """
    if not len(walls):
        raise CohelmError(
            "there are no walls to localise by: give a map with --map, or walls_m in the scenario"
        )
    low = walls.reshape(-1, 2).min(axis=0) - 0.5
    columns, rows = np.ceil((walls.reshape(-1, 2).max(axis=0) + 0.5 - low) / _CELL).astype(np.int64)
    occupied = np.zeros((int(rows), int(columns)), dtype=np.bool_)
    for x1, y1, x2, y2 in (walls - np.tile(low, 2)).tolist():
        n = max(int(math.hypot(x2 - x1, y2 - y1) / (0.4 * _CELL)), 1) + 1
        along = np.linspace(0.0, 1.0, n)
        row = np.rint((y1 + along * (y2 - y1)) / _CELL).astype(np.int64)
        column = np.rint((x1 + along * (x2 - x1)) / _CELL).astype(np.int64)
        occupied[row, column] = True
    y, x = np.mgrid[0:rows, 0:columns] * _CELL
    for cx, cy, radius in discs.tolist():
        occupied |= np.hypot(x + low[0] - cx, y + low[1] - cy) <= radius
    origin = Pose(float(low[0]) - 0.5 * _CELL, float(low[1]) - 0.5 * _CELL, 0.0)
    free = _reached(occupied, inside.y - origin.y, inside.x - origin.x)
    return map_from_occupancy(occupied, free, _CELL, origin)


def _reached(occupied: NDArray[np.bool_], y: float, x: float) -> NDArray[np.bool_]:
    """The cells connected with the one at a place [m] from the map's corner."""
    labels: NDArray[np.int32] = scipy.ndimage.label(~occupied)[0]  # pyright: ignore[reportAssignmentType, reportUnknownVariableType]
    i = min(max(int(y / _CELL), 0), len(labels) - 1)
    j = min(max(int(x / _CELL), 0), labels.shape[1] - 1)
    return (labels == labels[i, j]) & ~occupied
