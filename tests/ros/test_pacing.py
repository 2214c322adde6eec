"""Periods begin with the controller's commands, whatever their phase, and are never too long."""

from __future__ import annotations

from itertools import accumulate, pairwise

import pytest
from hypothesis import given, strategies as st

from cohelm.pilot.delay_compensation import periods
from cohelm.ros.pacing import LEAST, MOST, Pacing, period


def driven(arrivals: list[float], length: float) -> tuple[list[float], list[float]]:
    """When periods began, and how long each command waited for its period [s]."""
    pacing, now, left = Pacing(length, 0.0), 0.0, sorted(arrivals)
    begun, waits = [0.0], []
    while left:
        now = min(max(left[0], pacing.earliest()), pacing.latest())
        pacing.begin(now)
        begun.append(now)
        while left and left[0] <= now:
            waits.append(now - left.pop(0))
    return begun, waits


def every(command: float, phase: float, seconds: float) -> list[float]:
    return [phase + command * k for k in range(int(seconds / command))]


@pytest.mark.parametrize("command", [0.01, 0.02, 0.021, 0.024, 0.033, 0.05, 0.1, 0.7])
@pytest.mark.parametrize("phase", [0.0, 0.003, 0.009, 0.015, 0.023])
def test_commands_never_wait_however_seldom_they_come(command, phase):
    _, waits = driven(every(command, phase, 5.0), period(command))
    assert max(waits) < 1e-9


def test_one_that_comes_just_after_a_period_began_without_it_waits_no_period():
    late = every(0.02, 0.0, 4.0)
    late[50::50] = [t + 0.004 for t in late[50::50]]
    _, waits = driven(late, period(0.02))
    assert max(waits) < 1e-9


def test_after_many_late_ones_in_a_row_each_waits_a_period_at_most():
    late = [t + (0.004 if k % 2 else 0.0) for k, t in enumerate(every(0.02, 0.0, 4.0))]
    length = period(0.02)
    _, waits = driven(late, length)
    assert max(waits) < length


@pytest.mark.parametrize("command", [0.004, 0.01, 0.017, 0.02, 0.05, 0.1, 0.7])
def test_no_period_is_longer_than_the_filter_counts_with(command):
    assert LEAST <= period(float("nan")) <= MOST
    length = period(command)
    assert LEAST <= length <= MOST
    begun, _ = driven(every(command, 0.007, 3.0), length)
    assert max(b - a for a, b in pairwise(begun)) <= length + 1e-9


@given(st.lists(st.floats(0.0, 0.06), min_size=1, max_size=80), st.floats(LEAST, MOST))
def test_no_more_commands_are_under_way_than_the_filter_counts_with(apart, length):
    """Whenever they come: it foretells half a period beyond the delay, and remembers twice as many
    commands as whole periods are in that, and two more."""
    begun, _ = driven(list(accumulate(apart)), length)
    for delay in (0.0, 0.05, 0.13):
        whole, _ = periods(delay + 0.5 * length, length)
        for now in begun:
            assert sum(now - delay < t < now for t in begun) <= 2 * whole + 2
    assert max(b - a for a, b in pairwise(begun)) <= length + 1e-9


def test_the_next_command_is_expected_after_the_last_one_not_after_a_period_without_one():
    pacing = Pacing(0.03, 0.0, 0.05)
    pacing.begin(1.0, True)
    assert pacing.expected() == pytest.approx(1.024)
    pacing.begin(1.03)
    assert pacing.expected() == pytest.approx(1.05)
    pacing.begin(1.06)
    assert pacing.expected() == pytest.approx(1.084)
    assert Pacing(0.02, 1.0).expected() == pytest.approx(1.016)
