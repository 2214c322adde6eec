"""An occupancy grid from scans with known poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import placed
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.match.surfaces import MOST_CELLS

_BEFORE = 0.07  # the last part of a beam is not counted as free [m]
_SHARE = 0.35  # share of a cell's beams that must have ended in it
_CREST = 0.3  # share of the hits of the fullest neighbour that it must have
_BORDER = 0.5  # of the grid around all hits [m]


class Raster(NamedTuple):
    """hits, misses: (rows, columns), beams that ended in a cell, and that passed it; row 0 at
    the smallest y. resolution [m]; origin: pose of the outer corner of cell (0, 0)."""

    hits: NDArray[np.int32]
    misses: NDArray[np.int32]
    resolution: float
    origin: Pose

    def occupied(self) -> NDArray[np.bool_]:
        """Occupied cells: the crest of the scattered hits of a wall."""
        crest = scipy.ndimage.maximum_filter(self.hits, 3)
        often = self.hits > _SHARE * (self.hits + self.misses)
        return often & (self.hits >= 2) & (self.hits >= _CREST * crest)

    def free(self) -> NDArray[np.bool_]:
        """Free cells: passed by a beam, with scattered hits at most."""
        return (self.misses > 0) & ~self.occupied()


def raster(poses: list[Pose], points: list[Floats], sensor: Pose, resolution: float) -> Raster:
    """From poses of the body and points (m, 2) in it [m]; sensor: mount of the LiDAR.

    Raises CohelmError for more than MOST_CELLS.
    """
    low, high = np.full(2, math.inf), np.full(2, -math.inf)
    for pose, seen in zip(poses, points, strict=True):
        if len(seen):
            world = placed(seen, pose)
            low, high = np.minimum(low, world.min(axis=0)), np.maximum(high, world.max(axis=0))
        low, high = np.minimum(low, pose[:2]), np.maximum(high, pose[:2])
    low = np.floor((low - _BORDER) / resolution) * resolution
    size = np.ceil((high + _BORDER - low) / resolution)
    if not float(size[0]) * float(size[1]) <= MOST_CELLS:
        wide, deep = (float(n) * resolution for n in size)
        raise CohelmError(
            f"the drive spans {wide:.4g} x {deep:.4g} m, more than {MOST_CELLS // 10**6} million "
            f"cells of {resolution:g} m: choose a coarser --resolution, or check its odometry"
        )
    size = size.astype(int)
    hits = np.zeros((int(size[1]), int(size[0])), np.int32)
    misses = np.zeros_like(hits)
    for pose, seen in zip(poses, points, strict=True):
        _draw(hits, misses, pose, seen, sensor, resolution, float(low[0]), float(low[1]))
    return Raster(hits, misses, resolution, Pose(float(low[0]), float(low[1]), 0.0))


def cropped(drawn: Raster, low: tuple[float, float], high: tuple[float, float]) -> Raster:
    """The cells between two corners [m]. CohelmError where there are none."""
    r, (x, y, _) = drawn.resolution, drawn.origin
    rows, columns = drawn.hits.shape
    left, right = max(math.floor((low[0] - x) / r), 0), min(math.ceil((high[0] - x) / r), columns)
    below, above = max(math.floor((low[1] - y) / r), 0), min(math.ceil((high[1] - y) / r), rows)
    if left >= right or below >= above:
        raise CohelmError(
            f"what --crop keeps is not on the map, which goes from {x:.1f}:{y:.1f} to "
            f"{x + columns * r:.1f}:{y + rows * r:.1f}"
        )
    part = np.s_[below:above, left:right]
    origin = Pose(x + left * r, y + below * r, 0.0)
    return Raster(drawn.hits[part].copy(), drawn.misses[part].copy(), r, origin)


@jit
def _draw(
    hits: NDArray[np.int32], misses: NDArray[np.int32], pose: Pose, points: Floats, sensor: Pose,
    resolution: float, x0: float, y0: float,
) -> None:  # fmt: skip
    """Count the beams of one scan."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    sx, sy = pose.x + c * sensor.x - s * sensor.y, pose.y + s * sensor.x + c * sensor.y
    rows, columns = hits.shape
    for p in range(len(points)):
        px = pose.x + c * points[p, 0] - s * points[p, 1]
        py = pose.y + s * points[p, 0] + c * points[p, 1]
        hits[int((py - y0) / resolution), int((px - x0) / resolution)] += 1
        far = math.hypot(px - sx, py - sy)
        if far <= _BEFORE:
            continue
        dx, dy = (px - sx) / far, (py - sy) / far
        t, li, lj = 0.0, -1, -1
        while t < far - _BEFORE:
            i, j = int((sy + t * dy - y0) / resolution), int((sx + t * dx - x0) / resolution)
            if (i != li or j != lj) and 0 <= i < rows and 0 <= j < columns:
                misses[i, j] += 1
                li, lj = i, j
            t += 0.7 * resolution
