"""Let go of in a tight spot it gets away, and back on its path; `benchmarks/release.py` counts."""

import math

import pytest

from benchmarks.release import released
from tests.few import first


@pytest.mark.parametrize("number", first(range(40), 2))
def test_a_robot_released_in_a_tight_spot_returns_to_its_path(number):
    returns(50, number)


@pytest.mark.parametrize("number", [96, 528, 541])
def test_a_robot_that_once_stayed_for_ever_returns(number):
    """A new path with every plan, and its running clock, hid that the robot stood; a refused move
    was tried again and again; two moves alternated."""
    returns(8578, number)


def returns(seed, number):
    one = released(seed, number)
    assert one.clearance < 0.04
    assert math.isfinite(one.away)
    assert math.isfinite(one.back)
    assert one.arrived
    assert not one.touched
