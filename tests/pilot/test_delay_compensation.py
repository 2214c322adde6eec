"""A command takes effect after the whole delay, be it a whole number of periods or not."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from cohelm.core.types import Pose, Stick, Twist
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.delay_compensation import periods, predict_obstacles, predict_robot
from cohelm.pilot.pilot import NOTHING_NEAR, Pilot
from cohelm.robot.kinematics import arc
from tests.pilot.drives import DT, SETTINGS

speeds = st.builds(Twist, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
HERE = Pose(1.0, 2.0, 0.3)


@given(st.floats(0.0, 0.5), st.sampled_from([0.01, 0.02, 0.05]))
def test_whole_periods_and_their_rest_are_the_delay(delay, dt):
    whole, rest = periods(delay, dt)
    assert whole * dt + rest == pytest.approx(delay, abs=1e-6 * dt)
    assert 0.0 <= rest < dt


@given(speeds, st.floats(0.0, 0.3))
def test_a_robot_under_way_is_predicted_to_the_end_of_its_arc(twist, delay):
    whole, rest = periods(delay, DT)
    sent = np.tile(twist, (whole, 1))
    pose, then = predict_robot(HERE, twist, rest, sent, 7, SETTINGS.limits, DT)
    assert pose == pytest.approx(arc(HERE, twist, delay), abs=1e-7)
    assert then == twist


@given(st.floats(0.0, 0.2))
@example(0.05)
def test_the_pilot_decides_for_the_predicted_pose(delay):
    """At 50 Hz a delay of 50 ms was taken for 40."""
    pilot = Pilot(through([[0.0, 0.0], [5.0, 0.0]], 0.5), SETTINGS, delay=delay)
    pilot.sent[:] = 0.5, 0.0
    d = pilot.step(0.0, Pose(0.0, 0.0, 0.0), Twist(0.5, 0.0), Stick(0.0, 0.0), NOTHING_NEAR)
    there = d.desired.x - (d.tracking.v - d.desired.u) / SETTINGS.gains.k_x  # what (16) tracks from
    assert there == pytest.approx(0.5 * delay, abs=1e-6)


@given(st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 2.0), st.floats(0.0, 1.0))
def test_a_disc_grows_by_as_much_in_two_steps_as_in_one(first, second, most, off):
    """What is foretold again and again grows no faster: t later, off t + most t^2 / 2."""
    now = surroundings([[1.0, 0.0, 0.4, -0.3, 0.2, 0.5]], [most], velocity_error=[off])
    t = first + second
    once, twice = (
        predict_obstacles(now, t),
        predict_obstacles(predict_obstacles(now, first), second),
    )
    for then in (once, twice):
        x, y, _, _, radius, _ = then.discs[0]
        assert (x, y) == pytest.approx((1.0 + 0.4 * t, -0.3 * t))
        assert radius == pytest.approx(0.2 + off * t + 0.5 * most * t * t)
        assert then.velocity_error == pytest.approx([off + most * t])
        assert then.max_acceleration == pytest.approx([most])
    assert now.discs[0, 4] == 0.2  # what was told is not written into
    assert now.velocity_error[0] == off
