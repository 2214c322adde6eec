"""Episodes that once went wrong under the guard, each of its kind; and a few of every suite."""

from pathlib import Path

import pytest

from cohelm.study.campaign import suites
from cohelm.study.campaign.worker import chunk
from tests.few import first

DATA = Path(__file__).parents[4] / "shared" / "data"


@pytest.mark.parametrize(
    ("number", "what"),
    [
        (16, "stood for ever in a turn that the guard would not let it end"),
        (18, "rested at the end of a way that ended beside the goal"),
    ],
)
def test_a_room_that_once_was_too_difficult_is_crossed(number, what):
    (row,) = chunk(suites.suite("random", 1, None), "guard", (number,))
    assert row.arrived, what
    assert (row.contacts_moving, row.limit_excess, row.fault) == (0, 0.0, "")


@pytest.mark.slow
def test_noise_does_not_turn_the_robot_back_in_front_of_a_tight_gap():
    """By its own sensors in the lab, past the cone where it turned back again and again."""
    (row,) = chunk(suites.suite("lab", 1, None, "twin"), "guard", (3,))
    assert row.arrived
    assert (row.contacts_moving, row.fault) == (0, "")
    assert row.duration_s < 100.0


@pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not there")
@pytest.mark.parametrize(("name", "numbers"), first([
    ("barn", (20,)), ("crowd", (1,)), ("barn", (0, 49)), ("crowd", (0,)), ("lab", (0,)),
    ("hands", (0,)),
], 2))  # fmt: skip
def test_the_guard_arrives_and_touches_nothing(name, numbers):
    for row in chunk(suites.suite(name, 1, DATA), "guard", numbers):
        assert row.fault == ""
        assert row.arrived
        assert (row.contacts_moving, row.limit_excess) == (0, 0.0)
        assert row.min_clearance_moving_m > 0.0075
        if name == "barn":
            assert row.score >= 0.48
