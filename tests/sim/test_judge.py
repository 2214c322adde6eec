"""The judge sees contacts for what they are, between control steps too."""

import math

import numpy as np
import pytest

from cohelm.core.row import ROW
from cohelm.core.types import disc
from cohelm.robot.limits import Limits
from cohelm.sim.judge import FAR, Judged, judge

SQUARE = np.array([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])
FREE = Limits(math.inf, math.inf, math.inf, math.inf, math.inf, math.inf, 0.5)
NO_WALLS = np.empty((0, 4))
DT = 0.02


def run(speeds, disc_x, *, limits=FREE, walls=NO_WALLS, omegas=None):
    """Robot along x at these speeds, one disc of 0.1 m on its line at these places."""
    n = len(speeds)
    rows, discs = np.zeros(n, dtype=ROW), np.zeros((n, 1, 6))
    rows["t"] = DT * np.arange(n)
    rows["applied_v"] = speeds
    rows["applied_omega"] = 0.0 if omegas is None else omegas
    rows["x"][1:] = np.cumsum(speeds)[:-1] * DT
    discs[:] = disc(0.0, 0.0, 0.1)
    discs[:, 0, 0] = disc_x
    return judge(Judged(), rows, discs, SQUARE, walls, limits, DT)


def test_driving_into_something_is_a_moving_contact():
    seen = run(np.full(100, 1.0), 1.0)
    assert (seen.moving, seen.standing) == (1, 0)
    assert seen.clearance == seen.clearance_moving < 0.0


def test_being_walked_into_while_standing_is_a_standing_contact():
    seen = run(np.zeros(100), np.linspace(2.0, 0.2, 100))
    assert (seen.moving, seen.standing) == (0, 1)
    assert seen.clearance < 0.0
    assert seen.clearance_moving == FAR


@pytest.mark.parametrize(("speed", "departing"), [(-0.1, 0), (0.1, 1)])
def test_a_contact_that_began_while_it_stood_is_standing_also_if_it_then_moves(speed, departing):
    """Away from what came is well; into it is departing, once a contact."""
    speeds = np.zeros(100)
    speeds[95:98] = speed
    seen = run(speeds, np.minimum(np.linspace(2.0, 0.2, 100), 2.0))
    assert (seen.moving, seen.standing, seen.departing) == (0, 1, departing)
    assert seen.clearance_moving > 0.0
    assert 0 < seen.touched < seen.steps == 99


def test_departing_into_another_obstacle_is_a_moving_contact():
    speeds = np.zeros(100)
    speeds[90:] = -0.5
    wall = np.array([[-0.35, -1.0, -0.35, 1.0]])
    seen = run(speeds, np.linspace(2.0, 0.2, 100), walls=wall)
    assert (seen.moving, seen.standing, seen.departing) == (1, 1, 0)


def test_a_second_thing_that_walks_into_the_moving_robot_is_a_moving_contact():
    n = 60
    rows, discs = np.zeros(n, dtype=ROW), np.zeros((n, 2, 6))
    rows["t"] = DT * np.arange(n)
    rows["applied_v"][30:] = -0.01
    rows["x"][31:] = -0.01 * DT * np.arange(1, n - 30)
    discs[:, :] = disc(0.0, 0.0, 0.1)
    discs[:, 0, 0] = np.maximum(1.0 - 0.05 * np.arange(n), 0.38)
    discs[:, 1, 1] = 0.9 - 0.012 * np.arange(n)  # there after 42 steps
    seen = judge(Judged(), rows, discs, SQUARE, NO_WALLS, FREE, DT)
    assert (seen.moving, seen.standing, seen.departing) == (1, 1, 0)


def test_the_first_contact_is_a_moving_one_if_there_is_any():
    standing = run(np.zeros(100), np.linspace(2.0, 0.2, 100))
    assert standing.clearance <= 0.0
    assert 0.0 < standing.first < 100 * DT
    x = np.concatenate((np.linspace(0.6, 0.2, 20), np.full(20, 3.0), np.full(60, 1.0)))
    both = run(np.concatenate((np.zeros(40), np.full(60, 1.0))), x)
    assert (both.moving, both.standing) == (1, 1)
    assert both.first > 40 * DT


def test_two_visits_are_two_contacts():
    there = 1.0 - 0.8 * np.abs(np.sin(np.linspace(0.0, 2.0 * math.pi, 200)))
    assert run(np.zeros(200), there).standing == 2


def test_an_obstacle_jumped_over_within_one_step_counts_as_touched():
    wall = np.array([[1.0, -1.0, 1.0, 1.0]])
    robot = np.array([[0.01, 0.3], [-0.01, 0.3], [-0.01, -0.3], [0.01, -0.3]])
    rows, discs = np.zeros(3, dtype=ROW), np.empty((3, 0, 6))
    rows["x"], rows["applied_v"] = (0.978, 1.038, 1.098), 3.0
    assert judge(Judged(), rows, discs, robot, wall, FREE, DT).moving == 1


def test_turning_on_the_spot_counts_as_moving():
    seen = run(np.zeros(80), 0.45, omegas=np.full(80, 1.0))
    assert (seen.moving, seen.standing) == (0, 0)  # the rows' headings stay: 5 cm clear
    seen = run(np.zeros(80), 0.38, omegas=np.full(80, 1.0))
    assert (seen.moving, seen.standing) == (1, 0)


@pytest.mark.parametrize(
    ("limits", "speeds", "omegas"),
    [
        (FREE._replace(speed=1.0), [0.5, 1.0 + 1e-12], [0.0, 0.0]),
        (FREE._replace(yaw_rate=1.0), [0.0, 0.0], [0.5, -1.0 - 1e-12]),
        (FREE._replace(acceleration=25.0), [0.5, 1.0 + 1e-12], [0.0, 0.0]),
        (FREE._replace(yaw_acceleration=25.0), [0.0, 0.0], [0.5, 1.0 + 1e-12]),
        (FREE._replace(wheel_speed=1.25), [0.5, 1.0], [0.0, 1.0 + 1e-11]),
        (FREE._replace(wheel_acceleration=25.0), [0.25, 0.5], [0.0, 1.0 + 1e-11]),
    ],
)
def test_the_smallest_excess_of_any_limit_is_seen(limits, speeds, omegas):
    # the last row is not judged: its step is the next piece's
    seen = run(np.array([*speeds, 0.0]), 9.0, limits=limits, omegas=np.array([*omegas, 0.0]))
    assert 0.0 < seen.excess < 1e-9
    assert run(np.zeros(3), 9.0, limits=limits).excess == 0.0


def test_pieces_are_judged_as_the_whole():
    rng = np.random.default_rng(1)
    rows, discs = np.zeros(300, dtype=ROW), np.zeros((300, 3, 6))
    rows["t"] = DT * np.arange(300)
    rows["x"], rows["y"] = rng.normal(size=(2, 300)).cumsum(axis=1) * 0.02
    rows["applied_v"] = rng.choice([0.0, 1.0], 300)
    discs[:] = np.array([disc(0.5, 0.2, 0.1), disc(-0.4, -0.4, 0.2), disc(0.1, 0.6, 0.1)])
    whole = judge(Judged(), rows, discs, SQUARE, NO_WALLS, FREE, DT)
    parts = Judged()
    for a, b in ((0, 100), (99, 101), (100, 300)):
        parts = judge(parts, rows[a:b], discs[a:b], SQUARE, NO_WALLS, FREE, DT)
    assert parts == whole
    assert whole.moving > 3
