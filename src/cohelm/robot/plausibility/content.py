"""Whether a scan's numbers can come from a working LiDAR: repeats, equal beams, holes, noise."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

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
_SHIFTS = (0, 1, -1, 2, -2)
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
        self._before: deque[Floats] = deque(maxlen=_KEPT)
        """The newest last."""
        self._bad: dict[str, int] = {}

    def forget(self) -> None:
        """As if none had come."""
        self._before.clear()
        self._bad.clear()

    def look(self, scan: Scan) -> list[Finding]:
        """What is wrong with a new scan."""
        n = len(scan.ranges)
        if n != self._lidar.beams:
            return [fault(f"the scan has {n} beams instead of {self._lidar.beams}")]
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        found = [*self._repeats(ranges), *self._equal(ranges), *self._poor(ranges)]
        self._before.append(ranges)
        return found

    def _repeats(self, ranges: Floats) -> list[Finding]:
        """Bit for bit, as noise never is; whole or in part, and turned by a beam or two."""
        if not self._lidar.noise_m > 0.0:
            return []
        real = self._measured(ranges)
        of = int(real.sum())
        if of < self._run:
            return []
        if self._before:
            newest = self._before[-1]
            turned = [np.roll(newest, shift) for shift in _SHIFTS[1:]]
            same = (np.stack([*self._before, *turned, newest[::-1]]) == ranges) & real
            for row in np.flatnonzero(same.sum(axis=1) >= self._run).tolist():  # else no run
                if _longest(same[row], real) >= self._run:
                    if row == len(same) - 1:
                        return [fault("the scan repeats, mirrored")]
                    return [fault(self._said(int(same[row].sum()), of))]
        return []

    def _said(self, same: int, of: int) -> str:
        if same > _SHARE * of:
            return "the scan repeats an earlier one, noise included"
        return f"a part of the scan repeats an earlier one ({same} of {of} beams)"

    def _equal(self, ranges: Floats) -> list[Finding]:
        """All one value, as nothing in the world is that is measured with noise."""
        if not self._lidar.noise_m > 0.0:
            return []
        real = self._measured(ranges)
        same = np.zeros(len(ranges), dtype=np.bool_)
        same[1:] = (ranges[1:] == ranges[:-1]) & real[1:]
        if same.sum() >= self._run and _longest(same, real) >= self._run:
            value = float(ranges[np.flatnonzero(same)[0]])
            return [fault(f"many of the scan's beams read the same {value:.2f} m")]
        return []

    def _poor(self, ranges: Floats) -> list[Finding]:
        """Worse than the LiDAR is described; a moment's worth is passed over."""
        n = len(ranges)
        invalid = float(np.isnan(ranges).sum()) / n
        finite = np.isfinite(ranges)
        alone = ~finite[1:-1] & finite[:-2] & finite[2:]
        known = np.where(finite, ranges, math.nan)
        alone &= np.abs(known[:-2] - known[2:]) < 0.2
        seen = max(int(finite[1:-1].sum() + alone.sum()), 1)
        empty = float(alone.sum()) / seen - self._lidar.dropout
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

    def _measured(self, ranges: Floats) -> NDArray[np.bool_]:
        """Which ranges are measured, and not cut off at an end of what can be."""
        with np.errstate(invalid="ignore"):
            return (ranges > self._lidar.range_min_m) & (ranges < self._lidar.range_max_m)


def roughness(ranges: Floats) -> float:
    """The noise of a range, from how neighbours in a row differ from a straight line: the median,
    so that edges do not count [m]; 0 where too few beams return anything."""
    if len(ranges) < 3:
        return 0.0
    known = np.where(np.isfinite(ranges), ranges, math.nan)
    bend = np.abs(known[:-2] - 2.0 * known[1:-1] + known[2:])
    bend = bend[~np.isnan(bend)]
    return float(np.median(bend)) / (0.6745 * math.sqrt(6.0)) if len(bend) >= _RUN else 0.0


def _longest(same: NDArray[np.bool_], real: NDArray[np.bool_]) -> int:
    """The longest run of beams that are the same; beams that measure nothing do not end it."""
    run = same[real]
    ends = np.concatenate(([-1], np.flatnonzero(~run), [len(run)]))
    return int((ends[1:] - ends[:-1]).max()) - 1
