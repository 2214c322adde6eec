"""What is seen reaches guard and pilot in the frame that the robot's pose is in."""

import numpy as np
import pytest

from cohelm.core.frames import compose, inverse, placed, turned
from cohelm.core.types import Pose, disc, discs
from cohelm.law.guard.surroundings import surroundings
from cohelm.perceive.pipeline import Perception
from cohelm.robot.port import Readings
from cohelm.robot.sensors import LidarModel

HERE = Pose(0.4, -0.2, 0.3)
POINTS = np.array([[1.0, 0.0], [0.0, 2.0]])
WALKER = discs(disc(1.0, 0.5, 0.2, vx=-0.6, vy=0.1))


def from_pose(pose, points, bodies):
    """As the robot at this pose sees it: points, places and velocities of discs."""
    back = inverse(pose)
    return placed(points, back), placed(bodies[:, :2], back), turned(bodies[:, 2:4], back.psi)


@pytest.mark.parametrize("odom", [Pose(0.0, 0.0, 0.0), Pose(3.0, -7.0, 2.5)])
def test_wherever_odometry_began_the_same_things_are_around_the_robot(odom):
    lidar = LidarModel(beams=8, field_of_view_deg=360.0, range_max_m=5.0, rate_hz=10.0).lidar()
    seen = Perception(lidar).take(0.0, Readings(None, None, None, None))
    seen = seen._replace(obstacles=surroundings(WALKER.copy(), [1.0], points=POINTS))

    around = seen.placed(odom)

    now = from_pose(compose(odom, HERE), around.points, around.discs)
    for got, wanted in zip(now, from_pose(HERE, POINTS, WALKER), strict=True):
        assert got == pytest.approx(wanted, abs=1e-12)
    assert (around.discs[:, 4:] == WALKER[:, 4:]).all()
    assert (around.max_acceleration == 1.0).all()
    assert (seen.obstacles.discs == WALKER).all(), "what perception keeps has been changed"
