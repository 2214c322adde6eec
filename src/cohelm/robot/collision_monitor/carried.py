"""Detects that a robot was carried elsewhere, by known floor that is missing from the picture.

Its wheels do not turn while it is lifted, so odometry stays, and the remembered floor beneath its
camera's picture is of another place. But then no floor is in the picture, where all of it was
known. A robot that drives to an edge has never seen floor behind that.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints
from cohelm.robot.collision_monitor.returns import Sensor

GONE_FOR = 0.3
"""Time for which floor has to be missing [s]: a failed picture is over sooner, a lift is not."""
_BEHIND, _WIDE = 0.05, 0.1
"""Distance behind the beginning of the picture, and width, of the band of floor that is checked:
as an edge comes nearer, floor is known to a cell before it [m]."""
_MIN_MISSING, _MIN_KNOWN = 0.8, 0.25
"""Least share of the known floor that has to be missing, and of the band that has to be known."""


class Carried:
    """Detector for one sensor that watches the floor, and the cells around it."""

    def __init__(self, sensor: Sensor, distances: Floats, bearings: Floats) -> None:
        """distances, bearings: of the cells from the sensor, (n,) [m, rad]."""
        self._sensor, self._dist, self._bearings = sensor, distances, bearings
        begins = sensor.floor_from + _BEHIND
        self._band = np.flatnonzero((distances >= begins) & (distances <= begins + _WIDE))
        self._since = math.nan
        self._before: NDArray[np.bool_] | None = None

    def drives(self) -> None:
        """Reset: the wheels turn, so odometry is right from here on."""
        self._since, self._before = math.nan, None

    def look(
        self, known: NDArray[np.bool_], near: Callable[[], NDArray[np.bool_]], reach: Floats,
        psi: float, seen: float,
    ) -> bool:  # fmt: skip
        """After a scan of a robot whose wheels stand, whether it was carried. Then only known floor
        near it stays known (the operator who put it down has looked), and before the camera only
        along beams that see floor. As long as it is not driven, floor that it sees becomes known.

        known: which cells are, (n,); changed. near: which are near the robot, (n,). reach: distance
        to which floor is seen along each beam [m]. psi: of the sensor [rad]. seen: time [s].
        """
        if self._before is None:
            if not self._missing(known, reach, psi):
                self._since = math.nan
                return False
            self._since = seen if math.isnan(self._since) else self._since
            if seen - self._since < GONE_FOR:
                return False
            self._before = known & near()
        beams, in_view = self._beams(self._bearings, psi)
        known[:] = self._before
        known[in_view & ~(reach[beams] > np.maximum(self._dist, self._sensor.range_min))] = False
        return True

    def _missing(self, known: NDArray[np.bool_], reach: Floats, psi: float) -> bool:
        """Whether known floor is missing, apart from what something nearer hides."""
        least = self._sensor.range_min
        beams, in_view = self._beams(self._bearings[self._band], psi)
        reaches = reach[beams]
        hidden = (reaches < self._sensor.floor_from) & (reaches != least)
        was = in_view & known[self._band] & ~hidden
        gone = was & ~(reaches > least)
        count = np.count_nonzero(was)
        return bool(
            count >= max(_MIN_KNOWN * np.count_nonzero(in_view), 1)
            and np.count_nonzero(gone) >= _MIN_MISSING * count
        )

    def _beams(self, cells: Floats, psi: float) -> tuple[Ints, NDArray[np.bool_]]:
        """For the bearing of each cell the beam that looks there, and whether one does."""
        bearings = self._sensor.bearings
        along = (cells - psi - bearings[0]) % (2.0 * math.pi)
        beams = (along / self._sensor.step + 0.5).astype(np.int64)
        in_view = along <= float(bearings[-1] - bearings[0])
        return np.minimum(beams, len(bearings) - 1), in_view
