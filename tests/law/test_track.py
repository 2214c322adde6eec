import math

import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.types import Desired, Pose
from cohelm.law.gains import Gains
from cohelm.law.track import pose_error, track
from tests.law import states

PAPER = Gains()


def turned(pose, angle):
    """A pose (or anything that starts x, y, psi) rotated about the world's origin."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, psi, *rest = pose
    return type(pose)(c * x - s * y, s * x + c * y, psi + angle, *rest)


def test_on_the_reference_the_command_is_the_feed_forward():
    command = track(Pose(1.0, 2.0, 0.3), Desired(1.0, 2.0, 0.3, 0.5, 0.2), PAPER)
    assert command == pytest.approx((0.5, 0.2), rel=1e-15)


def test_behind_the_reference_it_speeds_up_by_k_x_per_metre():
    v, omega = track(Pose(0.0, 0.0, 0.0), Desired(0.1, 0.0, 0.0, 0.5, 0.0), PAPER)
    assert (v, omega) == pytest.approx((0.5 + 0.9 * 0.1, 0.0))


def test_right_of_the_reference_it_turns_left():
    v, omega = track(Pose(0.0, 0.0, 0.0), Desired(0.0, 0.1, 0.0, 0.5, 0.0), PAPER)
    assert v == pytest.approx(0.5)
    assert omega == pytest.approx(0.1 * 0.5)


@given(states.poses, states.desireds, st.integers(-50, 50), st.integers(-50, 50))
def test_whole_turns_of_either_heading_change_nothing(pose, desired, own, wanted):
    spun = pose._replace(psi=pose.psi + 2 * math.pi * own)
    goal = desired._replace(psi=desired.psi + 2 * math.pi * wanted)
    assert track(spun, goal, PAPER) == pytest.approx(track(pose, desired, PAPER), abs=1e-10)
    error = pose_error(pose, desired)
    # At half a turn away the two ways round are equally far, and rounding picks the side.
    assert pose_error(spun, goal) == pytest.approx(error, abs=1e-10)


@given(states.poses, states.desireds, st.floats(-math.pi, math.pi))
def test_tracking_does_not_depend_on_where_north_is(pose, desired, angle):
    seen = track(turned(pose, angle), turned(desired, angle), PAPER)
    assert seen == pytest.approx(track(pose, desired, PAPER), abs=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-math.pi, math.pi))
def test_the_lyapunov_function_of_the_tracking_law_never_grows(x, y, psi):
    """V = (x_b² + y_b²)/2 + (1 − cos ψ̃), for which (16)(17) were made, falls on a moving target."""
    assume(math.hypot(x, y) > 1e-3)
    pose, goal = Pose(x, y, psi), Desired(0.0, 0.0, 0.0, 0.5, 0.3)
    v, omega = track(pose, goal, PAPER)
    c, s = math.cos(psi), math.sin(psi)
    x_b, y_b = -x * c - y * s, x * s - y * c
    # error dynamics of the unicycle in the body frame
    dx = goal.u * math.cos(-psi) - v + omega * y_b
    dy = goal.u * math.sin(-psi) - omega * x_b
    growth = x_b * dx + y_b * dy + math.sin(-psi) * (goal.r - omega)
    assert growth <= 1e-12
