"""A scan taken while driving is what it would have been, had the robot stood at its end."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.perceive.scan.deskew import deskew
from cohelm.perceive.scan.odometry_buffer import EMPTY, extended, pose_at
from cohelm.robot.kinematics import arc
from cohelm.robot.port import Odometry
from tests.perceive.drives import LIDAR, drive
from tests.perceive.scenes import room

CLEAN = LIDAR.model_copy(update={"noise_m": 0.0})
BOX = np.array([[-3, -2, 4, -2], [4, -2, 4, 3], [4, 3, -3, 3], [-3, 3, -3, -2]], dtype=float)


def trail_of(twist, seconds=1.0):
    trail, pose = EMPTY, Pose(0.0, 0.0, 0.0)
    for k in range(round(seconds / 0.02) + 1):
        trail = extended(trail, Odometry(k * 0.02, pose, twist))
        pose = arc(pose, twist, 0.02)
    return trail


def off_wall(points, pose):
    """Distance of body-frame points from the walls of the box, seen from a world pose."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    world = points @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    walls = room(-3, -2, 4, 3)
    gaps = np.hypot(*(world[:, None, :] - walls[None]).transpose(2, 0, 1))
    return gaps.min(axis=1)


@pytest.mark.parametrize("twist", [Twist(0.8, 0.0), Twist(0.0, 1.5), Twist(0.6, -1.2)])
def test_beams_measured_while_turning_end_on_the_walls(twist):
    pose, poses = Pose(0.0, 0.0, 0.3), []
    for _ in range(51):
        poses.append(pose)
        pose = arc(pose, twist, 0.02)
    moments = list(
        drive(poses, [twist] * 50, model=CLEAN, walls=BOX, around=np.empty((0, 6)), error=0.0,
              drift=0.0)
    )  # fmt: skip
    scan = moments[-1].readings.scan
    trail = EMPTY
    for k, at in enumerate(poses):
        trail = extended(trail, Odometry(k * 0.02, at, twist))
    lidar = CLEAN.lidar()
    end = pose_at(trail, scan.stamp + scan.duration)
    compensated = off_wall(deskew(lidar, scan.ranges, scan.stamp, scan.duration, trail).points, end)
    as_it_came = off_wall(deskew(lidar, scan.ranges, scan.stamp, 0.0, trail).points, end)
    assert compensated.max() < 0.03  # the drive moves in eight pieces; the beams are 0.4 deg apart
    assert compensated.mean() < 0.4 * as_it_came.mean()


def test_ranges_outside_the_new_view_are_unknown_not_free():
    lidar = LIDAR.lidar()
    seen = deskew(lidar, np.full(720, 3.0), 0.0, 0.5, trail_of(Twist(0.0, 1.5)))
    assert np.isnan(seen.ranges).any()
    assert np.isfinite(seen.ranges).sum() > 500


def test_a_scan_of_one_instant_is_left_as_it_is():
    ranges = np.linspace(0.5, 11.0, 720)
    ranges[[3, 50, 99]] = math.inf, -math.inf, math.nan
    seen = deskew(LIDAR.lidar(), ranges, 0.1, 0.0, trail_of(Twist(1.0, 1.0)))
    assert np.array_equal(seen.ranges, ranges, equal_nan=True)
    assert len(seen.points) == 717
    assert 50 not in seen.beams  # too near to be measured is no place


@pytest.mark.parametrize("t", [-1.0, 0.0, 0.013, 0.5, 0.77, 1.0, 1.1])
def test_the_trail_knows_where_the_robot_was_and_foresees_a_little(t):
    twist = Twist(0.7, 0.9)
    known = pose_at(trail_of(twist), t)
    true = arc(Pose(0.0, 0.0, 0.0), twist, max(t, 0.0))
    assert np.allclose(known, true, atol=3e-4)


def test_readings_that_are_not_numbers_or_not_newer_leave_the_trail_alone():
    trail = trail_of(Twist(0.5, 0.0))
    for reading in (
        Odometry(2.0, Pose(math.nan, 0.0, 0.0), Twist(0.0, 0.0)),
        Odometry(0.9, Pose(5.0, 0.0, 0.0), Twist(0.0, 0.0)),
    ):
        assert extended(trail, reading) is trail


def test_a_clock_that_jumped_back_starts_anew():
    trail = trail_of(Twist(0.5, 0.0), 3.0)
    reading = Odometry(0.5, Pose(1.0, 0.0, 0.0), Twist(0.0, 0.0))
    assert len(extended(trail, reading)) == 1
