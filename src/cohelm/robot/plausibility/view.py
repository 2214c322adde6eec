"""Where the LiDAR sees: what stood there can not vanish; what never saw vouches for nothing."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.robot.plausibility.sight import Sight, foretold, normals, polar
from cohelm.robot.sensors import Lidar

_FAR = 0.85  # surfaces foretold farther than this share of range_max may be out of range
_APART = 0.3  # points in a row that are farther apart are not on one surface [m]
_ALL = 0.9  # of the surface: the rest are edges, and what moves
_FOR = 3  # scans in a row without what had stood there are no accident
_BIN = math.radians(10.0)
_CONE = math.radians(30.0)
"""Sally's half width, 0.29 m, fills so much to either side half a metre before the LiDAR."""


class Vanished(NamedTuple):
    """Surface that stood there, and through which the LiDAR now looks."""

    width: float
    """The widest in one piece [m]."""
    empty: float
    """The widest in one piece where it now sees nothing at all [m]."""
    beams: NDArray[np.bool_]
    """(n,), where it sees nothing at all instead."""
    deeper: float = math.inf
    """So much farther away is what is seen in its place, in the middle [m]."""


def vanished(before: Sight, now: Sight, lidar: Lidar, slack: float) -> Vanished:
    """slack: how far odometry may be off meanwhile [m]."""
    beams, r = polar(lidar, foretold(before, now))
    return Vanished(*_vanished(
        beams, r, before.points, before.arc, now.ranges, lidar.range_min,
        _FAR * lidar.range_max, slack, 5.0 * lidar.noise,
    ))  # fmt: skip


@jit
def _vanished(
    beams: Floats, r: Floats, points: Floats, arc: Floats, ranges: Floats, least: float,
    most: float, slack: float, noise: float,
) -> tuple[float, float, NDArray[np.bool_], float]:  # fmt: skip
    """beams, r: where the points of the earlier sight are foretold; ranges: of the later one."""
    n, k = len(ranges), 0
    width = empty = gone_so_far = empty_so_far = 0.0
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
            gone_so_far, empty_so_far, apart = 0.0, 0.0, False
        nearest = math.nan  # edges move by a beam or two; NaN: no beam looked
        for j in range(at - 2, at + 3):
            if not (nearest <= ranges[j] or math.isnan(ranges[j])):
                nearest = ranges[j]
        gone = nearest > r[i] + (slack + 0.03 * r[i] + noise)
        nothing = gone and nearest == math.inf
        gone_so_far = gone_so_far + arc[i] if gone else 0.0
        empty_so_far = empty_so_far + arc[i] if nothing else 0.0
        width, empty = max(width, gone_so_far), max(empty, empty_so_far)
        if nothing:
            where[at] = True
        elif gone:
            deeper[k] = nearest - r[i]
            k += 1
    return width, empty, where, float(np.median(deeper[:k])) if k > 0 else math.inf


def farther(before: Sight, now: Sight, lidar: Lidar) -> tuple[float, float]:
    """How much farther all that is flat is than foretold, in the middle [m], and how much surface
    that is [m]. People are not flat: they may all walk away at once.

    0 where a tenth of it is not half as much farther: whoever is pushed sees only what lies that
    way farther, so this is the ranges and not the motion.
    """
    _, flat = normals(before, lidar, max(lidar.noise, 0.005))
    beams, r = polar(lidar, foretold(before, now)[flat])
    return _farther(beams, r, before.arc[flat], now.ranges, lidar.range_min, _FAR * lidar.range_max)


@jit
def _farther(
    beams: Floats, r: Floats, arc: Floats, ranges: Floats, least: float, most: float
) -> tuple[float, float]:
    """beams, r: where flat points of the earlier sight are foretold; ranges: of the later one."""
    k, surface, alike = 0, 0.0, 0.0
    off, of = np.empty(len(r)), np.empty(len(r))
    for i in range(len(r)):
        at = round(beams[i])
        if 0 <= at < len(ranges) and r[i] < most and least < ranges[at] < math.inf:
            off[k], of[k] = ranges[at] - r[i], arc[i]
            surface += arc[i]
            k += 1
    if surface == 0.0:
        return 0.0, 0.0
    middle = float(np.median(off[:k]))
    for i in range(k):
        alike += of[i] if off[i] > 0.5 * middle else 0.0
    return (middle, surface) if middle > 0.0 and alike > _ALL * surface else (0.0, surface)


class ScanView:
    """Which directions of the LiDAR have shown that they see: by bins of ten degrees."""

    def __init__(self, lidar: Lidar) -> None:
        n = len(lidar.beams)
        self._lidar, self._floor = lidar, lidar.floor_from > 0.0
        """Who watches the floor returns inf only where that is seen, and so has seen."""
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
        """Of bearings that were asked about since the newest scan: what `looks` and `vouches` said.
        """

    def take(self, ranges: Floats, gone: NDArray[np.bool_] | None) -> float:
        """A scan more. gone: beams in which what stood there has vanished.

        Returns over which angle nothing has been seen since things vanished there all at once, for
        so many scans that it is no accident [rad].
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
        return _BIN * float(self._blinded.sum()) if self._scans >= _FOR else 0.0

    def forget(self) -> None:
        """What vanished is forgotten; what has shown that it sees is not."""
        self._blinded[:] = False

    def vouches(self, bearing: float) -> bool:
        """Whether anything in the cone about a bearing in the body frame sees, or has seen; yes
        where the LiDAR does not look."""
        return self._cone(bearing)[1]

    def looks(self, bearing: float) -> bool:
        """Whether the LiDAR looks anywhere in that cone."""
        return self._cone(bearing)[0]

    def _cone(self, bearing: float) -> tuple[bool, bool]:
        if bearing not in self._cones:
            first = self._lidar.mount.psi + self._lidar.first
            middles = first + _BIN * (np.arange(self._count) + 0.5)
            off = np.abs(np.remainder(middles - bearing + math.pi, 2.0 * math.pi) - math.pi)
            cone = off <= _CONE
            looks, sees = bool(cone.any()), bool((self.proven | ~self.empty)[cone].any())
            self._cones[bearing] = looks, sees or not looks
        return self._cones[bearing]

    @property
    def blank(self) -> bool:
        """Whether no direction returns anything now."""
        return bool(self.empty.all())
