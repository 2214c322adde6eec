import math
import re

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.interpolate import CubicSpline

from cohelm.core.errors import CohelmError
from cohelm.core.scalars import wrap
from cohelm.law.reference import desired, evaluate, tabulate, through
from tests.oracle import lab, paper

LAB = through(lab.WAYPOINTS, lab.SPEED)


@st.composite
def routes(draw, least=2, most=10):
    """Waypoints a robot could be given: each 0.3 to 3 m on, turning less than 70°."""
    x, y, course = draw(st.floats(-5, 5)), draw(st.floats(-5, 5)), draw(st.floats(-3.2, 3.2))
    points = [(x, y)]
    for _ in range(draw(st.integers(least, most)) - 1):
        step = draw(st.floats(0.3, 3.0))
        course += draw(st.floats(-1.2, 1.2))
        x, y = x + step * math.cos(course), y + step * math.sin(course)
        points.append((x, y))
    return points


speeds = st.floats(0.1, 3.0)


def at(reference, t):
    return evaluate(reference.knots, reference.coeffs, t)


@given(routes(), speeds, st.floats(0.0, 1.0))
def test_the_path_is_the_twins_spline(points, speed, share):
    """(7)–(11), solved densely from the conditions alone."""
    ours, twin = through(points, speed), paper.Spline(points, speed)
    t = share * ours.duration
    place, velocity, acceleration = twin(t)
    assert ours.knots == pytest.approx(twin.knots)
    assert at(ours, t) == pytest.approx((*place, *velocity, *acceleration), rel=1e-9, abs=1e-8)


@given(routes(), speeds)
def test_the_path_is_scipys_natural_spline(points, speed):
    ours = through(points, speed)
    scipys = CubicSpline(ours.knots, points, bc_type="natural")
    for t in np.linspace(0.0, ours.duration, 37):
        reported = (*scipys(t), *scipys(t, 1), *scipys(t, 2))
        assert at(ours, t) == pytest.approx(reported, rel=1e-9, abs=1e-9)


@given(routes(), speeds)
def test_each_way_point_is_passed_at_chord_over_speed_after_the_last(points, speed):
    ours = through(points, speed)
    t = 0.0
    for k, point in enumerate(points):
        t += math.dist(points[k - 1], point) / speed if k else 0.0
        assert ours.knots[k] == pytest.approx(t)
        assert at(ours, ours.knots[k])[:2] == pytest.approx(point, abs=1e-12 * (1 + t) * 10)


@given(routes(), speeds)
def test_the_ends_are_natural(points, speed):
    ours = through(points, speed)
    assert at(ours, 0.0)[4:] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert at(ours, ours.duration)[4:] == pytest.approx((0.0, 0.0), abs=1e-9 * (1 + speed**2 * 100))


@given(routes(least=3), speeds)
def test_position_velocity_and_acceleration_are_continuous_at_the_knots(points, speed):
    ours = through(points, speed)
    for t in ours.knots[1:-1]:
        left = at(ours, math.nextafter(t, 0.0))
        assert left == pytest.approx(at(ours, t), rel=1e-6, abs=1e-6)


@given(routes(), speeds, st.floats(0.01, 0.99))
def test_heading_and_yaw_rate_are_those_of_the_path(points, speed, share):
    """(12)(13) by finite differences of position alone."""
    ours = through(points, speed)
    t, dt = share * ours.duration, 1e-4
    here = desired(ours, t, True)
    before, after = at(ours, t - dt), at(ours, t + dt)
    course = math.atan2(after.y - before.y, after.x - before.x)
    if here.u < 0.05 * speed:
        return  # a near cusp: finite differences see nothing there
    assert abs(wrap(here.psi - course)) < 1e-4 * (1 + abs(here.r))
    turn = wrap(desired(ours, t + dt, True).psi - desired(ours, t - dt, True).psi) / (2 * dt)
    if not any(abs(t - knot) < 2 * dt for knot in ours.knots):
        assert here.r == pytest.approx(turn, rel=1e-3, abs=1e-4)


@given(routes(), speeds, st.floats(0.0, 0.999))
def test_the_desired_pose_is_the_twins_with_either_feed_forward(points, speed, share):
    """E10: u_d as printed, or the spline's own speed."""
    ours, twin = through(points, speed), paper.Spline(points, speed)
    t = share * ours.duration
    if at(ours, t).vx ** 2 + at(ours, t).vy ** 2 < 1e-3 * speed**2:
        return
    for own, u_d in ((False, speed), (True, None)):
        reported = twin.goal(t, u_d)
        got = desired(ours, t, own)
        assert (got.x, got.y, got.u) == pytest.approx(
            (reported.x, reported.y, reported.u), abs=1e-9
        )
        assert wrap(got.psi - reported.psi) == pytest.approx(0.0, abs=1e-8)
        assert got.r == pytest.approx(reported.r, rel=1e-6, abs=1e-8)


def test_on_the_lab_the_splines_own_speed_differs_from_u_d_by_some_percent():
    """E10 matters, but little: why it is an option and not the rule."""
    t = np.linspace(0.0, LAB.duration, 5000, endpoint=False)
    own = np.array([desired(LAB, s, True).u for s in t])
    assert 0.35 < own.min() < 0.49
    assert 0.51 < own.max() < 0.60
    assert {desired(LAB, s, False).u for s in t} == {0.5}


@pytest.mark.parametrize("t", [-1e9, -0.001, LAB.duration, LAB.duration + 0.001, 1e9])
def test_outside_its_time_the_reference_rests_at_its_end(t):
    d = desired(LAB, t, False)
    assert (d.u, d.r) == (0.0, 0.0)
    end = lab.WAYPOINTS[0] if t < 0 else lab.WAYPOINTS[-1]
    assert (d.x, d.y) == pytest.approx(end, abs=1e-12)
    assert wrap(d.psi - (math.pi / 2 if t < 0 else math.pi)) == pytest.approx(0.0, abs=0.1)


@given(st.floats(-3.0, 3.0), st.floats(0.5, 5.0), speeds, st.integers(2, 6), st.floats(0.0, 0.999))
def test_a_straight_line_is_driven_straight_at_the_nominal_speed(
    course, length, speed, points, share
):
    c, s = math.cos(course), math.sin(course)
    reference = through([(k * length * c, k * length * s) for k in range(points)], speed)
    t = share * reference.duration
    for own in (False, True):
        d = desired(reference, t, own)
        assert (d.x, d.y) == pytest.approx((speed * t * c, speed * t * s), abs=1e-11)
        assert (d.u, d.r) == pytest.approx((speed, 0.0), abs=1e-9)
        assert wrap(d.psi - course) == pytest.approx(0.0, abs=1e-9)


def test_the_last_instant_before_the_end_still_moves():
    assert desired(LAB, math.nextafter(LAB.duration, 0.0), False).u == 0.5
    assert desired(LAB, 0.0, False).u == 0.5


def test_where_the_path_turns_on_the_spot_the_yaw_rate_is_0():
    """A cusp: straight there and back stops at the far point, where ψ_d and r_d have no limit."""
    there_and_back = through([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)], 0.5)
    d = desired(there_and_back, 2.0, False)
    assert (d.x, d.y) == pytest.approx((1.0, 0.0))
    assert (d.u, d.r) == (0.0, 0.0)


@pytest.mark.parametrize("own", [False, True])
def test_the_table_is_the_reference_step_by_step(own):
    table = tabulate(LAB, 0.25, 300, own)
    assert table.shape == (300, 5)
    for k in (0, 1, 117, 234, 235, 299):
        assert tuple(table[k]) == pytest.approx(desired(LAB, k * 0.25, own), abs=1e-12)


nan, inf = math.nan, math.inf
refused = [
    ([], 0.5, "waypoints"),
    ([[0, 0]], 0.5, "at least 2 waypoints, got 1"),
    ([[0, 0, 0], [1, 1, 1]], 0.5, "pairs"),
    ([[0, 0], [1]], 0.5, "pairs of numbers"),
    ([["a", 0], [1, 1]], 0.5, "pairs of numbers"),
    ([1.0, 2.0], 0.5, "pairs"),
    ([[0, 0], [nan, 1]], 0.5, "waypoint 2 is not finite"),
    ([[0, inf], [1, 1]], 0.5, "waypoint 1 is not finite"),
    ([[0, 0], [1, 1], [1, 1]], 0.5, "waypoints 2 and 3 are the same point [1.0, 1.0]; remove one"),
    ([[0, 0], [1e308, 1e308], [-1e308, 0]], 0.5, "too far"),
    ([[0, 0], [1, 1]], 0.0, "speed must be a positive number of m/s, got 0.0"),
    ([[0, 0], [1, 1]], -0.5, "got -0.5"),
    ([[0, 0], [1, 1]], nan, "got nan"),
    ([[0, 0], [1, 1]], inf, "got inf"),
    ([[0, 0], [1, 1]], 5e-324, "too far"),
    ([[0, 0], [1, 0], [1, 1e-5]], 1e300, "too near for a speed of 1e+300 m/s"),
]


@pytest.mark.parametrize(("waypoints", "speed", "words"), refused)
def test_invalid_waypoints_are_refused_with_the_reason(waypoints, speed, words):
    with pytest.raises(CohelmError, match=re.escape(words)) as caught:
        through(waypoints, speed)
    assert "\n" not in str(caught.value)


def test_closed_routes_may_pass_a_point_twice():
    assert through([(0, 0), (1, 0), (1, 1), (0, 0)], 0.5).duration == pytest.approx(
        (2 + 2**0.5) / 0.5
    )
