"""Counts what a map would have wrong, were the robot at a place: each piece of wall once.

A map errs by things that stand or that do not stand, and each errs for as long as it is looked at,
by however many beams. So a place is charged for a contradiction where it is first seen, by its
length and not by its beams, and never again for the same stretch of the map. What is narrower
than two things may lie apart and be one may be an edge that a pose a little beside sees past, from
some views: it counts in the mean over those of the last metre. What may be a person is charged
while he is in view, and for good once it has stood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

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
    eye,
    read,
)
from cohelm.robot.sensors import Lidar

_SIDE = 0.25  # of the cells in which what the map has wrong is kept: one, and all beside it [m]
_SLOTS = 2048  # of them, in a table of hashes; a place that needs more has been refuted long ago
_FILLED = 1800  # so that looking for a free one ends soon
_CLOSE = 0.08  # an end as near to a wall agrees, what the map rounds and the LiDAR scatters [m],
_TURNED = 0.01  # and a pose's error in heading, seen from afar [rad]
_BROAD = 1.0  # longer than this and straight it is a wall, no person and no cupboard [m],
_LINE = 0.1  # within so much of a line, a poor LiDAR's scatter twice [m]
_SHORT = -1.5  # log likelihoods: of a thing on no map,
_THROUGH = -3.0  # of a wall that is not there, or that is on no map,
_WIDE = -1.0  # and of each metre, for maps err alike along so much (`MatchParams.correlated`)
_RIGHT = -2.0  # of a map that is wrong here at all, for most of what is in view is right;
_AGAIN = 0.7  # where it is wrong once, it is likelier wrong again
_AROUND = ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_VIEWS = 7  # of a metre, along which maps err alike: views are 15 cm apart (`past_views.NEAR`)
_STOOD = 2.3  # who walks, at 0.5 m/s, has left a cell and those beside it, 0.4 m wide himself [s]
_WALL, _PERHAPS = 5, 6  # beside the kinds of `read`: what is in front and is a wall, or may walk


def _nothing() -> Ints:
    """Nothing seen yet: slot 0 counts the others, each a cell and a kind."""
    return np.zeros(_SLOTS + 1, dtype=np.int64)


def _nowhere() -> Floats:
    return np.zeros((_SLOTS + 1, 2))


@dataclass
class Charges:
    """What all views so far say to a place."""

    cells: Ints = field(default_factory=_nothing)
    """What was seen of the map, and what it would have wrong,"""
    off: Floats = field(default_factory=_nowhere)
    """of each by how much ends of beams lie closer to it than is usual, summed over so much wall,
    and how much [m]; of what may walk, since when it is there, and when it last was [s]."""
    errors: float = 0.0
    """How likely what is wrong is, as log likelihood,"""
    doubt: float = 0.0
    """of what is in the newest view and may walk away,"""
    closer: float = 0.0
    """and by how much ends of beams lie closer to what is drawn than is usual, over all of it."""
    edges: float = 0.0
    """Log likelihood of what is narrow and wrong, in the mean over the views of the last metre."""
    views: int = 0

    def take(self, told: tuple[float, float, float, float]) -> None:
        """What one more view tells (`charged`)."""
        self.errors += told[0]
        self.doubt = told[1]
        self.closer += told[2]
        self.views += 1
        self.edges += (told[3] - self.edges) / min(self.views, _VIEWS)

    @property
    def log(self) -> float:
        """Log likelihood of all of it. How a wall is drawn tells once, however long one looks at
        it: two rooms alike are not told apart by it."""
        return _wrong(self.errors + self.doubt) + self.closer + self.edges

    @property
    def most(self) -> float:
        """And what it may come to, where all that may walk walks away."""
        return _wrong(self.errors) + self.closer + self.edges


def _wrong(errors: float) -> float:
    """Log likelihood of a map that has so much wrong, each error on its own."""
    return _RIGHT * (1.0 - math.exp(errors)) + _AGAIN * errors


@jit
def charged(
    known: LocalizationMap, lidar: Lidar, pose: Pose, ranges: Floats, every: int, offset: float,
    spread: float, seen: Ints, lies: Floats, stamp: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Log likelihoods of what every `every`-th beam of a scan from a body pose shows for the first
    time to be wrong on the map, and of what does so but may walk; and by how much it changes that
    of how closely the others end at what is drawn; and log likelihood of all that is too narrow to
    be charged. Each metre of wall counts once, with the mean of all that ended there; one that
    nobody has drawn counts as those that are do.

    seen, lies: of the place (`Charges.cells`, `off`), to which it is added. stamp: of the scan [s].
    """
    x, y, c, s = eye(lidar, pose)
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
    log, doubt, narrow, begin = 0.0, 0.0, 0.0, 0
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
                doubt += _SHORT + _WIDE * beams * lidar.step * nearest
            if kind == BEYOND and lain > 0.0:
                closer += 2.0 * _SIDE * new * near / lain
            if wall:
                new, again = _first(seen, lies, cells[begin:end], _WALL, stamp, True)
                log += _THROUGH - _SHORT if new > 0 and not again else 0.0
        begin = end
    return log, doubt, closer, narrow


@jit
def _kept(seen: Ints, u: int, v: int, kind: int) -> int:
    """The slot of a cell, or of one beside it that covers it, from now on; 0 if none is free."""
    for du, dv in _AROUND:
        at = _slot(seen, _key(u + du, v + dv, kind))
        if seen[at] != 0:
            return at
    return _put(seen, _key(u, v, kind))


@jit
def _closer(lies: Floats, at: int, off: float, wide: float) -> float:
    """One more end of a beam in a slot, on so much of the wall [m]: by how much that changes what
    the slot tells."""
    if at == 0:
        return 0.0
    before = _told(lies[at, 0], lies[at, 1])
    lies[at, 0] += wide * (USUAL - off)
    lies[at, 1] += wide
    return _told(lies[at, 0], lies[at, 1]) - before


@jit
def _told(sum_: float, wide: float) -> float:
    """Of a cell on which beams have covered so much wall, many times perhaps."""
    return sum_ * min(1.0, 2.0 * _SIDE / wide) if wide > 0.0 else 0.0


@jit
def _first(
    seen: Ints, lies: Floats, cells: Ints, kind: int, stamp: float, stood: bool
) -> tuple[int, bool]:
    """Keep the cells (n, 2) of a thing that the map has wrong: how many of them are new, and
    whether it is more of a thing from before. stood: whether it surely stands; else it may be
    who walks, and only those cells are kept in which something has stood for a while."""
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
    """Whether something has been in a cell, or beside it, for long enough to stand there."""
    at = _kept(seen, u, v, _PERHAPS)
    if at == 0:
        return True
    if lies[at, 1] == 0.0 or stamp - lies[at, 1] > _STOOD:
        lies[at, 0] = stamp
    lies[at, 1] = stamp
    return stamp - lies[at, 0] >= _STOOD


@jit
def _straight(ends: Floats) -> float:
    """Length of a wall among ends (n, 2) of neighbouring beams: the longer part each time, where
    they do not lie on a line, is looked at on its own [m]."""
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
    """Of so many cells that are seen for the first time. again: more of a thing from before."""
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
    """Where a key is, or would be."""
    n = len(seen) - 1
    h = (key * 2654435761) % n
    while seen[1 + h] != 0 and seen[1 + h] != key:
        h = (h + 1) % n
    return 1 + h


@jit
def _beside(seen: Ints, u: int, v: int, kind: int, reach: int) -> bool:
    """Whether one of that kind is kept within so many cells."""
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
    """Where a key is kept from now on; 0 if no slot is free."""
    at = _slot(seen, key)
    if seen[at] == 0:
        if seen[0] >= _FILLED:
            return 0
        seen[at] = key
        seen[0] += 1
    return at
