"""Let go of in a tight spot it gets away, and back on its path; `benchmarks/release.py` counts."""

import math

import pytest

from benchmarks.release import released
from tests.few import first


@pytest.mark.parametrize("number", first(range(40), 2))
def test_a_robot_released_in_a_tight_spot_returns_to_its_path(number):
    returns(50, number)


@pytest.mark.parametrize(("seed", "number"), [
    (8578, 96), (8578, 528), (8578, 541),
    (8597, 65),  # beside a wall with 23 mm: to and fro along it
    (8597, 822),  # between a wall and a disc: the path led back to where it came from
    (8598, 357),  # between two discs: the path undid each move of the sequence
    (8597, 873),  # in the open: each path ended where the robot does not fit across the route
])  # fmt: skip
def test_a_robot_that_once_stayed_for_ever_returns(seed, number):
    """In the first three a new path with every plan, and its running clock, hid that the robot
    stood; a refused move was tried again and again; two moves alternated."""
    returns(seed, number)


def returns(seed, number):
    one = released(seed, number)
    assert one.clearance < 0.04
    assert math.isfinite(one.away)
    assert math.isfinite(one.back)
    assert one.arrived
    assert not one.touched
