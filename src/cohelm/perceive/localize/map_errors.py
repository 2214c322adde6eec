"""Costs of the map errors that a hypothesis implies at a cold start: each error once.

An error of the map, a missing or an unmapped object, persists as long as it is in view, by however
many beams. So a hypothesis pays for it when it is first seen, by its length and not by its beams,
and never again for the same stretch of the map. A narrow error may be an edge that a slightly
different pose sees past: it counts in the mean over the views of the last metre. What may be a
person counts while it is in view, and for good once it has stood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cohelm.core.frames import eye
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.localize.localization_map import (
    AGREE,
    BEHIND,
    BEYOND,
    IN_FRONT,
    NEAR,
    RUN,
    SILENT,
    UNDRAWN,
    USUAL,
    LocalizationMap,
    read,
)
from cohelm.robot.sensors import Lidar

_SIDE = 0.25  # of the cells in which map errors are stored [m]
_SLOTS = 2048  # of the hash table; a place that needs more has been refuted before
_FILLED = 1800  # limit, so that probing is short
_CLOSE = 0.08  # an end as near to a wall agrees: cell size and LiDAR noise [m],
_TURNED = 0.01  # and the heading error of a pose [rad]
_BROAD = 1.0  # a longer straight object is a wall, no person and no cupboard [m],
_LINE = 0.1  # tolerance of a straight line, twice the noise of a poor LiDAR [m]
_SHORT = -1.5  # log likelihoods: of an unmapped object,
_THROUGH = -3.0  # of a missing or an unmapped wall,
_WIDE = -1.0  # and of each metre, the correlation length of map errors (`MatchParams.correlated`)
_RIGHT = -2.0  # of a map that is wrong here at all;
_AGAIN = 0.7  # further errors are likelier after a first one
_AROUND = ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_VIEWS = 7  # of a metre, 15 cm apart (`past_views.NEAR`)
_STOOD = 2.3  # a walker 0.4 m wide at 0.5 m/s has left a cell and its neighbours [s]
_WALL, _PERHAPS = 5, 6  # kinds beside those of `read`: in front and a wall, or possibly a person


def _nothing() -> Ints:
    """An empty table: slot 0 has the number of entries, each a cell and a kind."""
    return np.zeros(_SLOTS + 1, dtype=np.int64)


def _nowhere() -> Floats:
    return np.zeros((_SLOTS + 1, 2))


@dataclass
class MapErrorCosts:
    """Costs of one hypothesis, over all views so far."""

    cells: Ints = field(default_factory=_nothing)
    """Cells of the map that were seen, and cells with an error;"""
    off: Floats = field(default_factory=_nowhere)
    """of each, by how much beam ends lie closer to it than is usual, summed over the length of
    wall, and that length [m]; of a possible person, since when it is there, and when it last was
    [s]."""
    errors: float = 0.0
    """Log likelihood of the errors,"""
    in_view: float = 0.0
    """of possible persons in the newest view,"""
    closer: float = 0.0
    """and of how much closer than usual beam ends lie to walls."""
    edges: float = 0.0
    """Log likelihood of narrow errors, in the mean over the views of the last metre."""
    views: int = 0

    def take(self, view: tuple[float, float, float, float]) -> None:
        """Add one more view (`new_errors`)."""
        self.errors += view[0]
        self.in_view = view[1]
        self.closer += view[2]
        self.views += 1
        self.edges += (view[3] - self.edges) / min(self.views, _VIEWS)

    @property
    def log(self) -> float:
        """Log likelihood of all of it. The closeness to a wall counts once, however long it is in
        view: it does not separate two equal rooms."""
        return _wrong(self.errors + self.in_view) + self.closer + self.edges

    @property
    def most(self) -> float:
        """Upper bound of `log`, if all possible persons leave."""
        return _wrong(self.errors) + self.closer + self.edges


def _wrong(errors: float) -> float:
    """Log likelihood of a map with these errors, each of which alone has its own."""
    return _RIGHT * (1.0 - math.exp(errors)) + _AGAIN * errors


@jit
def new_errors(
    known: LocalizationMap, lidar: Lidar, pose: Pose, ranges: Floats, every: int, offset: float,
    spread: float, seen: Ints, lies: Floats, stamp: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Log likelihoods by every `every`-th beam of a scan from a body pose: of map errors seen for
    the first time; of possible persons; change of that of the closeness of beam ends to walls; and
    of narrow errors. Each metre of wall counts once, with the mean of all that ended there; an
    unmapped one with the mean of the mapped.

    seen, lies: of the place (`MapErrorCosts.cells`, `off`), to which it is added. stamp: of the
    scan [s]."""
    x, y, c, s = eye(pose, lidar.mount)
    kinds, cells = np.empty(len(ranges), np.int64), np.empty((len(ranges), 2), np.int64)
    fars, ends = np.empty(len(ranges)), np.empty((len(ranges), 2))
    n, closer, lain, near = 0, 0.0, 0.0, 0.0
    at, before_u, before_v = -1, 0, 0
    for i in range(0, len(ranges), every):
        if not ranges[i] > 0.0:
            continue
        dx = c * lidar.beams[i, 0] - s * lidar.beams[i, 1]
        dy = s * lidar.beams[i, 0] + c * lidar.beams[i, 1]
        turned = _TURNED * min(ranges[i], lidar.range_max)
        rough = math.hypot(spread, turned)
        kind, far, off = read(
            known, x, y, dx, dy, ranges[i], lidar.range_max, _CLOSE + turned, offset, rough
        )
        kinds[n], fars[n] = kind, far
        ends[n, 0], ends[n, 1] = x + ranges[i] * dx, y + ranges[i] * dy
        if kind != SILENT:
            u, v = math.floor((x + far * dx) / _SIDE), math.floor((y + far * dy) / _SIDE)
            cells[n, 0], cells[n, 1] = u, v
            if kind == AGREE:
                if at < 0 or u != before_u or v != before_v:
                    at, before_u, before_v = _kept(seen, u, v, kind), u, v
                wide = every * lidar.step * ranges[i]
                closer += _closer(lies, at, off, wide)
                near += wide * (USUAL - off)
                lain += wide
        n += 1
    log, in_view, narrow, begin = 0.0, 0.0, 0.0, 0
    while begin < n:
        end = begin + 1
        while end < n and kinds[end] == kinds[begin]:
            end += 1
        kind = kinds[begin]
        beams = (end - begin) * every
        nearest = fars[begin:end].min()
        thing = beams >= RUN and beams * lidar.step * nearest >= NEAR + _TURNED * nearest
        if beams >= RUN and not thing and kind in (IN_FRONT, BEHIND):
            narrow += _SHORT if kind == IN_FRONT else _THROUGH
        if thing and kind not in (AGREE, SILENT):
            wall = kind == IN_FRONT and _straight(ends[begin:end]) > _BROAD
            stood = kind != IN_FRONT or wall
            new, again = _first(seen, lies, cells[begin:end], kind, stamp, stood)
            log += _cost(kind, new, again)
            if not stood and new == 0 and not again:
                in_view += _SHORT + _WIDE * beams * lidar.step * nearest
            if kind == BEYOND and lain > 0.0:
                closer += 2.0 * _SIDE * new * near / lain
            if wall:
                new, again = _first(seen, lies, cells[begin:end], _WALL, stamp, True)
                log += _THROUGH - _SHORT if new > 0 and not again else 0.0
        begin = end
    return log, in_view, closer, narrow


@jit
def _kept(seen: Ints, u: int, v: int, kind: int) -> int:
    """The slot of a cell, or of a stored neighbour; stored if new; 0 if the table is full."""
    for du, dv in _AROUND:
        at = _slot(seen, _key(u + du, v + dv, kind))
        if seen[at] != 0:
            return at
    return _put(seen, _key(u, v, kind))


@jit
def _closer(lies: Floats, at: int, off: float, wide: float) -> float:
    """Add a beam end to a slot, on a length of wall [m]. Returns the change of its log
    likelihood."""
    if at == 0:
        return 0.0
    before = _told(lies[at, 0], lies[at, 1])
    lies[at, 0] += wide * (USUAL - off)
    lies[at, 1] += wide
    return _told(lies[at, 0], lies[at, 1]) - before


@jit
def _told(sum_: float, wide: float) -> float:
    """Log likelihood of a cell, whose wall may have been covered many times."""
    return sum_ * min(1.0, 2.0 * _SIDE / wide) if wide > 0.0 else 0.0


@jit
def _first(
    seen: Ints, lies: Floats, cells: Ints, kind: int, stamp: float, stood: bool
) -> tuple[int, bool]:
    """Store the cells (n, 2) of a map error. Returns how many are new, and whether it continues an
    earlier error. stood: whether it is static; else it may be a person, and only cells in which
    something has stood for a while are stored."""
    again, new = False, 0
    for k in range(len(cells)):
        u, v = cells[k, 0], cells[k, 1]
        if _beside(seen, u, v, kind, 1):  # it covers this as well
            again = again or new == 0
            continue
        if not stood and not _stands(seen, lies, u, v, stamp):
            continue
        again = again or (new == 0 and _beside(seen, u, v, kind, 2))
        _put(seen, _key(u, v, kind))
        new += 1
    return new, again


@jit
def _stands(seen: Ints, lies: Floats, u: int, v: int, stamp: float) -> bool:
    """Whether a cell, or a neighbour, has been occupied for long enough to be static."""
    at = _kept(seen, u, v, _PERHAPS)
    if at == 0:
        return True
    if lies[at, 1] == 0.0 or stamp - lies[at, 1] > _STOOD:
        lies[at, 0] = stamp
    lies[at, 1] = stamp
    return stamp - lies[at, 0] >= _STOOD


@jit
def _straight(ends: Floats) -> float:
    """Length of a straight wall among ends (n, 2) of neighbouring beams, by splitting at the
    farthest point and keeping the longer part [m]."""
    begin, end = 0, len(ends) - 1
    while end - begin >= 2:
        dx, dy = ends[end, 0] - ends[begin, 0], ends[end, 1] - ends[begin, 1]
        long = math.hypot(dx, dy)
        if long < _BROAD:
            return long
        worst, off = begin, _LINE
        for k in range(begin + 1, end):
            ex, ey = ends[k, 0] - ends[begin, 0], ends[k, 1] - ends[begin, 1]
            e = abs(dx * ey - dy * ex) / long
            if e > off:
                worst, off = k, e
        if worst == begin:
            return long
        a = math.hypot(ends[worst, 0] - ends[begin, 0], ends[worst, 1] - ends[begin, 1])
        b = math.hypot(ends[worst, 0] - ends[end, 0], ends[worst, 1] - ends[end, 1])
        begin, end = (begin, worst - 1) if a > b else (worst + 1, end)
    return 0.0


@jit
def _cost(kind: int, new: int, again: bool) -> float:
    """Log likelihood of new cells of an error. again: it continues an earlier one."""
    wide = 2.0 * _SIDE * new
    if wide == 0.0:
        return 0.0
    if kind == BEYOND:
        return UNDRAWN * wide
    thing = _SHORT if kind == IN_FRONT else _THROUGH
    return _WIDE * wide + (0.0 if again else thing)


@jit
def _key(u: int, v: int, kind: int) -> int:
    return ((u + 32768) * 65536 + (v + 32768)) * 8 + kind + 1


@jit
def _slot(seen: Ints, key: int) -> int:
    """The slot of a key, or where it would be stored."""
    n = len(seen) - 1
    h = (key * 2654435761) % n
    while seen[1 + h] != 0 and seen[1 + h] != key:
        h = (h + 1) % n
    return 1 + h


@jit
def _beside(seen: Ints, u: int, v: int, kind: int, reach: int) -> bool:
    """Whether an entry of that kind is stored within so many cells."""
    if seen[0] == 0:
        return False
    for du in range(-reach, reach + 1):
        for dv in range(-reach, reach + 1):
            key = _key(u + du, v + dv, kind)
            if seen[_slot(seen, key)] == key:
                return True
    return False


@jit
def _put(seen: Ints, key: int) -> int:
    """Store a key. Returns its slot; 0 if the table is full."""
    at = _slot(seen, key)
    if seen[at] == 0:
        if seen[0] >= _FILLED:
            return 0
        seen[at] = key
        seen[0] += 1
    return at
