"""Detects surfaces that vanish from the scan, and directions in which the LiDAR never returned."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.robot.plausibility.sight import Sight, normals, polar, predict
from cohelm.robot.sensors import Lidar

_FAR = 0.85  # surfaces predicted beyond this share of range_max may be out of range
_APART = 0.3  # consecutive points farther apart are on different surfaces [m]
_MIN_SHARE = 0.9  # of the surface: the rest are edges and movers
_MIN_SCANS = 3  # scans in a row before blinded directions are reported
_BIN = math.radians(10.0)
_CONE = math.radians(30.0)
"""Largest half angle in which a return vouches for a direction: any return in it does, so a wider
one would prove less."""
_BEFORE = 0.5  # a robot is as wide as the half angle, so far before its LiDAR [m]


class Vanished(NamedTuple):
    """Surface of an earlier sight through which the LiDAR now looks."""

    width: float
    """Width of the widest piece [m]."""
    empty: float
    """Width of the widest piece where it now sees nothing at all [m]."""
    beams: NDArray[np.bool_]
    """(n,), beams that see nothing at all in its place."""
    deeper: float = math.inf
    """Median by which the surface in its place is farther away [m]."""


def vanished(before: Sight, now: Sight, lidar: Lidar, slack: float) -> Vanished:
    """slack: odometry's error between the two [m]."""
    beams, r = polar(lidar, predict(before, now))
    return Vanished(*_vanished(
        beams, r, before.points, before.arc, now.ranges, lidar.range_min,
        _FAR * lidar.range_max, slack, 5.0 * lidar.noise,
    ))  # fmt: skip


@jit
def _vanished(
    beams: Floats, r: Floats, points: Floats, arc: Floats, ranges: Floats, least: float,
    most: float, slack: float, noise: float,
) -> tuple[float, float, NDArray[np.bool_], float]:  # fmt: skip
    """beams, r: predicted, of the points of the earlier sight; ranges: of the later one."""
    n, k = len(ranges), 0
    width = empty = gone_length = empty_length = 0.0
    where, deeper = np.zeros(n, dtype=np.bool_), np.empty(len(points))
    apart = True  # whether a surface has ended since the last point in view
    for i in range(len(points)):
        if i > 0:
            dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
            apart = apart or math.hypot(dx, dy) > _APART
        at = round(beams[i])
        if not (2 <= at < n - 2 and least < r[i] < most):
            continue
        if apart:
            gone_length, empty_length, apart = 0.0, 0.0, False
        nearest = math.nan  # edges move by a beam or two; NaN: no beam looked
        for j in range(at - 2, at + 3):
            if not (nearest <= ranges[j] or math.isnan(ranges[j])):
                nearest = ranges[j]
        gone = nearest > r[i] + (slack + 0.03 * r[i] + noise)
        nothing = gone and nearest == math.inf
        gone_length = gone_length + arc[i] if gone else 0.0
        empty_length = empty_length + arc[i] if nothing else 0.0
        width, empty = max(width, gone_length), max(empty, empty_length)
        if nothing:
            where[at] = True
        elif gone:
            deeper[k] = nearest - r[i]
            k += 1
    return width, empty, where, float(np.median(deeper[:k])) if k > 0 else math.inf


def farther(before: Sight, now: Sight, lidar: Lidar) -> tuple[float, float]:
    """Median by which flat surfaces are farther than predicted [m], and their total length [m].
    People are not flat: they may all walk away at once.

    0 where more than a tenth of it is less than half as much farther: for a robot that was pushed,
    only surfaces on one side are farther, so the median is of the ranges and not of the motion.
    """
    _, flat = normals(before, max(lidar.noise, 0.005))
    beams, r = polar(lidar, predict(before, now)[flat])
    return _farther(beams, r, before.arc[flat], now.ranges, lidar.range_min, _FAR * lidar.range_max)


@jit
def _farther(
    beams: Floats, r: Floats, arc: Floats, ranges: Floats, least: float, most: float
) -> tuple[float, float]:
    """beams, r: predicted, of flat points of the earlier sight; ranges: of the later one."""
    k, surface, alike = 0, 0.0, 0.0
    error, of = np.empty(len(r)), np.empty(len(r))
    for i in range(len(r)):
        at = round(beams[i])
        if 0 <= at < len(ranges) and r[i] < most and least < ranges[at] < math.inf:
            error[k], of[k] = ranges[at] - r[i], arc[i]
            surface += arc[i]
            k += 1
    if surface == 0.0:
        return 0.0, 0.0
    middle = float(np.median(error[:k]))
    for i in range(k):
        alike += of[i] if error[i] > 0.5 * middle else 0.0
    return (middle, surface) if middle > 0.0 and alike > _MIN_SHARE * surface else (0.0, surface)


class ScanView:
    """Which directions of the LiDAR have returned anything: by bins of ten degrees."""

    def __init__(self, lidar: Lidar, half_width: float) -> None:
        """half_width: of the robot [m]."""
        n = len(lidar.beams)
        self._half = min(max(math.atan2(half_width, _BEFORE), 0.5 * _BIN), _CONE)
        """Half angle of the cone about a bearing in which a return vouches for it [rad]."""
        self._lidar, self._floor = lidar, lidar.floor_from > 0.0
        """A sensor that watches the floor returns inf only where it sees the floor."""
        self._bin = (np.arange(n) * lidar.step / _BIN).astype(np.int64)
        self._count = int(self._bin[-1]) + 1
        self._size = np.bincount(self._bin, minlength=self._count)
        self.proven = np.zeros(self._count, dtype=np.bool_)
        """Has returned something, and nothing has vanished there since."""
        self.empty = np.ones(self._count, dtype=np.bool_)
        """Returns nothing now."""
        self._blinded = np.zeros(self._count, dtype=np.bool_)
        self._scans = 0
        self._cones: dict[float, tuple[bool, bool]] = {}
        """Cache of `looks` and `vouches` by bearing, for the newest scan."""

    def take(self, ranges: Floats, gone: NDArray[np.bool_] | None) -> float:
        """Add a scan. gone: beams in which a surface has vanished.

        Returns the angle that has been empty since surfaces vanished there at once, if that lasts
        for `_MIN_SCANS` scans; else 0 [rad].
        """
        returns = ~np.isnan(ranges) if self._floor else np.isfinite(ranges) | (ranges < 0.0)
        seen = np.bincount(self._bin[returns], minlength=self._count)
        self._cones.clear()
        self.empty = seen == 0
        self.proven |= seen >= np.minimum(2, self._size)
        if gone is not None and gone.any():
            lost = np.bincount(self._bin[gone], minlength=self._count)
            blinded = (lost > 0.3 * self._size) & self.empty
            self.proven &= ~blinded
            self._blinded |= blinded
        self._blinded &= self.empty
        self._scans = self._scans + 1 if self._blinded.any() else 0
        return _BIN * float(self._blinded.sum()) if self._scans >= _MIN_SCANS else 0.0

    def forget(self) -> None:
        """Forget what vanished, but not which directions have returned anything."""
        self._blinded[:] = False

    def vouches(self, bearing: float) -> bool:
        """Whether any direction in the cone about a bearing in the body frame [rad] returns, or has
        returned, anything; true where the LiDAR does not look."""
        return self._cone(bearing)[1]

    def looks(self, bearing: float) -> bool:
        """Whether the LiDAR looks anywhere in that cone."""
        return self._cone(bearing)[0]

    def _cone(self, bearing: float) -> tuple[bool, bool]:
        if bearing not in self._cones:
            first = self._lidar.mount.psi + self._lidar.first
            middles = first + _BIN * (np.arange(self._count) + 0.5)
            error = np.abs(np.remainder(middles - bearing + math.pi, 2.0 * math.pi) - math.pi)
            cone = error <= self._half + 1e-9
            looks, sees = bool(cone.any()), bool((self.proven | ~self.empty)[cone].any())
            self._cones[bearing] = looks, sees or not looks
        return self._cones[bearing]

    @property
    def blank(self) -> bool:
        """Whether no direction returns anything now."""
        return bool(self.empty.all())
