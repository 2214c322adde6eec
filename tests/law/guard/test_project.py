import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from cohelm.core.types import Twist
from cohelm.law.guard.project import _SLACK, NO_OBSTACLE, project

numbers = st.floats(-3.0, 3.0)
twists = st.builds(Twist, numbers, numbers)
weights = st.sampled_from([0.02, 0.3, 0.5, 1.0, 8.0])


_LEVERS = st.one_of(st.just(0), st.integers(-600, 600))


@st.composite
def bounds(draw: st.DrawFn, most: int = 10) -> np.ndarray:
    """Half-planes like those of contacts: unit normal, lever, some through the origin, and some
    parallel to others; in thousandths, so that two are parallel or cross nearby."""
    rows = []
    for i in range(draw(st.integers(0, most))):
        turn, lever = draw(st.integers(-3141, 3141)) / 1000, draw(_LEVERS) / 1000
        b = draw(st.one_of(st.just(0.0), st.floats(-1.5, 0.5)))
        rows.append((math.cos(turn), lever, b, float(i)))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def vertices(nominal: Twist, rows: np.ndarray, weight: float) -> list[np.ndarray]:
    """Every place the least change can be: the wish, its feet on the lines, their crossings."""
    a, b = rows[:, :2] / [1.0, weight], rows[:, 2]
    goal = np.array([nominal.v, nominal.omega * weight])
    found = [goal]
    for n, d in zip(a, b, strict=True):
        if n @ n > 1e-12:
            found.append(goal + (d - n @ goal) / (n @ n) * n)
    for i, j in itertools.combinations(range(len(a)), 2):
        pair = a[[i, j]]
        if abs(np.linalg.det(pair)) > 1e-9:
            found.append(np.linalg.solve(pair, b[[i, j]]))
    return found


def least_change(nominal: Twist, rows: np.ndarray, weight: float, slack: float) -> float:
    """Distance to the nearest place that keeps every bound to within `slack`, by trying them all;
    infinite if there is none."""
    a, goal = rows[:, :2] / [1.0, weight], np.array([nominal.v, nominal.omega * weight])
    moved = np.column_stack([rows[:, :2], rows[:, 2] - slack])
    far = [(p, 1e-9 * (1.0 + np.hypot(*p))) for p in vertices(nominal, moved, weight)]
    allowed = [p for p, rounding in far if (a @ p >= moved[:, 2] - rounding).all()]
    return min((float(np.hypot(*(p - goal))) for p in allowed), default=math.inf)


@given(twists, bounds(), weights)
@example(Twist(0.0, 0.0), np.array([[1.0, 0.0, 1.0, 0.0], [0.5, 0.0, 0.8, 1.0]]), 1.0)  # parallel
def test_it_is_the_least_change_that_keeps_every_bound(nominal, rows, weight):
    rows = rows[np.hypot(rows[:, 0], rows[:, 1] / weight) > 1e-3]
    got = project(nominal, rows.copy(), len(rows), weight)
    weak, tight = (least_change(nominal, rows, weight, s) for s in (1e-7, -1e-7))
    if not got.feasible:
        assert tight == math.inf
        return
    assert (rows[:, :2] @ np.array(got.twist) >= rows[:, 2] - 1e-7).all()
    change = math.hypot(got.twist.v - nominal.v, (got.twist.omega - nominal.omega) * weight)
    assert weak - 1e-7 <= change
    if tight < math.inf:  # not by a whisker
        assert change <= tight + 1e-7


@given(twists, bounds(), weights)
def test_the_order_of_the_bounds_does_not_matter(nominal, rows, weight):
    rows[:, 2] = np.minimum(rows[:, 2], -0.01)  # rest is allowed
    one = project(nominal, rows.copy(), len(rows), weight)
    other = project(nominal, rows[::-1].copy(), len(rows), weight)
    assert one.feasible
    assert other.feasible
    assert one.twist == pytest.approx(other.twist, abs=1e-6)


@given(twists, bounds(), weights)
def test_an_allowed_nominal_command_passes_to_the_last_bit(nominal, rows, weight):
    kept = rows[rows[:, :2] @ np.array(nominal) >= rows[:, 2]]
    assert project(nominal, kept.copy(), len(kept), weight) == (nominal, True, NO_OBSTACLE)


@given(twists, bounds(), weights)
def test_it_names_a_bound_that_holds_the_answer(nominal, rows, weight):
    got = project(nominal, rows.copy(), len(rows), weight)
    if not got.feasible or got.owner == NO_OBSTACLE:
        return
    a_v, a_omega, b, _ = rows[got.owner]
    assert a_v * got.twist.v + a_omega * got.twist.omega == pytest.approx(b, abs=1e-9)


def test_a_contradiction_is_blamed_on_the_obstacle_not_on_the_wheels():
    rows = np.array([[-1.0, 0.0, 0.1, 7.0], [1.0, 0.0, 0.4, NO_OBSTACLE]])
    for order in (rows, rows[::-1]):
        got = project(Twist(1.0, 0.0), order.copy(), 2, 0.5)
        assert (got.feasible, got.owner) == (False, 7)


def test_a_bound_that_no_motion_can_keep_is_a_contradiction():
    """A thing abeam of the wheels' middle: neither driving nor turning gets away from it."""
    got = project(Twist(0.3, 0.2), np.array([[0.0, 0.0, 0.1, 3.0]]), 1, 0.5)
    assert (got.feasible, got.owner) == (False, 3)
    kept = project(Twist(0.3, 0.2), np.array([[0.0, 0.0, -0.1, 3.0]]), 1, 0.5)
    assert (kept.twist, kept.feasible) == (Twist(0.3, 0.2), True)


@pytest.mark.parametrize("most", [0.5, 2.0, 30.0])
def test_the_obstacle_is_named_whatever_the_size_of_its_bound(most):
    got = project(Twist(most + 1.0, 0.0), np.array([[-1.0, 0.0, -most, 5.0]]), 1, 0.5)
    assert (got.twist, got.owner) == (Twist(most, 0.0), 5)


def test_the_obstacle_is_named_where_the_wheels_hold_the_answer_too():
    rows = np.array([[-1.0, -0.4, -0.5, 5.0], [0.0, -1.0, -0.5, NO_OBSTACLE]])
    for order in (rows, rows[::-1]):
        got = project(Twist(2.0, 3.0), order.copy(), 2, 5.0)
        assert (got.twist, got.owner) == (pytest.approx(Twist(0.3, 0.5)), 5)


def test_whether_steering_or_speed_yields_is_configurable():
    """Turning in beside a wall: v + 0.4 omega may be 0.5 at most."""
    rows = np.array([[-1.0, -0.4, -0.5, 0.0]])
    steering = project(Twist(0.5, 1.0), rows.copy(), 1, 100.0).twist
    assert steering == pytest.approx(Twist(0.1, 1.0), abs=1e-3)
    speed = project(Twist(0.5, 1.0), rows.copy(), 1, 1e-3).twist
    assert speed == pytest.approx(Twist(0.5, 0.0), abs=1e-3)


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9))
def test_a_huge_nominal_command_costs_no_digits_of_the_bounds(v, omega):
    box = np.array([[1, 0, -1, 0], [-1, 0, -1, 0], [0, 1, -2, 0], [0, -1, -2, 0]], dtype=float)
    got = project(Twist(v, omega), box, 4, 0.5)
    assert got.feasible
    assert got.twist == pytest.approx(
        Twist(min(max(v, -1.0), 1.0), min(max(omega, -2.0), 2.0)), abs=1e-12
    )


def test_ten_thousand_bounds_are_kept():
    rng = np.random.default_rng(3)
    turn = rng.uniform(-math.pi, math.pi, 10_000)
    rows = np.c_[np.cos(turn), rng.uniform(-0.5, 0.5, 10_000), -rng.uniform(0.2, 1.0, 10_000), turn]
    got = project(Twist(2.0, 3.0), rows, len(rows), 0.5)
    assert got.feasible
    assert (rows[:, :2] @ np.array(got.twist) >= rows[:, 2] - 1e-9).all()


def test_a_nominal_command_that_misses_a_bound_by_no_more_than_the_slack_passes_to_the_last_bit():
    nominal = Twist(-_SLACK, 0.3)
    got = project(nominal, np.array([[1.0, 0.0, 0.0, 0.0]]), 1, 0.5)
    assert got.twist == nominal
    off = Twist(-2.0 * _SLACK, 0.3)
    assert project(off, np.array([[1.0, 0.0, 0.0, 0.0]]), 1, 0.5).twist == Twist(0.0, 0.3)
