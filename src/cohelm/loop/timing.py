"""Statistics of the loop's timing: lateness, work and overruns, without allocation."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

_BIN = 2e-5  # of the histograms [s]
_BINS = 5000  # up to 0.1 s; what is later is counted in the last one


class Punctuality(NamedTuple):
    """Timing statistics. All times in seconds."""

    periods: int
    """Due so far."""
    overruns: int
    """Periods whose work was not done when the next one was due."""
    within_2ms: float
    """Share of the periods due that began within 2 ms of their due time."""
    late_median: float
    late_99: float
    late_999: float
    late_worst: float
    took_median: float
    took_99: float
    took_worst: float


class Timing:
    """Histograms of the periods' lateness and work."""

    def __init__(self) -> None:
        self._late = np.zeros(_BINS, dtype=np.int64)
        self._took = np.zeros(_BINS, dtype=np.int64)
        self._worst_late = self._worst_took = 0.0
        self.overruns = 0
        self._recent = self._recent_before = 0.0
        self._since = -math.inf

    def add(self, now: float, late: float, took: float, overrun: bool) -> None:
        """One period that began `late` and took `took` [s]."""
        self._late[min(max(int(late / _BIN), 0), _BINS - 1)] += 1
        self._took[min(max(int(took / _BIN), 0), _BINS - 1)] += 1
        self._worst_late = max(self._worst_late, late)
        self._worst_took = max(self._worst_took, took)
        self.overruns += overrun
        if now - self._since > 1.0:
            self._recent_before, self._recent, self._since = self._recent, 0.0, now
        self._recent = max(self._recent, late)

    def missed(self, late: float) -> None:
        """A period that was skipped, because the one before overran it."""
        self._late[min(int(late / _BIN), _BINS - 1)] += 1
        self._worst_late = max(self._worst_late, late)
        self._recent = max(self._recent, late)

    @property
    def recent(self) -> float:
        """The worst lateness of the last one to two seconds."""
        return max(self._recent, self._recent_before)

    def punctuality(self) -> Punctuality:
        """All so far; NaN where there was no period."""
        n = int(self._late.sum())
        near = float(self._late[: round(2e-3 / _BIN)].sum()) / n if n else math.nan
        return Punctuality(
            n, self.overruns, near,
            _quantile(self._late, 0.5), _quantile(self._late, 0.99), _quantile(self._late, 0.999),
            self._worst_late, _quantile(self._took, 0.5), _quantile(self._took, 0.99),
            self._worst_took,
        )  # fmt: skip


def _quantile(counts: np.ndarray[tuple[int], np.dtype[np.int64]], share: float) -> float:
    total = int(counts.sum())
    if total == 0:
        return math.nan
    place = int(np.searchsorted(np.cumsum(counts), share * total))
    return (place + 1) * _BIN
