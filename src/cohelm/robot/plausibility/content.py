"""Whether a scan's numbers can come from a working LiDAR: repeats, equal beams, holes, noise."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.robot.plausibility.finding import Finding, fault, slow
from cohelm.robot.port import Scan
from cohelm.robot.sensors import LidarModel

_KEPT = 12
"""Scans before, of which none may come again."""
_RUN = 20
"""So many neighbouring beams do not repeat their ranges by chance: a LiDAR that rounds to its own
standard deviation repeats one range with probability 0.28, twenty in a row with 1e-11."""
_RUN_SHARE = 0.5
"""... nor so many of all beams of a sensor whose scans are made of many points each: what is
nearest of a column of pixels that are rounded to the millimetre is often the same."""
_SHARE = 0.5
"""... and half of all beams do not either."""
_SHIFTS = (1, -1, 2, -2)
NEW, AGAIN, MIRRORED = range(3)
"""What a scan is, beside those before."""
_STEP = 0.2  # neighbours on one surface differ by less [m]
_INVALID, _EMPTY = 0.3, 0.2
"""More than this share of beams that are no number, or lose what their neighbours see, beyond what
the LiDAR is described to lose: it sees badly."""
_NOISY = 4.0
"""A scan may be so many times as noisy as the LiDAR is described: surfaces are rough, too."""
_LEAST = 0.01  # less noise than this is not asked about [m]
CRAWL = 0.08
"""No part of the outline is faster where what the scan shows can not be relied on at all [m/s]:
less than the 0.1 m/s with which a contact does no harm."""
CAREFUL = 0.2
"""The speed where a sense is worse than it should be [m/s]: Sally stands within 2 cm from there."""


class Content:
    """Looks at one scan after the other, and remembers some."""

    def __init__(self, lidar: LidarModel) -> None:
        self._lidar = lidar
        made = lidar.height_band_m is not None
        self._run = max(_RUN, math.ceil(_RUN_SHARE * lidar.beams)) if made else _RUN
        self._before: Floats = np.empty((0, lidar.beams))
        """The newest last."""
        self._bad: dict[str, int] = {}

    def forget(self) -> None:
        """As if none had come."""
        self._before = self._before[:0]
        self._bad.clear()

    def look(self, scan: Scan) -> list[Finding]:
        """What is wrong with a new scan."""
        n = len(scan.ranges)
        if n != self._lidar.beams:
            return [fault(f"the scan has {n} beams instead of {self._lidar.beams}")]
        ranges = np.array(scan.ranges, dtype=np.float64)
        found = [*self._repeats(ranges), *self._equal(ranges), *self._poor(ranges)]
        self._before = np.concatenate((self._before[len(self._before) == _KEPT :], ranges[None]))
        return found

    def _repeats(self, ranges: Floats) -> list[Finding]:
        """Bit for bit, as noise never is; whole or in part, and turned by a beam or two."""
        lidar = self._lidar
        if not lidar.noise_m > 0.0 or not len(self._before):
            return []
        again, same, of = repeated(
            self._before, ranges, lidar.range_min_m, lidar.range_max_m, self._run
        )
        if again == MIRRORED:
            return [fault("the scan repeats, mirrored")]
        return [fault(self._said(same, of))] if again != NEW else []

    def _said(self, same: int, of: int) -> str:
        if same > _SHARE * of:
            return "the scan repeats an earlier one, noise included"
        return f"a part of the scan repeats an earlier one ({same} of {of} beams)"

    def _equal(self, ranges: Floats) -> list[Finding]:
        """All one value, as nothing in the world is that is measured with noise."""
        lidar = self._lidar
        if not lidar.noise_m > 0.0:
            return []
        longest, value = equal(ranges, lidar.range_min_m, lidar.range_max_m)
        if longest >= self._run:
            return [fault(f"many of the scan's beams read the same {value:.2f} m")]
        return []

    def _poor(self, ranges: Floats) -> list[Finding]:
        """Worse than the LiDAR is described; a moment's worth is passed over."""
        unknown, alone, seen = losses(ranges)
        invalid = unknown / len(ranges)
        empty = alone / max(seen, 1) - self._lidar.dropout
        rough = roughness(ranges)
        sigma = max(self._lidar.noise_m, _LEAST)
        checks = (
            (invalid > _INVALID, f"{100.0 * invalid:.0f} % of the scan is no number"),
            (empty > _EMPTY, f"{100.0 * empty:.0f} % of the scan's beams see nothing"),
            (rough > _NOISY * sigma,
             f"the scan is {rough / sigma:.0f} times as noisy as its sensor"),
        )  # fmt: skip
        found: list[Finding] = []
        for key, (wrong, said) in enumerate(checks):
            count = min(self._bad.get(str(key), 0) + 1, 3) if wrong else 0
            self._bad[str(key)] = count
            if count >= 3:
                found.append(slow(CAREFUL, said))
        return found


@jit
def repeated(
    before: Floats, ranges: Floats, least: float, most: float, run: int
) -> tuple[int, int, int]:
    """Whether a scan is one of those before, (k, n), the newest last, or has so many beams in a row
    of one; how many are the same, and how many there are. Beams that measure nothing, as they are
    cut off at an end of what can be measured [m], are not counted, and do not end a row.
    """
    k, n = before.shape
    of = 0
    for i in range(n):
        of += least < ranges[i] < most
    if of < run:
        return NEW, 0, of
    for row in range(k + 5):
        same = longest = so_far = 0
        for i in range(n):
            if not least < ranges[i] < most:
                continue
            if row < k:
                was = before[row, i]
            elif row < k + 4:
                was = before[k - 1, (i - _SHIFTS[row - k]) % n]
            else:
                was = before[k - 1, n - 1 - i]
            so_far = so_far + 1 if was == ranges[i] else 0
            same += was == ranges[i]
            longest = max(longest, so_far)
        if longest >= run:
            return MIRRORED if row == k + 4 else AGAIN, same, of
    return NEW, 0, of


@jit
def equal(ranges: Floats, least: float, most: float) -> tuple[int, float]:
    """The longest row of beams with one and the same range, but for the first of it, counted as
    above; and the first such range [m]."""
    longest, so_far, value = 0, 0, math.nan
    for i in range(len(ranges)):
        if not least < ranges[i] < most:
            continue
        same = i > 0 and ranges[i] == ranges[i - 1]
        so_far = so_far + 1 if same else 0
        longest = max(longest, so_far)
        if same and math.isnan(value):
            value = ranges[i]
    return longest, value


@jit
def losses(ranges: Floats) -> tuple[int, int, int]:
    """How many beams are no number; how many lose what both their neighbours see; and of how many
    this could be said."""
    n = len(ranges)
    unknown = alone = seen = 0
    for i in range(n):
        unknown += math.isnan(ranges[i])
        if 0 < i < n - 1:
            if math.isfinite(ranges[i]):
                seen += 1
            elif math.isfinite(ranges[i - 1]) and math.isfinite(ranges[i + 1]):
                alone += abs(ranges[i - 1] - ranges[i + 1]) < _STEP
    return unknown, alone, seen + alone


@jit
def roughness(ranges: Floats) -> float:
    """The noise of a range, from how neighbours in a row differ from a straight line: the median,
    so that edges do not count [m]; 0 where too few beams return anything."""
    bends = np.empty(len(ranges))
    k = 0
    for i in range(1, len(ranges) - 1):
        a, b, c = ranges[i - 1], ranges[i], ranges[i + 1]
        if math.isfinite(a) and math.isfinite(b) and math.isfinite(c):
            bends[k] = abs(a - 2.0 * b + c)
            k += 1
    return float(np.median(bends[:k])) / (0.6745 * math.sqrt(6.0)) if k >= _RUN else 0.0
