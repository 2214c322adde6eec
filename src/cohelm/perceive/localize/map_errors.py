"""Counts what a map would have wrong, were the robot at a place: each piece of wall once.

A map errs by things that stand or that do not stand, and each errs for as long as it is looked at,
by however many beams. So a place is charged for a contradiction where it is first seen, by its
length and not by its beams, and never again for the same stretch of the map. What is narrower
than two things may lie apart and be one is an edge that a pose a little beside sees past.
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
    INDEPENDENT,
    NEAR,
    RUN,
    SILENT,
    USUAL,
    LocalizationMap,
    eye,
    read,
)
from cohelm.robot.sensors import Lidar

_SIDE = 0.25  # of the cells in which what the map has wrong is kept: one, and all beside it [m]
_SLOTS = 1024  # of them, in a table of hashes; a place that needs more has been refuted long ago
_FILLED = 900  # so that looking for a free one ends soon
_CLOSE = 0.08  # an end as near to a wall agrees, what the map rounds and the LiDAR scatters [m],
_TURNED = 0.01  # and a pose's error in heading, seen from afar [rad]
_BROAD = 1.0  # longer than this and straight it is a wall, no person and no cupboard [m],
_LINE = 0.1  # within so much of a line, a poor LiDAR's scatter twice [m]
_SHORT = -1.5  # log likelihoods: of a thing on no map,
_THROUGH = -3.0  # of a wall that is not there, or that is on no map,
_WIDE = -1.0  # and of each metre, for maps err alike along so much (`MatchParams.correlated`)
_BEYOND = -0.7  # or where nobody has seen whether a wall stands: as likely as not
_RIGHT = -2.0  # of a map that is wrong here at all, for most of what is in view is right;
_AGAIN = 0.7  # where it is wrong once, it is likelier wrong again
_WALL = 5  # beside the kinds of `read`: what is in front and is a wall


def _nothing() -> Ints:
    """No error yet: slot 0 counts the others, each a cell and a kind."""
    return np.zeros(_SLOTS + 1, dtype=np.int64)


@dataclass
class Charges:
    """What all views so far say to a place."""

    wrong: Ints = field(default_factory=_nothing)
    """What the map would have wrong,"""
    errors: float = 0.0
    """and how likely that is, as log likelihood."""
    closer: float = 0.0
    weight: float = 0.0
    """By how much ends of beams lie closer to what is drawn than is usual, over all the way."""

    def take(self, told: tuple[float, float], share: float) -> None:
        """What one more view tells (`charged`). share: of it that is new: how closely ends lie is
        the same for some way."""
        self.errors += told[0]
        self.closer += share * told[1]
        self.weight += share

    @property
    def log(self) -> float:
        """Log likelihood of all of it. How a map is drawn somewhere tells once, however long one
        looks at it: two rooms alike are not told apart by it."""
        wrong = _RIGHT * (1.0 - math.exp(self.errors))
        return wrong + _AGAIN * self.errors + self.closer / self.weight


@jit
def charged(
    known: LocalizationMap, lidar: Lidar, pose: Pose, ranges: Floats, every: int, offset: float,
    spread: float, wrong: Ints,
) -> tuple[float, float]:  # fmt: skip
    """Log likelihoods of what every `every`-th beam of a scan from a body pose shows for the first
    time to be wrong on the map, which is put into `wrong`; and of how closely the others end at
    what is drawn, as `judge` has it."""
    x, y, c, s = eye(lidar, pose)
    kinds, cells = np.empty(len(ranges), np.int64), np.empty((len(ranges), 2), np.int64)
    fars, ends = np.empty(len(ranges)), np.empty((len(ranges), 2))
    n, told, near_log = 0, 0, 0.0
    for i in range(0, len(ranges), every):
        if not ranges[i] > 0.0:
            continue
        dx = c * lidar.beams[i, 0] - s * lidar.beams[i, 1]
        dy = s * lidar.beams[i, 0] + c * lidar.beams[i, 1]
        near = _CLOSE + _TURNED * min(ranges[i], lidar.range_max)
        kind, far, off = read(known, x, y, dx, dy, ranges[i], lidar.range_max, near, offset, spread)
        if kind == AGREE:
            near_log += USUAL - off
        told += kind in (AGREE, IN_FRONT, BEHIND)
        kinds[n], fars[n] = kind, far
        ends[n, 0], ends[n, 1] = x + ranges[i] * dx, y + ranges[i] * dy
        if kind not in (AGREE, SILENT):
            cells[n, 0] = math.floor((x + far * dx) / _SIDE)
            cells[n, 1] = math.floor((y + far * dy) / _SIDE)
        n += 1
    log, begin = 0.0, 0
    while begin < n:
        end = begin + 1
        while end < n and kinds[end] == kinds[begin]:
            end += 1
        kind = kinds[begin]
        beams = (end - begin) * every
        nearest = fars[begin:end].min()
        thing = beams >= RUN and beams * lidar.step * nearest >= NEAR + _TURNED * nearest
        if thing and kind not in (AGREE, SILENT):
            log += _cost(kind, *_first(wrong, cells[begin:end], kind))
            if kind == IN_FRONT and _straight(ends[begin:end]) > _BROAD:
                new, again = _first(wrong, cells[begin:end], _WALL)
                log += _THROUGH - _SHORT if new > 0 and not again else 0.0
        begin = end
    return log, INDEPENDENT * near_log / max(told, 1)


@jit
def _first(wrong: Ints, cells: Ints, kind: int) -> tuple[int, bool]:
    """Keep the cells (n, 2) of a thing that the map has wrong: how many of them are new, and
    whether it is more of a thing from before."""
    again, new = False, 0
    for k in range(len(cells)):
        u, v = cells[k, 0], cells[k, 1]
        if _beside(wrong, u, v, kind, 1):  # it covers this as well
            again = again or new == 0
            continue
        again = again or (new == 0 and _beside(wrong, u, v, kind, 2))
        _put(wrong, _key(u, v, kind))
        new += 1
    return new, again


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
        return _BEYOND * wide
    thing = _SHORT if kind == IN_FRONT else _THROUGH
    return _WIDE * wide + (0.0 if again else thing)


@jit
def _key(u: int, v: int, kind: int) -> int:
    return ((u + 32768) * 65536 + (v + 32768)) * 8 + kind + 1


@jit
def _slot(wrong: Ints, key: int) -> int:
    """Where a key is, or would be."""
    n = len(wrong) - 1
    h = (key * 2654435761) % n
    while wrong[1 + h] != 0 and wrong[1 + h] != key:
        h = (h + 1) % n
    return 1 + h


@jit
def _beside(wrong: Ints, u: int, v: int, kind: int, reach: int) -> bool:
    """Whether one of that kind is kept within so many cells."""
    if wrong[0] == 0:
        return False
    for du in range(-reach, reach + 1):
        for dv in range(-reach, reach + 1):
            key = _key(u + du, v + dv, kind)
            if wrong[_slot(wrong, key)] == key:
                return True
    return False


@jit
def _put(wrong: Ints, key: int) -> None:
    at = _slot(wrong, key)
    if wrong[at] == 0 and wrong[0] < _FILLED:
        wrong[at] = key
        wrong[0] += 1
