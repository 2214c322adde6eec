import math

import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.robot.achievable import achievable
from cohelm.robot.limits import Limits, checked_limits, unlimited

bounds = st.one_of(st.just(math.inf), st.floats(0.05, 20.0))
limits = st.builds(Limits, bounds, bounds, bounds, bounds, bounds, bounds, st.floats(0.1, 1.0))
any_command = st.builds(
    Twist,
    st.one_of(st.floats(-30, 30), st.floats(-1e6, 1e6)),
    st.one_of(st.floats(-30, 30), st.floats(-1e6, 1e6)),
)
periods = st.sampled_from([0.001, 0.01, 0.02, 0.05, 0.1])
FINEST = 1e-14
"""Of the speeds: how near to an acceleration bound a command may come and still count as inside."""


def wheels(twist, track):
    """Both wheels' rims, left and right."""
    return twist.v - twist.omega * track / 2, twist.v + twist.omega * track / 2


def rim(v, omega, track):
    return max(abs(v - omega * track / 2), abs(v + omega * track / 2))


@st.composite
def moving(draw):
    """Limits, a twist inside them, a command, a period."""
    lim = draw(limits)
    dt = draw(periods)
    before = Twist(0.0, 0.0)
    for _ in range(draw(st.integers(0, 3))):
        before = achievable(draw(any_command), before, lim, dt)
    return lim, before, draw(any_command), dt


@given(moving())
def test_the_wheels_never_turn_faster_than_they_can_not_by_one_digit(case):
    lim, before, command, dt = case
    got = achievable(command, before, lim, dt)
    assert abs(got.v) <= lim.speed
    assert abs(got.omega) <= lim.yaw_rate
    assert max(map(abs, wheels(got, lim.track))) <= lim.wheel_speed
    assert abs(got.v) + 0.5 * lim.track * abs(got.omega) <= lim.wheel_speed


def still_the_same(after, before):
    """Where the speeds' digits are coarser than what may change, nothing does."""
    return after == pytest.approx(before, rel=FINEST, abs=0.0)


@given(moving())
def test_the_speed_never_jumps_by_more_than_the_acceleration_not_by_one_digit(case):
    lim, before, command, dt = case
    got = achievable(command, before, lim, dt)
    if still_the_same(got, before):
        return
    assert abs(got.v - before.v) <= lim.acceleration * dt
    assert abs(got.omega - before.omega) <= lim.yaw_acceleration * dt
    most = lim.wheel_acceleration * dt
    for now, was in zip(wheels(got, lim.track), wheels(before, lim.track), strict=True):
        assert abs(now - was) <= most
    assert rim(got.v - before.v, got.omega - before.omega, lim.track) <= most


@given(moving())
def test_a_replayed_episode_is_equal_to_the_last_bit(case):
    """The guard limits its command, and the robot limits it once more."""
    lim, before, command, dt = case
    reached = achievable(command, before, lim, dt)
    assert achievable(reached, before, lim, dt) == reached


@st.composite
def near_by(draw):
    """The same, the command about as near as the limits let it be."""
    lim, before, _, dt = draw(moving())
    share = st.floats(-1.0, 1.0)
    dv = draw(share) * min(lim.acceleration, lim.wheel_acceleration, 300.0) * dt
    domega = draw(share) * min(lim.yaw_acceleration, 300.0) * dt
    rims = abs(dv) + lim.track / 2 * abs(domega)
    most = lim.wheel_acceleration * dt
    part = min(1.0, 0.999 * most / rims) if rims > 0.0 else 1.0
    return lim, before, Twist(before.v + part * dv, before.omega + part * domega), dt


@given(near_by())
def test_a_command_within_the_limits_is_reached_to_the_last_bit(case):
    lim, before, command, dt = case
    assume(abs(command.v) <= lim.speed)
    assume(abs(command.omega) <= lim.yaw_rate)
    assume(abs(command.v) + lim.track / 2 * abs(command.omega) <= lim.wheel_speed)
    dv, domega = command.v - before.v, command.omega - before.omega
    assume(abs(dv) <= lim.acceleration * dt)
    assume(abs(domega) <= lim.yaw_acceleration * dt)
    size = abs(command.v) + abs(before.v) + lim.track * (abs(command.omega) + abs(before.omega))
    rims = abs(dv) + lim.track / 2 * abs(domega)
    assume(rims <= lim.wheel_acceleration * dt - FINEST * size)
    assert achievable(command, before, lim, dt) == command


@given(any_command, any_command, st.floats(0.1, 1.0), periods)
def test_the_ideal_robot_of_the_paper_does_what_is_commanded(command, before, track, dt):
    assert achievable(command, before, unlimited(track), dt) == command


@given(any_command, limits, periods)
def test_too_fast_a_command_keeps_its_curvature(command, lim, dt):
    ready = lim._replace(
        acceleration=math.inf, yaw_acceleration=math.inf, wheel_acceleration=math.inf
    )
    v, omega = achievable(command, Twist(0.0, 0.0), ready, dt)
    assert v * command.omega == pytest.approx(omega * command.v, rel=1e-12)
    assert v * command.v >= 0.0
    assert omega * command.omega >= 0.0


@given(any_command, limits, periods)
def test_what_limits_speed_is_used_to_the_full(command, lim, dt):
    ready = lim._replace(
        acceleration=math.inf, yaw_acceleration=math.inf, wheel_acceleration=math.inf
    )
    got = achievable(command, Twist(0.0, 0.0), ready, dt)
    if got != command:
        used = max(
            abs(got.v) / lim.speed,
            abs(got.omega) / lim.yaw_rate,
            rim(*got, lim.track) / lim.wheel_speed,
        )
        assert used == pytest.approx(1.0, rel=1e-12)


@given(moving())
def test_repeating_a_command_that_was_reached_changes_nothing_measurable(case):
    lim, before, command, dt = case
    reached = achievable(command, before, lim, dt)
    again = achievable(reached, before, lim, dt)
    assert again == pytest.approx(reached, rel=1e-12, abs=1e-12)
    assert achievable(reached, reached, lim, dt) == pytest.approx(reached, rel=1e-15)


@given(moving())
def test_holding_a_command_reaches_the_fastest_twist_of_its_curvature(case):
    """Enough steps always get there: limiting never stalls half way."""
    lim, before, command, _ = case
    goal = achievable(command, Twist(0.0, 0.0), lim, 1e12)
    twist = before
    for _ in range(2000):
        twist = achievable(command, twist, lim, 10.0)
        if twist == pytest.approx(goal, rel=1e-9, abs=1e-9):
            return
    far = math.hypot(goal.v - before.v, goal.omega - before.omega)
    assert far > 2000 * 10.0 * 0.05  # only commands beyond what such a span can reach


@pytest.mark.parametrize("command", [Twist(1e308, 0.0), Twist(-1e308, 1e308), Twist(0.0, -1e308)])
def test_the_largest_floats_are_cut_like_any_other_command(command):
    sally = Limits(1.0, math.inf, 2.0, math.inf, 1.2, 2.0, 0.5)
    v, omega = achievable(command, Twist(0.5, 0.0), sally, 0.01)
    assert math.isfinite(v)
    assert math.isfinite(omega)
    assert abs(v - 0.5) <= 0.02 * (1 + 1e-12)


def test_the_fastest_wheel_sets_the_scale():
    """0.8 m/s and 2 rad/s ask 1.3 m/s of the outer wheel of a 0.5 m track; 1.2 is there."""
    sally = Limits(1.0, math.inf, 2.0, math.inf, 1.2, math.inf, 0.5)
    got = achievable(Twist(0.8, 2.0), Twist(0.0, 0.0), sally, 0.01)
    assert got == pytest.approx(Twist(0.8 * 1.2 / 1.3, 2.0 * 1.2 / 1.3))


def test_a_wheel_that_can_hardly_accelerate_stays_as_it_is():
    """An acceleration below the last digit of the speed is none, and never a NaN."""
    stiff = Limits(math.inf, math.inf, math.inf, math.inf, math.inf, 1e-18, 0.5)
    for command in (Twist(0.7, 0.3), Twist(0.9, -2.0)):
        assert achievable(command, Twist(0.7, 0.3), stiff, 0.01) == Twist(0.7, 0.3)


@pytest.mark.parametrize("track", [0.0, -0.4, math.inf, math.nan])
def test_an_invalid_track_width_is_refused_with_how_to_measure_it(track):
    with pytest.raises(CohelmError, match=r"track must be a length in metres.*measure between"):
        checked_limits(Limits(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, track))


def test_wheels_that_have_no_limits_need_no_track():
    made = checked_limits(Limits(1.0, 2.0, 2.0, 6.0))
    assert made[:6] == (1.0, 2.0, 2.0, 6.0, math.inf, math.inf)
    assert achievable(Twist(5.0, 0.0), Twist(0.0, 0.0), made, 0.1).v == pytest.approx(0.2)
    for wheels in ({"wheel_speed": 1.0}, {"wheel_acceleration": 1.0}):
        with pytest.raises(CohelmError, match="track must be a length in metres, got nan"):
            checked_limits(Limits(1.0, 2.0, 2.0, 6.0, **wheels))
