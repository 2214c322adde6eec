"""Clock offset and age of messages, against a path with known delays."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings, strategies as st

from cohelm.link.clock import DRIFT, Path
from cohelm.link.wire import Header

delays = st.lists(st.tuples(st.floats(0.0, 0.5), st.floats(0.0, 0.5)), min_size=1, max_size=60)


def exchange(path: Path, offset: float, there: float, back: float, at: float, number: int) -> float:
    """A message from here at `at`, its echo 20 ms after it has come; returns when that comes."""
    arrived = at + there
    sent = arrived + 0.02
    path.update(Header(1, number, sent + offset, at, 0.02), sent + back)
    return sent + back


@given(ways=delays, offset=st.floats(-1e6, 1e6))
@settings(max_examples=200)
def test_the_error_of_an_age_is_at_most_half_the_shortest_round_trip(ways, offset):
    path, now = Path(), 100.0
    shortest = math.inf
    for number, (there, back) in enumerate(ways):
        now = exchange(path, offset, there, back, now, number + 1)
        shortest = min(shortest, there + back)
    error = path.age(now - 0.1 + offset, now) - 0.1
    assert abs(error) <= 0.5 * shortest + DRIFT * (now - 100.0) + 1e-6


@given(ways=delays, offset=st.floats(-1e6, 1e6))
@settings(max_examples=200)
def test_no_age_of_a_command_is_underestimated(ways, offset):
    """However unequal the ways; and for older by the shortest way back at most."""
    path, now = Path(), 100.0
    back_shortest = math.inf
    for number, (there, back) in enumerate(ways):
        now = exchange(path, offset, there, back, now, number + 1)
        # `exchange` names the way from the robot `there`, and the way of a command `back`
        back_shortest = min(back_shortest, there)
        drifted = DRIFT * (now - 100.0)
        oldest = path.max_age(now - back + offset, now)  # of the command that has just come
        assert back - 1e-9 <= oldest <= back + back_shortest + drifted + 1e-3


@pytest.mark.parametrize("slow", [0.1, 0.25, 0.5])
def test_the_age_of_a_command_is_right_where_only_the_uplink_is_slow(slow):
    path, now = Path(), 100.0
    for number in range(20):
        now = exchange(path, 50.0, 0.0, slow, now, number + 1)
    assert path.age(now - slow + 50.0, now) == pytest.approx(0.5 * slow, abs=0.01)  # the middle
    assert path.max_age(now - slow + 50.0, now) == pytest.approx(slow, abs=0.01)


@pytest.mark.parametrize("jump", [-3600.0, -1.0, 0.5, 3600.0])
def test_after_a_clock_has_jumped_the_age_is_bounded_again_from_the_next_echo_on(jump):
    path, now = Path(), 100.0
    for number in range(20):
        now = exchange(path, 50.0, 0.02, 0.02, now, number + 1)
    now = exchange(path, 50.0 + jump, 0.02, 0.02, now, 30)
    assert path.max_age(now + 50.0 + jump, now) == pytest.approx(0.02, abs=0.01)


@pytest.mark.parametrize("asleep", [2.0, 3600.0])
def test_a_stamp_from_before_a_clock_jumped_is_of_no_known_age(asleep):
    """A laptop sleeps, its clock stands still, and what was requested before looks new."""
    path, now = Path(), 100.0
    for number in range(20):
        now = exchange(path, 50.0, 0.02, 0.02, now, number + 1)
    made = now + 50.0
    woken = exchange(path, 50.0 - asleep, 0.02, 0.02, now + asleep, 30)
    assert path.max_age(made, woken) > asleep
    assert path.max_age(woken - 0.02 + 50.0 - asleep, woken) < 0.05  # of a new one


def test_a_clock_jump_within_the_round_trip_never_makes_a_command_younger():
    path, now = Path(), 100.0
    for number in range(20):
        now = exchange(path, 50.0, 0.1, 0.1, now, number + 1)
    for number in range(20, 40):  # 90 ms back: within half of the round trip
        now = exchange(path, 49.91, 0.1, 0.1, now, number + 1)
        assert path.max_age(now - 0.1 + 49.91, now) >= 0.1 - 1e-9


def test_without_an_echo_the_offset_is_unknown():
    path = Path()
    assert path.update(Header(1, 1, 5.0, math.nan, math.nan), 100.0)
    assert math.isnan(path.offset)
    assert math.isnan(path.round_trip)
    assert math.isnan(path.age(5.0, 101.0))
    assert math.isnan(path.max_age(5.0, 101.0))


def test_older_and_repeated_messages_are_not_new():
    path = Path()
    assert path.update(Header(1, 5, 1.0, math.nan, math.nan), 1.0)
    for number in (5, 4, 1):
        assert not path.update(Header(1, number, 2.0, math.nan, math.nan), 1.1)
    assert path.update(Header(1, 6, 1.1, math.nan, math.nan), 1.2)


@given(late=st.floats(0.3, 30.0))
def test_a_burst_after_an_interruption_keeps_its_age(late):
    """Commands held up by the network for `late` seconds are as old as they are."""
    path, now = Path(), 100.0
    for number in range(20):
        now = exchange(path, 50.0, 0.02, 0.02, now, number + 1)
    for held in range(20):  # sent before the black-out, with the echoes of then
        sent = now + 0.02 * held
        path.update(Header(1, 30 + held, sent + 50.0, now - 0.05, 0.01), sent + late)
        assert path.age(sent + 50.0, sent + late) == pytest.approx(late, abs=0.03)


@pytest.mark.parametrize("jump", [-3600.0, -1.0, 0.5, 3600.0])
def test_a_clock_jump_is_detected_at_once(jump):
    path, now = Path(), 100.0
    for number in range(20):
        now = exchange(path, 50.0, 0.02, 0.02, now, number + 1)
    now = exchange(path, 50.0 + jump, 0.02, 0.02, now, 30)
    assert path.age(now + 50.0 + jump, now) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("echo", [math.inf, -math.inf, 1e300, -1e300, 200.0, math.nan])
@pytest.mark.parametrize("hold", [math.nan, -1.0, 1e30, 0.0])
def test_impossible_echoes_are_ignored(echo, hold):
    path = Path()
    exchange(path, 50.0, 0.02, 0.02, 100.0, 1)
    before = path.offset
    path.update(Header(1, 2, 150.2, echo, hold), 100.2)
    assert path.offset == before


def test_the_share_of_lost_datagrams_is_measured():
    path, now = Path(), 100.0
    for number in range(100):
        now += 0.02
        if number % 4:
            path.update(Header(1, number, now, math.nan, math.nan), now)
    assert path.lost == pytest.approx(0.25, abs=0.02)


def test_another_session_restarts_the_estimate():
    path = Path()
    exchange(path, 50.0, 0.02, 0.02, 100.0, 1000)
    assert path.update(Header(2, 1, 0.0, math.nan, math.nan), 101.0)
    assert math.isnan(path.offset)
