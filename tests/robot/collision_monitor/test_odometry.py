"""Where the robot was, and where it goes."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.odometry import (
    KEPT,
    PoseHistory,
    advanced,
    between,
    placed,
    placed_at,
    seen_from,
)


def stepped(pose, twist, time, n=100_000):
    angles = pose.psi + twist.omega * time * (np.arange(n) + 0.5) / n
    way = twist.v * time / n
    return (
        pose.x + way * np.cos(angles).sum(), pose.y + way * np.sin(angles).sum(),
        pose.psi + twist.omega * time,
    )  # fmt: skip


@pytest.mark.parametrize("twist", [(0.5, 1.2), (-0.5, 0.3), (0.7, 0.0), (0.0, -1.0), (0.3, 1e-8)])
def test_a_twist_is_held_on_its_arc(twist):
    pose, twist = Pose(1.0, -2.0, 0.7), Twist(*twist)
    assert advanced(pose, twist, 0.8) == pytest.approx(stepped(pose, twist, 0.8), abs=1e-6)


@pytest.mark.parametrize("twist", [(0.5, 1.2), (-0.5, 0.3), (0.7, 0.0), (0.0, -1.0)])
def test_between_two_poses_lies_the_twist_that_leads_there(twist):
    pose, twist = Pose(1.0, -2.0, 2.7), Twist(*twist)
    after = advanced(pose, twist, 0.04)
    assert between(pose, after, 0.04) == pytest.approx(twist, rel=1e-3)


def test_a_push_aside_is_way_too():
    moved = between(Pose(0.0, 0.0, 0.0), Pose(0.0, 0.1, 0.0), 0.1)
    assert abs(moved.v) == pytest.approx(1.0)


def test_points_go_there_and_back():
    points, pose = np.array([[1.0, 2.0], [-0.5, 0.3]]), Pose(3.0, -1.0, 2.0)
    there = placed(points, *np.array([pose, pose]).T)
    c, s = math.cos(2.0), math.sin(2.0)
    assert there[0] == pytest.approx((3.0 + c - 2.0 * s, -1.0 + s + 2.0 * c))
    assert seen_from(there, pose) == pytest.approx(points)
    for point, expected in zip(points, there, strict=True):
        assert placed_at(*point, pose) == pytest.approx(tuple(expected))


def history():
    it = PoseHistory()
    it.add(1.0, Pose(0.0, 0.0, 3.0), Twist(0.0, 0.0))
    it.add(1.1, Pose(0.1, 0.2, -3.0), Twist(0.5, 0.0))
    it.add(1.3, Pose(0.3, 0.2, -2.9), Twist(0.5, 0.1))
    return it


@pytest.mark.parametrize("way", [0.4, -0.4])
@pytest.mark.parametrize("turned", [-2.5, -1.2, 1.2, 2.5])
def test_it_went_forward_or_backward_by_the_heading_half_way(way, turned):
    before = Pose(1.0, -2.0, 0.3)
    after = advanced(before, Twist(way, turned), 1.0)
    assert math.copysign(1.0, between(before, after, 1.0).v) == math.copysign(1.0, way)


@pytest.mark.parametrize("turned", [-2.0, 2.0])
@pytest.mark.parametrize(("off", "sign"), [(1.5, 1.0), (1.65, -1.0), (-1.5, 1.0), (-1.65, -1.0)])
def test_pushed_aside_it_went_where_its_heading_half_way_points_rather(turned, off, sign):
    course = 2.6 + 0.5 * turned + off
    after = Pose(1.0 + 0.4 * math.cos(course), -2.0 + 0.4 * math.sin(course), 2.6 + turned)
    assert between(Pose(1.0, -2.0, 2.6), after, 1.0).v == pytest.approx(0.4 * sign)


def test_between_two_readings_the_pose_is_in_between_and_the_heading_does_not_jump():
    it = history()
    assert it.at(1.05) == pytest.approx((0.05, 0.1, math.pi))
    assert it.at(1.2) == pytest.approx((0.2, 0.2, 2.0 * math.pi - 2.95))
    assert it.at(1.1) == pytest.approx((0.1, 0.2, 2.0 * math.pi - 3.0))
    assert it.stamp == 1.3
    assert it.twist == (0.5, 0.1)
    assert it.pose == it.at(1.3)


def test_before_the_first_it_stood_there_and_after_the_last_it_goes_on():
    it = history()
    assert it.at(0.5) == (0.0, 0.0, 3.0)
    assert it.at(1.5) == pytest.approx(advanced(it.pose, Twist(0.5, 0.1), 0.2))


def test_many_times_at_once_are_the_same_in_any_order():
    it = history()
    stamps = np.array([1.5, 0.9, 1.05, 1.1, 1.2, 1.3])
    for column, expected in zip(
        it.during(stamps), zip(*map(it.at, stamps), strict=True), strict=True
    ):
        assert column == pytest.approx(expected)
    assert np.column_stack(it.during(np.array([1.2, 1.2])))[1] == pytest.approx(it.at(1.2))
    assert np.column_stack(it.during(np.array([1.1])))[0] == pytest.approx(it.at(1.1))


def test_the_mean_twist_is_that_of_the_poses():
    it = PoseHistory()
    assert it.mean_twist(0.04) == (0.0, 0.0)
    for k in range(6):
        it.add(0.02 * k, Pose(0.01 * k * k, 0.0, 0.1 * k), Twist(9.0, 9.0))
        if k < 2:
            assert it.mean_twist(0.04) == (0.0, 0.0)
    assert it.mean_twist(0.04).omega == pytest.approx(0.2 / 0.04)
    assert it.mean_twist(0.04).v == pytest.approx((0.25 - 0.09) / 0.04, rel=1e-6)


def test_the_mean_twist_is_over_no_more_readings_than_needed():
    it = PoseHistory()
    for k in range(4):
        it.add(0.25 * k, Pose(float(k * k), 0.0, 0.0), Twist(0.0, 0.0))
    assert it.mean_twist(0.5).v == pytest.approx((9.0 - 1.0) / 0.5)
    assert it.mean_twist(0.6).v == pytest.approx(9.0 / 0.75)


def test_no_more_past_is_kept_than_needed_and_a_clock_that_went_back_begins_anew():
    it = PoseHistory()
    assert it.stamp == -math.inf
    assert len(it) == 0
    for k in range(1000):
        it.add(0.01 * k, Pose(0.01 * k, 0.0, 0.0), Twist(1.0, 0.01 * k))
    assert len(it) == round(KEPT / 0.01) + 1
    assert it.at(9.0).x == pytest.approx(9.0)
    assert it.twists(9.0, 9.0)[0].omega == pytest.approx(9.0)
    assert it.twists(0.0, 9.999)[0].omega == pytest.approx(9.99 - KEPT)
    it.clear()
    assert len(it) == 0
    assert it.twist == (0.0, 0.0)


def test_the_twists_of_a_time_are_those_held_in_it():
    it = history()
    assert it.twists(0.5, 0.9) == []
    assert it.twists(0.5, 1.0) == [(0.0, 0.0)]
    assert it.twists(1.0, 1.05) == [(0.0, 0.0)]
    assert it.twists(1.05, 1.2) == [(0.0, 0.0), (0.5, 0.0)]
    assert it.twists(1.1, 1.3) == [(0.5, 0.0), (0.5, 0.1)]
    assert it.twists(2.0, 3.0) == [(0.5, 0.1)]
    assert PoseHistory().twists(0.0, 1.0) == []


def test_a_heading_may_change_by_more_than_a_quarter_turn_in_one_reading():
    it = PoseHistory()
    it.add(0.0, Pose(0.0, 0.0, 0.5), Twist(0.0, 0.0))
    it.add(0.1, Pose(0.0, 0.0, 2.5), Twist(0.0, 0.0))
    assert it.pose.psi == pytest.approx(2.5)
