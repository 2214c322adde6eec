"""Noise is taken off ranges; things are not."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from cohelm.perceive.source.observation_source import filtered_ranges
from cohelm.perceive.space.scan_memory import smoothed

NOISE = 0.02
STEP = math.radians(270.0 / 719)


def test_strays_of_a_noisy_wall_are_gone():
    rng = np.random.default_rng(0)
    bearings = STEP * (np.arange(241) - 120)
    true = 1.0 / np.cos(bearings)
    worst = []
    for _ in range(50):
        noisy = true + NOISE * rng.normal(size=len(true))
        both = [smoothed(r, STEP, 0.02) for r in (noisy, filtered_ranges(noisy, NOISE))]
        worst.append([np.abs(r - true)[12:-12].max() for r in both])
    raw, calm = np.mean(worst, axis=0)
    assert calm < 0.045
    assert calm < 0.75 * raw


def test_a_thin_leg_before_a_wall_stays_where_it_is():
    ranges = np.full(50, 3.0)
    ranges[20] = 2.8
    assert filtered_ranges(ranges, NOISE)[20] == 2.8


def test_an_edge_is_not_rounded():
    ranges = np.array([1.0] * 10 + [2.0] * 10)
    assert filtered_ranges(ranges, NOISE).tolist() == ranges.tolist()


def test_what_did_not_return_stays_so_and_tells_nothing():
    ranges = np.array([1.0, math.inf, 1.02, -math.inf, 1.01, math.nan, 1.0])
    out = filtered_ranges(ranges, NOISE)
    assert np.array_equal(np.isfinite(out), np.isfinite(ranges))
    assert np.array_equal(out[~np.isfinite(out)], ranges[~np.isfinite(ranges)], equal_nan=True)


@pytest.mark.parametrize("noise", [0.0, math.nan])
def test_without_noise_nothing_is_changed(noise):
    ranges = np.linspace(1.0, 1.2, 30)
    assert filtered_ranges(ranges, noise).tolist() == ranges.tolist()


@given(arrays(np.float64, st.integers(0, 40), elements=st.floats(allow_nan=True)))
def test_no_range_moves_farther_than_noise_explains(ranges):
    out = filtered_ranges(ranges, NOISE)
    sane = np.isfinite(ranges) & (np.abs(ranges) < 1e6)
    assert (np.abs(out[sane] - ranges[sane]) <= 4.5 * NOISE + 1e-9).all()


def test_the_near_end_of_a_wall_seen_along_its_length_stays_near():
    """The beams beside it go past it; those behind it are 4 cm apart along the wall."""
    past, wall = [3.0] * 10, [1.0 + 0.04 * k for k in range(12)]
    for ranges in (np.array(past + wall), np.array(wall[::-1] + past)):
        assert filtered_ranges(ranges, NOISE).min() == 1.0
