"""Where the LiDAR sees: what stood there can not vanish; what never saw vouches for nothing."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats, Ints
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
    points = foretold(before, now)
    beams, r = polar(lidar, points)
    index = np.rint(beams)
    n = len(now.ranges)
    inside = (index >= 2) & (index < n - 2) & (r < _FAR * lidar.range_max) & (r > lidar.range_min)
    index = np.where(inside, index, 2).astype(np.int64)
    around = np.stack([now.ranges[index + k] for k in (-2, -1, 0, 1, 2)])
    nearest = np.fmin.reduce(around)  # edges move by a beam or two; NaN: no beam looked
    room = slack + 0.03 * r + 5.0 * lidar.noise
    gone = inside & (nearest > r + room)
    nothing = gone & (nearest == math.inf)
    where = np.zeros(n, dtype=np.bool_)
    where[index[nothing]] = True
    apart = np.concatenate(([True], np.hypot(*np.diff(before.points, axis=0).T) > _APART))
    surface = np.cumsum(apart)[inside]
    arc = before.arc[inside]
    behind = gone & ~nothing
    return Vanished(
        _widest(gone[inside], surface, arc),
        _widest(nothing[inside], surface, arc),
        where,
        float(np.median((nearest - r)[behind])) if behind.any() else math.inf,
    )


def farther(before: Sight, now: Sight, lidar: Lidar) -> tuple[float, float]:
    """How much farther all that is flat is than foretold, in the middle [m], and how much surface
    that is [m]. People are not flat: they may all walk away at once.

    0 where a tenth of it is not half as much farther: whoever is pushed sees only what lies that
    way farther, so this is the ranges and not the motion.
    """
    _, flat = normals(before, lidar, max(lidar.noise, 0.005))
    beams, r = polar(lidar, foretold(before, now)[flat])
    index = np.rint(beams)
    there = (index >= 0) & (index < len(now.ranges)) & (r < _FAR * lidar.range_max)
    seen = now.ranges[index[there].astype(np.int64)]
    told = np.isfinite(seen) & (seen > lidar.range_min)
    off, arc = (seen - r[there])[told], before.arc[flat][there][told]
    surface = float(arc.sum())
    if surface == 0.0:
        return 0.0, 0.0
    middle = float(np.median(off))
    alike = float(arc[off > 0.5 * middle].sum()) > _ALL * surface
    return (middle, surface) if middle > 0.0 and alike else (0.0, surface)


def _widest(gone: NDArray[np.bool_], surface: Ints, arc: Floats) -> float:
    """Of the runs of points of one surface that are gone, the longest."""
    if not gone.any():
        return 0.0
    new = np.concatenate(([True], (np.diff(surface) != 0) | (np.diff(gone.astype(np.int8)) != 0)))
    run = np.cumsum(new) - 1
    return float(np.bincount(run, np.where(gone, arc, 0.0)).max())


class View:
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

    def take(self, ranges: Floats, gone: NDArray[np.bool_] | None) -> float:
        """A scan more. gone: beams in which what stood there has vanished.

        Returns over which angle nothing has been seen since things vanished there all at once, for
        so many scans that it is no accident [rad].
        """
        returns = ~np.isnan(ranges) if self._floor else np.isfinite(ranges) | (ranges < 0.0)
        seen = np.bincount(self._bin[returns], minlength=self._count)
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
        cone = self._cone(bearing)
        return bool((self.proven | ~self.empty)[cone].any()) if cone.any() else True

    def looks(self, bearing: float) -> bool:
        """Whether the LiDAR looks anywhere in that cone."""
        return bool(self._cone(bearing).any())

    def _cone(self, bearing: float) -> NDArray[np.bool_]:
        first = self._lidar.mount.psi + self._lidar.first
        middles = first + _BIN * (np.arange(self._count) + 0.5)
        off = np.abs(np.remainder(middles - bearing + math.pi, 2.0 * math.pi) - math.pi)
        return off <= _CONE

    @property
    def blank(self) -> bool:
        """Whether no direction returns anything now."""
        return bool(self.empty.all())
