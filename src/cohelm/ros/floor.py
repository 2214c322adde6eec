"""Floor that should be seen and is not: along each beam, where the floor that was seen ends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints
from cohelm.robot.sensors import FloorModel, LidarModel

_ENOUGH, _AGAIN = 0.6, 0.8
"""Of the pixels that should show the floor in a cell, so many have to; where it ended in the scan
before, so many, that an edge does not come and go with the noise."""
_BELOW = 0.1
"""Of a cell's points that show it, so many others may be deeper: strays at edges are."""
_FEW = 3.0
"""A cell in which fewer pixels would show the floor is not checked."""


class Floor:
    """Cells of floor before one sensor, in sectors about as wide at their far end as they are
    long. A cell is seen where enough of its points are as high as the floor, and hardly any
    below."""

    def __init__(self, model: LidarModel, floor: FloorModel) -> None:
        """floor: of the model."""
        self._floor, self._low = floor, (model.height_band_m or (math.inf, math.inf))[0]
        self._least = model.range_min_m
        step = model.lidar().step
        self._wide = max(1, round(floor.cell_m / (floor.to_m * step)))
        """Beams of a sector."""
        self._shape = (
            -(-model.beams // self._wide), max(1, round((floor.to_m - floor.from_m) / floor.cell_m))
        )  # fmt: skip
        self._long = (floor.to_m - floor.from_m) / self._shape[1]
        self._beams = np.arange(model.beams) // self._wide
        """The sector of each."""
        self._needed = np.ones(self._shape)
        self._ought = np.ones(self._shape, dtype=np.bool_)
        """Which cells ought to be seen."""
        self._ended: NDArray[np.bool_] = np.zeros(self._shape[0], dtype=np.bool_)
        """Where the floor ended in the scan before."""
        self.edges: NDArray[np.bool_] = np.zeros(model.beams, dtype=np.bool_)
        """Along which beams floor ended, by the last points."""
        self.seen = 1.0
        """Share of those that were, by the last points."""

    @property
    def begins(self) -> float:
        """From so far from the sensor cells are checked in all sectors; inf: in some none is
        [m]."""
        checked = self._ought.any(axis=1)
        first = self._floor.from_m + self._long * self._ought.argmax(axis=1)
        return float(np.where(checked, first, math.inf).max())

    def expect(self, beams: Ints, far: Floats) -> None:
        """On flat floor there would be a point along each of these beams, so far from the sensor
        (n,) [m]: cells that would have too few are not checked."""
        counts = self._counted(beams, far, np.ones(len(far), dtype=np.bool_))
        self._needed, self._ought = np.maximum(_ENOUGH * counts, 1.0), counts >= _FEW

    def stood(self, beams: Ints, far: Floats, heights: Floats, ranges: Floats) -> Floats:
        """(beams,), the ranges [m], and where the floor ends before them that instead: a cell
        before its last point, along each beam; at the least range where none is seen, as what
        begins nearer than the first cell can not be seen: the floor memory keeps where it was seen.
        Something nearer than the first cell hides it: the beam ends at that.

        Not the cell's end: that would be the same for many beams and scans, as of a sensor that
        hangs, and would jump as the robot moves.

        beams, far, heights: of all points that were measured, (n,); NaN counts nowhere [m].
        """
        floor = self._floor
        with np.errstate(invalid="ignore"):
            deep = heights < floor.height_m - floor.drop_m
            there = (heights < self._low) & ~deep
        shown, below = self._counted(beams, far, there), self._counted(beams, far, deep)
        needed = np.where(self._ended[:, None], _AGAIN / _ENOUGH, 1.0) * self._needed
        seen = self._ought & (shown >= needed) & (below <= _BELOW * shown)
        self.seen = float(seen[self._ought].mean()) if self._ought.any() else 0.0
        missing = self._ought & ~seen
        self._ended = np.asarray(missing.any(axis=1), dtype=np.bool_)
        cell = missing.argmax(axis=1)
        begins = self._ought.argmax(axis=1)[:, None]
        first = (cell[:, None] <= begins)[self._beams, 0]
        stops = (~seen & (np.arange(self._shape[1]) >= begins)).argmax(axis=1)
        far_ends: Floats = np.where(
            self._ended, floor.from_m + self._long * (cell + 1.0), -math.inf
        )
        hides = far_ends[self._beams]
        """Far ends of the first cells that are not seen: what stands before that hides it."""
        with np.errstate(invalid="ignore"):
            last = np.flatnonzero(there & (far >= floor.from_m) & (far < hides[beams]))
        # Pixels are spread unevenly over beams, and some are lost: one may show nothing by itself.
        # So its neighbours count too; and in the last cell that its sector shows, the floor may
        # end where that cell begins.
        ends: Floats = (floor.from_m + self._long * np.maximum(stops - 1, 0))[self._beams]
        np.maximum.at(ends, beams[last], far[last])
        neighbours = np.maximum(ends[2:], ends[:-2])
        ends[1:-1] = np.maximum(ends[1:-1], np.minimum(neighbours, hides[1:-1]))
        ends = np.where(first, self._hidden(ranges), ends - self._long)
        self.edges = ~(ranges < hides) & np.isfinite(hides)
        made: Floats = np.where(self.edges, ends, ranges)
        return made

    def _hidden(self, ranges: Floats) -> Floats:
        """(beams,), the distance of what hides the first cell of each one's sector; the least range
        where nothing does [m]."""
        starts = np.arange(0, len(ranges), self._wide)
        nearest: Floats = np.fmin.reduceat(ranges, starts)
        hides = np.where(nearest < self._floor.from_m, nearest, self._least)
        made: Floats = hides[self._beams]
        return made

    def _counted(self, beams: Ints, far: Floats, which: NDArray[np.bool_]) -> Floats:
        """(sectors, cells), how many of some points lie in each."""
        floor = self._floor
        with np.errstate(invalid="ignore"):
            chosen = np.flatnonzero(which & (far >= floor.from_m) & (far < floor.to_m))
        cells = ((far[chosen] - floor.from_m) * (1.0 / self._long)).astype(np.int64)
        np.minimum(cells, self._shape[1] - 1, out=cells)
        keys = beams[chosen] // self._wide * self._shape[1] + cells
        counts = np.bincount(keys, minlength=self._shape[0] * self._shape[1])
        made: Floats = counts.reshape(self._shape).astype(np.float64)
        return made
