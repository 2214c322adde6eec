"""Whether a robot was carried to somewhere else, told by floor that it had seen and that is gone.

Its wheels do not turn as it is lifted, so odometry has it where it was, and what it remembers of
floor beneath its camera's picture is of another place. But no floor is in the picture then, where
all of it was. A robot that drives to an edge has never seen floor behind that.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints
from cohelm.robot.collision_monitor.returns import Sensor

GONE_FOR = 0.3
"""Floor is missing for so long [s]: a picture that fails is over sooner, a lift is not."""
_BEHIND, _WIDE = 0.05, 0.1
"""Floor is asked for that so far behind where the picture begins, and so wide: as an edge comes
nearer, floor is known to a cell before it [m]."""
_MOST, _SOME = 0.8, 0.25
"""So much of what was known of it has to be missing, and so much of it has to have been known."""


class Carried:
    """Of one sensor that watches the floor, and cells around it."""

    def __init__(self, sensor: Sensor, far: Floats, bearings: Floats) -> None:
        """far, bearings: of the cells from the sensor, (n,) [m, rad]."""
        self._sensor, self._far, self._bearings = sensor, far, bearings
        begins = sensor.floor_from + _BEHIND
        self._asked = np.flatnonzero((far >= begins) & (far <= begins + _WIDE))
        self._since = math.nan
        self._before: NDArray[np.bool_] | None = None

    def drives(self) -> None:
        """Its wheels turn: it is where odometry has it, counted from here."""
        self._since, self._before = math.nan, None

    def look(
        self, known: NDArray[np.bool_], near: Callable[[], NDArray[np.bool_]], reach: Floats,
        psi: float, seen: float,
    ) -> bool:  # fmt: skip
        """After a scan of a robot whose wheels stand, whether it was carried. Then only floor that
        was known near it still is (who put it down has looked), and before the camera only along
        beams that see some. Known anew is what it sees as long as it is not driven.

        known: which cells are, (n,); changed. near: which are near the robot, (n,). reach: how far
        floor is seen along each beam [m]. psi: of the sensor. seen: when that was [s].
        """
        if self._before is None:
            if not self._missing(known, reach, psi):
                self._since = math.nan
                return False
            self._since = seen if math.isnan(self._since) else self._since
            if seen - self._since < GONE_FOR:
                return False
            self._before = known & near().ravel()
        beams, in_view = self._beams(self._bearings, psi)
        known[:] = self._before
        known[in_view & ~(reach[beams] > np.maximum(self._far, self._sensor.range_min))] = False
        return True

    def _missing(self, known: NDArray[np.bool_], reach: Floats, psi: float) -> bool:
        """Whether no floor is seen where it is known, but for what something nearer hides."""
        least = self._sensor.range_min
        beams, in_view = self._beams(self._bearings[self._asked], psi)
        reaches = reach[beams]
        hidden = (reaches < self._sensor.floor_from) & (reaches != least)
        was = in_view & known[self._asked] & ~hidden
        gone = was & ~(reaches > least)
        count = np.count_nonzero(was)
        return bool(
            count >= max(_SOME * np.count_nonzero(in_view), 1)
            and np.count_nonzero(gone) >= _MOST * count
        )

    def _beams(self, cells: Floats, psi: float) -> tuple[Ints, NDArray[np.bool_]]:
        """Of the bearing of each cell the beam that looks there, and whether one does."""
        bearings = self._sensor.bearings
        along = (cells - psi - bearings[0]) % (2.0 * math.pi)
        beams = (along / self._sensor.step + 0.5).astype(np.int64)
        in_view = along <= float(bearings[-1] - bearings[0])
        return np.minimum(beams, len(bearings) - 1), in_view
