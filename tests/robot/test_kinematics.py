import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

from cohelm.core.types import Pose, Twist
from cohelm.robot.kinematics import arc
from tests.oracle import paper

poses = st.builds(Pose, st.floats(-10, 10), st.floats(-10, 10), st.floats(-20, 20))
yaw_rates = st.one_of(st.floats(-10, 10), st.floats(-1e-3, 1e-3), st.sampled_from([0.0, 1e-12]))
twists = st.builds(Twist, st.floats(-3, 3), yaw_rates)
steps = st.floats(1e-4, 2.0)


@given(poses, twists, steps)
def test_a_held_command_moves_the_robot_as_the_differential_equation_says(pose, twist, dt):
    """(5)(6) by an adaptive integrator."""
    told = solve_ivp(
        lambda _, eta: paper.plant(eta, np.array(twist)), (0, dt), np.array(pose),
        method="DOP853", rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    assert arc(pose, twist, dt) == pytest.approx(tuple(told.y[:, -1]), abs=1e-9)


@given(poses, twists, steps, st.floats(0.0, 1.0))
def test_two_parts_of_a_step_are_the_whole_step(pose, twist, dt, share):
    halfway = arc(pose, twist, share * dt)
    assert arc(halfway, twist, (1 - share) * dt) == pytest.approx(arc(pose, twist, dt), abs=1e-12)


@given(poses, twists, steps)
def test_driving_back_returns_to_the_start(pose, twist, dt):
    there = arc(pose, twist, dt)
    assert arc(there, Twist(-twist.v, -twist.omega), dt) == pytest.approx(pose, abs=1e-12)


@pytest.mark.parametrize("a", [1e-4, 0.1])
def test_series_and_closed_form_meet_without_a_step(a):
    """Either side of any switch-over between them, the pose agrees to rounding."""
    for omega in (math.nextafter(2 * a, 0), 2 * a, math.nextafter(2 * a, 1)):
        end = arc(Pose(0.0, 0.0, 0.0), Twist(1.0, omega), 1.0)
        assert end.x == pytest.approx(math.sin(omega) / omega, rel=1e-15)
        assert end.y == pytest.approx(2 * math.sin(omega / 2) ** 2 / omega, rel=1e-14)


def test_straight_ahead_is_straight():
    assert arc(Pose(1.0, 2.0, 0.0), Twist(0.5, 0.0), 0.1) == (1.05, 2.0, 0.0)


def test_the_heading_counts_on_past_half_a_turn():
    assert arc(Pose(0.0, 0.0, 3.0), Twist(0.0, 1.0), 2.0).psi == 5.0
