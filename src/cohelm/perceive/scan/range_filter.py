"""Median filter of ranges, for the outliers of a noisy LiDAR."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats

_SIGMAS = 4.5  # a range farther from the median than so many is another object
_EDGE = 10.0  # a beam so many sigmas longer than its neighbour passes its surface


@jit
def filtered_ranges(ranges: Floats, noise: float) -> Floats:
    """Each range replaced by the median of it and two beams on either side [m].

    A range that differs from that by more than the noise is kept: a thin leg in front of a wall.
    So is one whose neighbour passes its surface, if the median is farther away: the end of a wall
    seen along its length would recede by a hand's breadth. On a wall or disc the median halves the
    scatter, and removes single outliers, which would stop the averaging over a surface. Only beams
    with a return count; with fewer than three of them the range is kept too. noise: of a range, one
    sigma [m].
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
            continue  # an even number has no median beam
        middle = np.sort(five[:k])[k // 2]
        if abs(ranges[i] - middle) <= _SIGMAS * noise and not (
            middle > ranges[i] and _ends(ranges, i, _EDGE * noise)
        ):
            out[i] = middle
    return out


@jit
def _ends(ranges: Floats, i: int, jump: float) -> bool:
    """Whether a surface ends beside a beam: a neighbour is much longer."""
    n = len(ranges)
    before = i > 0 and ranges[i - 1] > ranges[i] + jump
    return before or (i + 1 < n and ranges[i + 1] > ranges[i] + jump)
