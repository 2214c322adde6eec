"""Periods begin with the controller's commands, whatever their phase, and are never too long."""

from __future__ import annotations

import pytest

from cohelm.ros.pacing import LEAST, LONGEST, MOST, Pacing, period


def driven(command: float, phase: float, seconds: float) -> tuple[list[float], list[float]]:
    """Lengths of all periods, and how long each command waited for its period [s]."""
    pacing, now, arrival = Pacing(period(command), 0.0), 0.0, phase
    lengths, waits = [], []
    while now < seconds:
        began = now
        now = min(max(arrival, pacing.earliest()), pacing.latest())
        pacing.begin(now)
        lengths.append(now - began)
        while arrival <= now:
            waits.append(now - arrival)
            arrival += command
    return lengths, waits


@pytest.mark.parametrize("command", [0.01, 0.02, 0.021, 0.024])
@pytest.mark.parametrize("phase", [0.0, 0.003, 0.009, 0.015])
def test_commands_that_come_once_a_period_soon_wait_no_longer(command, phase):
    _, waits = driven(command, phase, 2.0)
    assert max(waits[len(waits) // 2 :]) < 1e-9


@pytest.mark.parametrize("command", [0.004, 0.01, 0.017, 0.02, 0.05, 0.1, 0.7])
def test_no_period_is_longer_than_the_filter_counts_with_nor_much_shorter(command):
    assert LEAST <= period(float("nan")) <= MOST
    length = period(command)
    assert LEAST <= length <= MOST
    lengths, _ = driven(command, 0.007, 3.0)
    assert max(lengths) <= length + 1e-9
    assert min(lengths) >= length / LONGEST - 1e-9
