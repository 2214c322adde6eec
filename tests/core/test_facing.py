"""Cosine and sine of a heading are the C library's, but for the last digit."""

import math

import numba
import pytest
from hypothesis import example, given, strategies as st

from cohelm.core.facing import NEAR, facing, facing_near

quarters = st.integers(-300_000, 300_000).map(lambda n: n * math.pi / 2)
beside = st.tuples(quarters, st.floats(-1e-6, 1e-6)).map(sum)
angles = st.one_of(st.floats(-10.0, 10.0), st.floats(-NEAR, NEAR), quarters, beside)


@given(angles)
@example(0.0)
@example(math.pi)
@example(NEAR)
@example(-NEAR)
@example(5e-324)
def test_it_is_right_to_the_last_digit_or_the_one_before(psi):
    got = facing_near(psi)
    for ours, theirs in ((got.cos, math.cos(psi)), (got.sin, math.sin(psi))):
        assert abs(ours - theirs) <= math.ulp(theirs)
    assert facing(psi) == got


@given(angles)
def test_left_and_right_are_alike(psi):
    there, back = facing(psi), facing(-psi)
    assert (back.cos, back.sin) == (there.cos, -there.sin)


@given(st.floats(NEAR, 1e300))
def test_an_angle_too_large_for_it_goes_to_the_c_library(psi):
    assert facing(psi) == pytest.approx((math.cos(psi), math.sin(psi)), abs=1e-15)


def test_what_is_not_a_number_stays_none():
    assert all(math.isnan(part) for part in facing(math.nan))
    if not numba.config.DISABLE_JIT:  # uncompiled, Python raises where IEEE says no number
        assert all(math.isnan(part) for part in facing(math.inf))
