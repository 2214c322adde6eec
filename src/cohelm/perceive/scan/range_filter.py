"""Filters stray ranges that a noisy LiDAR has among many."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats

_SIGMAS = 4.5  # what is farther from its neighbours than so many is a thing of its own
_EDGE = 10.0  # and what sees so much farther than the beam beside it sees past its surface


@jit
def filtered_ranges(ranges: Floats, noise: float) -> Floats:
    """Each range replaced by the median of it and two beams on either side [m].

    A range that differs from that by more than noise explains stays: a thin leg in front of a
    wall. So does one beside which another sees past its surface, where the median is farther away:
    the end of a wall seen along its length would go back by a hand's breadth. Of a wall or disc
    the median's scatter is half as wide, and single strays, which would stop the averaging over a
    surface at every few beams, are gone. Only beams that returned are asked; with fewer than three
    of them the range stays too. noise: of a range, one sigma [m].
    """
    n = len(ranges)
    out = ranges.copy()
    if not noise > 0.0:
        return out
    five = np.empty(5)
    for i in range(n):
        if not -math.inf < ranges[i] < math.inf:
            continue
        k = 0
        for j in range(max(i - 2, 0), min(i + 3, n)):
            r = ranges[j]
            if -math.inf < r < math.inf:
                five[k] = r
                k += 1
        if k < 3 or k % 2 == 0:
            continue  # an even number has no middle one
        middle = np.sort(five[:k])[k // 2]
        if abs(ranges[i] - middle) <= _SIGMAS * noise and not (
            middle > ranges[i] and _ends(ranges, i, _EDGE * noise)
        ):
            out[i] = middle
    return out


@jit
def _ends(ranges: Floats, i: int, jump: float) -> bool:
    """Whether a surface ends beside a beam: the next one on either side sees much farther."""
    n = len(ranges)
    before = i > 0 and ranges[i - 1] > ranges[i] + jump
    return before or (i + 1 < n and ranges[i + 1] > ranges[i] + jump)
