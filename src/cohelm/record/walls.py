"""Draws walls into an occupancy map, for the page."""

from __future__ import annotations

import math
import zlib

import numpy as np

from cohelm.core.types import Floats, Pose
from cohelm.link.bulk_messages import Map

CELL = 0.05
MARGIN = 1.0
_MOST_CELLS = 2000


def drawn(walls: Floats, also: Floats) -> Map:
    """walls: (s, 4) segments [m]. also: (n, 2) further points for the map to include [m]."""
    points = np.vstack((walls[:, :2], walls[:, 2:], also, np.zeros((0 if len(also) else 1, 2))))
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    cell = max(CELL, float((high - low).max()) / _MOST_CELLS)
    width, height = np.ceil((high - low) / cell).astype(int).tolist()
    cells = np.zeros((height, width), dtype=np.uint8)
    for x1, y1, x2, y2 in walls:
        n = int(math.hypot(x2 - x1, y2 - y1) / (0.5 * cell)) + 2
        at = ((np.linspace((x1, y1), (x2, y2), n) - low) / cell).astype(int)
        cells[at[:, 1], at[:, 0]] = 100
    origin = Pose(float(low[0]), float(low[1]), 0.0)
    packed = zlib.compress(cells.tobytes())
    return Map(1, origin, cell, width, height, 0, 0, width, height, packed)
