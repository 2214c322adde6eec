"""Docks: where an approach begins, what is on it, and who stands there."""

import math

import numpy as np
import pytest

from cohelm.core.frames import between, compose
from cohelm.core.types import Pose
from cohelm.plan.docks import (
    BEFORE,
    BEYOND,
    CORRIDOR_ASIDE,
    STAGED_ASIDE,
    STAGED_TURNED,
    Dock,
    docked,
    far,
    in_corridor,
    may_begin,
    nearest,
    poses_to,
    stands_in,
)

AT = Pose(2.0, -1.0, 2.2)
DOCK = Dock("charger", AT, 1.2, 0.08, 0.15, 40.0)
OUTLINE = np.array([(0.36, 0.29), (-0.36, 0.29), (-0.36, -0.29), (0.36, -0.29)])


def there(x: float, y: float, psi: float = 0.0) -> Pose:
    return compose(AT, Pose(x, y, psi))


def test_the_approach_ends_at_the_dock_and_begins_where_it_is_staged():
    poses = poses_to(DOCK)
    assert poses[-1] == pytest.approx(AT)
    assert poses[0] == pytest.approx(DOCK.staging)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() < 0.021
    assert DOCK.off(DOCK.staging) == pytest.approx((-1.2, 0.0, 0.0))


@pytest.mark.parametrize(
    ("x", "y", "psi", "begins", "within"),
    [
        (-1.2, 0.0, 0.0, True, True),
        (-0.5, STAGED_ASIDE - 0.01, 0.0, True, True),
        (-0.5, -STAGED_ASIDE - 0.01, 0.0, False, True),
        (-0.5, CORRIDOR_ASIDE + 0.01, 0.0, False, False),
        (-1.2 - BEFORE - 0.01, 0.0, 0.0, False, True),
        (-1.2 - BEFORE - BEYOND - 0.01, 0.0, 0.0, False, False),
        (BEYOND + 0.01, 0.0, 0.0, False, False),
        (-1.2, 0.0, STAGED_TURNED - 0.01, True, True),
        (-1.2, 0.0, -STAGED_TURNED - 0.01, False, True),
        (-1.2, 0.0, math.pi, False, False),
        (math.nan, 0.0, 0.0, False, False),
        (0.0, 0.0, math.nan, False, False),
    ],
)
def test_a_robot_off_the_line_may_not_begin_and_farther_off_not_continue(x, y, psi, begins, within):
    pose = there(x, y, psi)
    assert may_begin(DOCK, pose) is begins
    assert in_corridor(DOCK, pose) is within


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", range(3))
def test_a_pose_that_is_no_number_is_nowhere_and_nothing_is_raised(wrong, which):
    pose = Pose(*(wrong if i == which else value for i, value in enumerate(AT)))
    assert not may_begin(DOCK, pose)
    assert not in_corridor(DOCK, pose)
    assert not docked(DOCK, pose)


def test_the_docks_frame_is_that_of_all_frames():
    rng = np.random.default_rng(3)
    for _ in range(50):
        pose = Pose(*rng.uniform(-9.0, 9.0, 3).tolist())
        seen, of_all = DOCK.off(pose), between(AT, pose)
        assert seen[:2] == pytest.approx(of_all[:2])
        assert math.remainder(seen.psi - of_all.psi, 2.0 * math.pi) == pytest.approx(0.0)


def test_a_robot_is_docked_within_a_hands_width():
    assert docked(DOCK, there(-0.02, 0.04, 0.05))
    assert not docked(DOCK, there(-0.04, 0.0, 0.0))
    assert not docked(DOCK, there(0.0, 0.06, 0.0))
    assert not docked(DOCK, there(0.0, 0.0, 0.1))


def test_how_far_an_approach_is_counts_to_its_line():
    assert far(DOCK, there(-0.6, 0.5)) == pytest.approx(0.5)
    assert far(DOCK, there(-4.2, 0.0)) == pytest.approx(3.0)
    assert far(DOCK, there(3.0, 4.0)) == pytest.approx(5.0)


def test_of_several_docks_the_nearest_is_meant():
    behind = DOCK._replace(name="other", pose=there(-0.9, 0.0))
    assert nearest([DOCK, behind], there(-1.0, 0.0)) == 2
    assert nearest([DOCK, behind], there(-0.1, 0.0)) == 1
    assert nearest([DOCK, behind], there(-0.5, 3.0)) == 0
    assert nearest([], AT) == 0


@pytest.mark.parametrize(
    ("x", "y", "in_", "out"),
    [
        (0.0, 0.0, True, False),
        (-0.3, 0.5, True, False),
        (-0.3, 0.7, False, False),
        (0.5, 0.0, True, False),
        (1.0, 0.0, False, False),
        (-1.8, 0.0, False, True),
        (-1.8, 0.7, False, False),
        (-2.2, 0.0, False, False),
    ],
)
def test_a_disc_ahead_on_the_path_blocks_it(x, y, in_, out):
    """The robot is 0.9 m before the dock; a disc of 0.2 m."""
    at = there(x, y)
    disc = np.array([(at.x, at.y, 0.0, 0.0, 0.2, 0.2)])
    robot = there(-0.9, 0.0)
    assert stands_in(DOCK, robot, OUTLINE, disc, False) is in_
    assert stands_in(DOCK, robot, OUTLINE, disc, True) is out
    assert not stands_in(DOCK, robot, OUTLINE, disc[:0], False)
