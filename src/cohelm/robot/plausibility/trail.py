"""History of odometry, and of the commands sent, over the last seconds."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.types import Floats
from cohelm.robot.port import Odometry

_KEPT = 3.0  # for how long a row is kept [s]


class Trail:
    """Rows of time and numbers, in the order of time; old ones are dropped. Linear in between."""

    def __init__(self, columns: int) -> None:
        """columns: numbers in a row besides the time."""
        self._rows: Floats = np.empty((1024, columns + 1))
        self._first = self._end = 0

    def __len__(self) -> int:
        return self._end - self._first

    @property
    def rows(self) -> Floats:
        """Time first [s]."""
        return self._rows[self._first : self._end]

    @property
    def newest(self) -> float:
        """Time of the last row [s]; -inf: there is none."""
        return float(self._rows[self._end - 1, 0]) if len(self) else -math.inf

    def add(self, t: float, *values: float) -> None:
        """Append a newer row; where time went back or has a gap, the history begins anew."""
        if len(self) and not 0.0 < t - self.newest < 1.0:
            if t == self.newest:
                return
            self._first = self._end = 0
        if self._end == len(self._rows):
            kept = self.rows[-len(self._rows) // 2 :].copy()
            self._rows[: len(kept)] = kept
            self._first, self._end = 0, len(kept)
        self._rows[self._end] = (t, *values)
        self._end += 1
        while self._rows[self._first, 0] < t - _KEPT:
            self._first += 1

    def since(self, t: float) -> Floats:
        """Rows not older than t."""
        rows = self.rows
        return rows[np.searchsorted(rows[:, 0], t) :]


def extended(trail: Trail, odometry: Odometry) -> None:
    """Append a reading: x, y, unwrapped heading, v, omega."""
    x, y, psi = odometry.pose
    if len(trail):
        before = float(trail.rows[-1, 3])
        psi = before + math.remainder(psi - before, 2.0 * math.pi)
    trail.add(odometry.stamp, x, y, psi, *odometry.twist)
