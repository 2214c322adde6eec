"""What is seen reaches guard and pilot in the frame that the robot's pose is in."""

import numpy as np
import pytest

from cohelm.core.frames import compose, inverse, placed, turned
from cohelm.core.types import Pose, disc, discs
from cohelm.law.guard.surroundings import surroundings

HERE = Pose(0.4, -0.2, 0.3)
POINTS = np.array([[1.0, 0.0], [0.0, 2.0]])
WALKER = discs(disc(1.0, 0.5, 0.2, vx=-0.6, vy=0.1))


def from_pose(pose, points, bodies):
    """As the robot at this pose sees it: points, places and velocities of discs."""
    back = inverse(pose)
    return placed(points, back), placed(bodies[:, :2], back), turned(bodies[:, 2:4], back.psi)


@pytest.mark.parametrize("odom", [Pose(0.0, 0.0, 0.0), Pose(3.0, -7.0, 2.5)])
def test_wherever_odometry_began_the_same_things_are_around_the_robot(odom):
    kept = surroundings(WALKER.copy(), [1.0], points=POINTS)

    around = kept.placed(odom)

    now = from_pose(compose(odom, HERE), around.points, around.discs)
    for got, wanted in zip(now, from_pose(HERE, POINTS, WALKER), strict=True):
        assert got == pytest.approx(wanted, abs=1e-12)
    assert (around.discs[:, 4:] == WALKER[:, 4:]).all()
    assert (around.max_acceleration == 1.0).all()
    assert (kept.discs == WALKER).all(), "what perception keeps has been changed"
