"""Checks of proposed waypoints and goals."""

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.drive.path_check import ROOM, PathChecker
from cohelm.plan.course import poses_along
from cohelm.plan.distance_field import swept_clearances
from cohelm.plan.elastic_band import distances
from cohelm.plan.path_planner import Goal

OUTLINE = np.array([(-0.36, -0.29), (0.36, -0.29), (0.36, 0.29), (-0.36, 0.29)])
WALL = np.column_stack((np.full(200, 3.0), np.linspace(-5.0, 5.0, 200)))
BOUNDS = np.array([(-5.0, -5.0), (6.0, 5.0)])
HERE = Pose(0.0, 0.0, 0.0)


def test_a_free_path_is_followed_from_the_present_pose_with_its_clearance() -> None:
    said = PathChecker(0.5, OUTLINE, WALL, BOUNDS)(np.array([(1.0, 0.0), (2.0, 1.0)]), HERE)
    assert said.reference is not None
    assert said.why == ""
    poses = poses_along(said.reference, 0.05)
    assert poses[0, :2] == pytest.approx((0.0, 0.0))
    assert poses[-1, :2] == pytest.approx((2.0, 1.0))
    assert swept_clearances(WALL, OUTLINE, poses).min() >= ROOM


@pytest.mark.parametrize(
    ("points", "worst"),
    [
        ([(1.0, 0.0), (2.0, 0.0), (5.0, 0.0)], 2),  # through the wall
        ([(2.9, 0.0)], 0),  # into it
        ([(1.0, 0.0), (2.7, 2.0), (1.0, 3.0)], 1),  # too near
        ([(1.0, 0.0), (9.0, 0.0)], 1),  # off the map
    ],
)
def test_the_waypoint_at_fault_is_named(points: list[tuple[float, float]], worst: int) -> None:
    said = PathChecker(0.5, OUTLINE, WALL, BOUNDS)(np.array(points), HERE)
    assert said.reference is None
    assert said.worst == worst
    assert str(worst + 1) in said.why


def test_two_equal_consecutive_waypoints_are_refused_with_a_reason() -> None:
    said = PathChecker(0.5, OUTLINE, WALL, BOUNDS)(np.array([(1.0, 0.0), (1.0, 0.0)]), HERE)
    assert said.reference is None
    assert said.why


def test_the_first_waypoint_may_be_the_pose_of_the_robot() -> None:
    said = PathChecker(0.5, OUTLINE, WALL, BOUNDS)(np.array([(0.0, 0.0), (1.0, 0.0)]), HERE)
    assert said.reference is not None


DOOR = WALL[(WALL[:, 1] > 3.6) | (WALL[:, 1] < 2.4)]


def test_a_goal_behind_a_wall_is_reached_through_the_door_with_clearance() -> None:
    said = PathChecker(0.5, OUTLINE, DOOR, BOUNDS)(Goal(5.0, 0.0), HERE)
    assert said.reference is not None, said.why
    poses = poses_along(said.reference, 0.05)
    assert poses[0, :2] == pytest.approx((0.0, 0.0))
    assert poses[-1, :2] == pytest.approx((5.0, 0.0))
    assert swept_clearances(DOOR, OUTLINE, poses).min() >= ROOM


def test_in_open_space_the_path_to_a_goal_is_straight() -> None:
    nothing = np.empty((0, 2))
    said = PathChecker(0.5, OUTLINE, nothing, nothing)(Goal(3.0, 4.0), HERE)
    assert said.reference is not None
    assert distances(poses_along(said.reference, 0.05))[-1] == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ((3.05, 0.0), "the goal 3.0, 0.0 is in a wall, or too near to one"),
        ((5.0, 0.0), "no path to 5.0, 0.0 was found"),
        ((9.0, 0.0), "the goal 9.0, 0.0 is not on the map"),
        ((0.05, 0.0), "the robot is at 0.1, 0.0 already"),
    ],
)
def test_an_unreachable_goal_is_refused_with_a_reason(goal, why) -> None:
    shut = np.column_stack((np.full(300, 3.0), np.linspace(-6.5, 6.5, 300)))
    said = PathChecker(0.5, OUTLINE, shut, BOUNDS)(Goal(*goal), HERE)
    assert said.reference is None
    assert said.why == why


@pytest.mark.parametrize("far", [201.0, 1e12, 1e300])
def test_a_goal_beyond_any_path_is_refused_at_once(far) -> None:
    """Without a map nothing else bounds it, and a line of 10 cm steps to there fills the memory."""
    nothing = np.empty((0, 2))
    said = PathChecker(0.5, OUTLINE, nothing, nothing)(Goal(far, 0.0), HERE)
    assert said.reference is None
    assert said.why == f"the goal {far:.1f}, 0.0 is more than 200 m away"
