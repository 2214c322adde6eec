"""Solid cells of an occupancy map as few rectangles, so that physics has few boxes to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Ints


def rectangles(solid: NDArray[np.bool_]) -> Ints:
    """Rectangles that cover exactly the solid cells, once each.

    (k, 4): first row, first column, and the row and column after the last. Runs along a row grow
    upwards over the rows above as long as these have the very same run.
    """
    rows = len(solid)
    edge = np.zeros((rows, 1), dtype=np.int8)
    steps = np.diff(np.hstack((edge, solid.astype(np.int8), edge)), axis=1)
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(rows):
        starts, ends = np.flatnonzero(steps[row] > 0), np.flatnonzero(steps[row] < 0)
        runs = set(zip(starts.tolist(), ends.tolist(), strict=True))
        for run in sorted(growing.keys() - runs):
            found.append((growing.pop(run), run[0], row, run[1]))
        for run in sorted(runs - growing.keys()):
            growing[run] = row
    found += [(first, run[0], rows, run[1]) for run, first in sorted(growing.items())]
    return np.array(found, dtype=np.int64).reshape(-1, 4)
