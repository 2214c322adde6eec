"""How much of a motion a room allows, held against driving it."""

import math

import pytest
from hypothesis import given, strategies as st

from cohelm.robot.collision_monitor.fields import allowed, horizon

TIMES = st.floats(0.0, 3.0)


def gone(share, reaction, braking, crawl):
    """The hold that a share of a motion comes to until it has braked to a crawl, in small steps."""
    n, way, speed = 20_000, share * reaction, share
    step = braking / n if braking > 0.0 else 0.0
    while speed > crawl and step > 0.0:
        speed -= 1.0 / n
        way += (speed + 0.5 / n) * step
    return way


@given(TIMES, st.floats(0.01, 0.5), TIMES, st.floats(0.0, 0.9))
def test_the_permitted_path_ends_where_the_clearance_does(room, reaction, braking, crawl):
    share = allowed(room, reaction, braking, crawl)
    assert share >= crawl
    if share > crawl:
        way = share * reaction + 0.5 * braking * (share**2 - crawl**2)
        assert way == pytest.approx(room, abs=1e-9)
    else:
        assert crawl * reaction >= room - 1e-9


def test_braking_from_a_motion_goes_as_far_as_half_its_time():
    assert gone(1.0, 0.1, 0.5, 0.0) == pytest.approx(0.1 + 0.25, abs=1e-4)
    assert allowed(0.35, 0.1, 0.5) == pytest.approx(1.0)
    assert horizon(0.1, 0.5) == pytest.approx(0.35)
    assert allowed(gone(0.7, 0.1, 0.5, 0.2), 0.1, 0.5, 0.2) == pytest.approx(0.7, abs=1e-4)


def test_without_room_nothing_but_a_crawl_and_without_end_everything():
    assert allowed(0.0, 0.1, 0.5) == 0.0
    assert allowed(0.0, 0.1, 0.5, 0.2) == 0.2
    assert allowed(math.inf, 0.1, 0.5) == math.inf


def test_an_operator_who_stops_at_once_stops_only_on_contact():
    assert allowed(0.2, 0.1, 0.0) == pytest.approx(2.0)
    assert allowed(0.2, 0.0, 0.0) == math.inf
    assert allowed(0.0, 0.0, 0.0) == 0.0
    assert allowed(0.0, 0.0, 0.0, 0.3) == 0.3
