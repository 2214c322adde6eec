import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.scalars import wrap
from cohelm.core.types import RADIUS, SAFE, VX, VY, X, Y, disc, discs

half_turns = st.builds(
    lambda k, ulps: k * math.pi + ulps * math.ulp(max(abs(k), 1) * math.pi),
    st.integers(-1000, 1000), st.integers(-3, 3),
)  # fmt: skip


@given(st.one_of(st.floats(-1e6, 1e6), half_turns))
def test_wrap_gives_the_same_angle_within_half_a_turn(angle):
    inside = wrap(angle)
    assert -math.pi < inside <= math.pi
    turns = (angle - inside) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_wrap_takes_half_a_turn_as_plus_pi():
    assert wrap(math.pi) == math.pi
    assert wrap(-math.pi) == math.pi


@given(st.floats(-math.pi + 1e-15, math.pi))
def test_wrap_leaves_a_wrapped_angle_as_it_is(angle):
    """Only the last digit before −π, which is the same direction as π, may be taken for π."""
    assert wrap(angle) == angle


def test_wrap_of_no_number_is_no_number():
    assert math.isnan(wrap(math.nan))


def test_a_disc_array_has_one_row_per_disc_even_for_none():
    assert discs().shape == (0, 6)
    rows = discs(disc(1.0, 2.0, 0.1), disc(3.0, 4.0, 0.2, safe=0.5, vx=0.6, vy=0.7))
    assert rows.dtype == np.float64
    assert rows[1, [X, Y, VX, VY, RADIUS, SAFE]].tolist() == [3.0, 4.0, 0.6, 0.7, 0.2, 0.5]
    assert rows[0, SAFE] == 0.2  # Table II
