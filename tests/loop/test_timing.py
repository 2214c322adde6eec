"""Statistics of the loop's timing."""

import math
from types import SimpleNamespace

import pytest

from cohelm.loop.loop import Loop, LoopParams
from cohelm.loop.timing import Timing


def test_without_periods_the_statistics_are_unknown():
    kept = Timing().punctuality()
    assert kept.periods == 0
    assert math.isnan(kept.within_2ms)
    assert math.isnan(kept.late_median)


def test_shares_and_worst_values_are_those_of_the_periods():
    timing = Timing()
    for k in range(1000):
        timing.add(0.02 * k, 0.0005 if k % 100 else 0.005, 0.001, k == 500)
    kept = timing.punctuality()
    assert (kept.periods, kept.overruns) == (1000, 1)
    assert kept.within_2ms == pytest.approx(0.99)
    assert kept.late_median == pytest.approx(0.0005, abs=3e-5)
    assert kept.late_999 == pytest.approx(0.005, abs=3e-5)
    assert kept.late_worst == 0.005
    assert kept.took_worst == 0.001


def test_periods_that_are_far_too_late_are_counted_and_named():
    timing = Timing()
    timing.add(0.0, 1.5, 2.5, True)
    kept = timing.punctuality()
    assert (kept.within_2ms, kept.late_worst, kept.took_worst) == (0.0, 1.5, 2.5)


def test_the_recent_worst_is_forgotten_after_two_seconds():
    timing = Timing()
    timing.add(0.0, 0.009, 0.0, False)
    for k in range(1, 60):
        timing.add(0.02 * k, 0.001, 0.0, False)
    assert timing.recent == 0.009
    for k in range(60, 200):
        timing.add(0.02 * k, 0.001, 0.0, False)
    assert timing.recent == 0.001


def test_skipped_periods_count_as_late():
    timing = Timing()
    timing.add(0.0, 0.0, 0.05, True)
    timing.missed(0.03)
    timing.missed(0.01)
    kept = timing.punctuality()
    assert (kept.periods, kept.overruns, kept.late_worst) == (3, 1, 0.03)
    assert kept.within_2ms == pytest.approx(1 / 3)
    assert timing.recent == 0.03


@pytest.mark.parametrize(
    ("end", "due", "periods"),
    [
        (100.005, 100.02, 1),  # as usual
        (100.05, 100.06, 3),  # two are missed
        (105.01, 105.02, 251),
        (1e7 + 0.01, 1e7 + 0.01, 1),  # the clock jumps to another day
        (3.0, 3.0, 1),  # or back
    ],
)
def test_the_next_period_is_due_soon_also_after_the_clock_has_jumped(end, due, periods):
    loop = SimpleNamespace(
        gated=SimpleNamespace(now=lambda: end), params=LoopParams(), timing=Timing(),
        _due=100.0, _late=0.0, _took=0.0, _garbage=None,
    )  # fmt: skip
    Loop._keep_time(loop, 100.0)  # type: ignore[arg-type]
    assert loop._due == pytest.approx(due)
    assert loop.timing.punctuality().periods == periods
