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
"""Earlier scans kept, none of which may be repeated."""
_RUN = 20
"""This many neighbouring beams do not repeat their ranges by chance: a LiDAR that rounds to its own
standard deviation repeats one range with probability 0.28, twenty in a row with 1e-11."""
_RUN_SHARE = 0.5
"""... nor this share of the beams of a sensor that makes each of many points: the nearest of a
column of pixels that are rounded to the millimetre is often the same."""
_REPEATED_SHARE = 0.5
"""Share of repeated beams above which the whole scan counts as repeated."""
_SHIFTS = (1, -1, 2, -2)
NEW, REPEATED, MIRRORED = range(3)
"""How a scan compares with the earlier ones."""
_STEP = 0.2  # neighbours on one surface differ by less [m]
_INVALID, _EMPTY = 0.3, 0.2
"""Largest share of beams that are NaN, or that lose what their neighbours see, beyond the LiDAR's
described dropout."""
_NOISY = 4.0
"""Allowed ratio of a scan's noise to the LiDAR's described noise: surfaces are rough, too."""
_MIN_NOISE = 0.01  # described noise counts as at least this [m]
CRAWL = 0.08
"""Largest speed of the outline where the scan can not be relied on at all [m/s]: less than the
0.1 m/s at which a contact does no harm."""
CAREFUL = 0.2
"""Largest speed where a sensor is degraded [m/s]: Sally stops from it within 2 cm."""


class Content:
    """Checks the numbers of one LiDAR's scans, in order."""

    def __init__(self, lidar: LidarModel) -> None:
        self._lidar = lidar
        made = lidar.height_band_m is not None
        self._run = max(_RUN, math.ceil(_RUN_SHARE * lidar.beams)) if made else _RUN
        self._before: Floats = np.empty((0, lidar.beams))
        """The newest last."""
        self._bad: dict[str, int] = {}

    def forget(self) -> None:
        """Reset: as if no scan had arrived."""
        self._before = self._before[:0]
        self._bad.clear()

    def look(self, scan: Scan) -> list[Finding]:
        """What is wrong with a new scan."""
        n = len(scan.ranges)
        if n != self._lidar.beams:
            return [fault(f"the scan has {n} beams instead of {self._lidar.beams}")]
        ranges = np.array(scan.ranges, dtype=np.float64)
        found = [*self._copied(ranges), *self._poor(ranges)]
        self._before = np.concatenate((self._before[len(self._before) == _KEPT :], ranges[None]))
        return found

    def _copied(self, ranges: Floats) -> list[Finding]:
        """What measurement noise rules out: bit-for-bit repeats of an earlier scan, whole, in part,
        mirrored, or turned by one or two beams; and many beams with one value."""
        lidar, found = self._lidar, list[Finding]()
        if not lidar.noise_m > 0.0:
            return found
        kind, same, of, ends = NEW, 0, 0, (lidar.range_min_m, lidar.range_max_m)
        if len(self._before):
            kind, same, of = repeated(self._before, ranges, *ends, self._run)
        if kind == MIRRORED:
            found.append(fault("the scan repeats, mirrored"))
        elif kind == REPEATED and same > _REPEATED_SHARE * of:
            found.append(fault("the scan repeats an earlier one, noise included"))
        elif kind == REPEATED:
            share = f"{same} of {of} beams"
            found.append(fault(f"a part of the scan repeats an earlier one ({share})"))
        longest, value = equal(ranges, *ends)
        if longest >= self._run:
            found.append(fault(f"many of the scan's beams read the same {value:.2f} m"))
        return found

    def _poor(self, ranges: Floats) -> list[Finding]:
        """Worse than the LiDAR is described, in three scans in a row."""
        unknown, alone, seen = losses(ranges)
        invalid = unknown / len(ranges)
        empty = alone / max(seen, 1) - self._lidar.dropout
        rough = roughness(ranges)
        sigma = max(self._lidar.noise_m, _MIN_NOISE)
        checks = (
            (invalid > _INVALID, f"{100.0 * invalid:.0f} % of the scan is not a number"),
            (empty > _EMPTY, f"{100.0 * empty:.0f} % of the scan's beams see nothing"),
            (rough > _NOISY * sigma,
             f"the scan is {rough / sigma:.0f} times as noisy as its sensor"),
        )  # fmt: skip
        found: list[Finding] = []
        for key, (wrong, text) in enumerate(checks):
            count = min(self._bad.get(str(key), 0) + 1, 3) if wrong else 0
            self._bad[str(key)] = count
            if count >= 3:
                found.append(slow(CAREFUL, text))
        return found


@jit
def repeated(
    before: Floats, ranges: Floats, least: float, most: float, run: int
) -> tuple[int, int, int]:
    """Whether a scan repeats one of those before, (k, n), the newest last, in at least `run` beams
    in a row; how many beams are equal, and how many count. Beams at or beyond the ends of the
    measuring range, `least` and `most` [m], do not count, and do not end a row.
    """
    k, n = before.shape
    of = 0
    for i in range(n):
        of += least < ranges[i] < most
    if of < run:
        return NEW, 0, of
    for row in range(k + 5):
        same = longest = length = 0
        for i in range(n):
            if not least < ranges[i] < most:
                continue
            if row < k:
                was = before[row, i]
            elif row < k + 4:
                was = before[k - 1, (i - _SHIFTS[row - k]) % n]
            else:
                was = before[k - 1, n - 1 - i]
            length = length + 1 if was == ranges[i] else 0
            same += was == ranges[i]
            longest = max(longest, length)
        if longest >= run:
            return MIRRORED if row == k + 4 else REPEATED, same, of
    return NEW, 0, of


@jit
def equal(ranges: Floats, least: float, most: float) -> tuple[int, float]:
    """Length of the longest row of equal ranges, less one, counted as above; and the first such
    range [m]."""
    longest, length, value = 0, 0, math.nan
    for i in range(len(ranges)):
        if not least < ranges[i] < most:
            continue
        same = i > 0 and ranges[i] == ranges[i - 1]
        length = length + 1 if same else 0
        longest = max(longest, length)
        if same and math.isnan(value):
            value = ranges[i]
    return longest, value


@jit
def losses(ranges: Floats) -> tuple[int, int, int]:
    """How many beams are NaN; how many lose what both their neighbours see; and how many could be
    checked for that."""
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
    """Noise of a range, from the second differences of neighbours: the median, so that edges do
    not count [m]; 0 where too few beams return anything."""
    bends = np.empty(len(ranges))
    k = 0
    for i in range(1, len(ranges) - 1):
        a, b, c = ranges[i - 1], ranges[i], ranges[i + 1]
        if math.isfinite(a) and math.isfinite(b) and math.isfinite(c):
            bends[k] = abs(a - 2.0 * b + c)
            k += 1
    return float(np.median(bends[:k])) / (0.6745 * math.sqrt(6.0)) if k >= _RUN else 0.0
