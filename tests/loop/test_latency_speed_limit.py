"""Latency limits the speed."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, strategies as st

from cohelm.loop.speed_caps import CRAWL, UNCAPPED_DELAY, speed_cap


@given(st.floats(UNCAPPED_DELAY + 0.001, 5.0), st.floats(0.0, 20.0), st.floats(0.1, 5.0))
def test_the_speed_caps_leaves_room_to_stop(delay, clearance, deceleration):
    cap = speed_cap(delay, clearance, deceleration, math.inf)
    way = cap.speed * delay + cap.speed**2 / (2.0 * deceleration)
    assert way == pytest.approx(clearance) or cap.speed == CRAWL
    assert "latency" in cap.reason


@pytest.mark.parametrize(("delay", "clearance"), [(0.1, 0.2), (math.nan, 0.2), (1.0, math.inf)])
def test_without_delay_or_obstacles_the_speed_is_not_limited(delay, clearance):
    assert speed_cap(delay, clearance, 1.0, 1.0) == (math.inf, "")


def test_more_delay_never_raises_the_limit_and_a_limit_above_the_robots_speed_is_none():
    caps = [speed_cap(0.2 + 0.1 * n, 1.0, 1.0, math.inf).speed for n in range(10)]
    assert caps == sorted(caps, reverse=True)
    assert speed_cap(0.2, 50.0, 1.0, 1.0).speed == math.inf
    assert speed_cap(math.inf, 1.0, 1.0, 1.0).speed == CRAWL
