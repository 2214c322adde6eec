"""Floor that no camera has seen stands, whatever a LiDAR looks past; what it has seen does not."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.space.scan_memory import KEEP, renew
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot

DEEP = robot("sally-depth")
ROUND = DEEP.model_copy(
    update={
        "lidar": DEEP.lidar.model_copy(update={"field_of_view_deg": 360.0}) if DEEP.lidar else None
    }
)
"""With a LiDAR that looks all round, and at no floor."""
LIDAR = DEEP.further_lidars[0].lidar()


def reported(poses, deep=math.inf, model=ROUND, outlines=()):
    """Points in the body frame after a scan from each pose; all see nothing that stands, and the
    camera what is given. outlines: what the robot has become before each of the last scans."""
    eyes, seen = Perception(model), None
    for k, pose in enumerate(poses):
        if (new := k - len(poses) + len(outlines)) >= 0:
            eyes.reshape(outlines[new])
        t = 0.1 * k
        scan = Scan(t, k, np.full(720, math.inf), 0.0, "planar")
        floor = Scan(t, k, np.full(model.further_lidars[0].beams, deep), 0.0, "deep")
        seen = eyes.take(
            t, Readings(Odometry(t, pose, Twist(0.0, 0.0)), scan, None, None, (floor,))
        )
    assert seen is not None
    last = poses[-1]
    c, s = math.cos(last.psi), math.sin(last.psi)
    off = seen.obstacles.points - (last.x, last.y)
    return np.column_stack((c * off[:, 0] + s * off[:, 1], -s * off[:, 0] + c * off[:, 1]))


def turned(*degrees):
    return [Pose(0.0, 0.0, math.radians(d)) for d in degrees]


@pytest.mark.parametrize("model", [ROUND, DEEP])
def test_floor_that_was_never_observed_counts_as_an_obstacle(model):
    for poses in (turned(0), turned(*range(0, 101, 10))):
        points = reported(poses, model=model)
        bearings = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
        behind = np.abs(np.abs(bearings) - 180.0) < 20.0
        assert behind.any()
        far = np.hypot(*points.T)
        assert far.min() > (0.9 if model is ROUND else 0.6)  # observed by the person who started it
        assert far[behind].max() < 1.5
        assert not (np.abs(bearings) < 25.0).any()  # ahead it sees


def test_floor_that_was_observed_once_may_be_backed_onto():
    assert not len(reported(turned(*range(0, 361, 5))))


def test_floor_beneath_a_load_is_not_reported_and_stays_unobserved_without_it():
    backed = [Pose(-x, 0.0, 0.0) for x in np.arange(0.0, 0.65, 0.04)]
    load = np.array([(0.36, 0.29), (-0.9, 0.29), (-0.9, -0.29), (0.36, -0.29)])

    def beneath(points):
        return int(((np.abs(points[:, 1]) < 0.29) & (points[:, 0] > -0.9)).sum())

    assert beneath(reported(backed)) > 0
    assert beneath(reported(backed, outlines=[load])) == 0
    assert len(reported(backed, outlines=[load])) > 0
    assert np.array_equal(reported(backed, outlines=[load, ROUND.outline]), reported(backed))


def test_a_camera_without_depth_confirms_no_floor():
    everywhere = reported(turned(*range(0, 361, 5)), deep=math.nan)
    assert len(everywhere)
    assert (np.abs(np.arctan2(everywhere[:, 1], everywhere[:, 0])) < 0.3).any()


def test_points_nearer_than_the_full_height_band_persist_though_beams_pass_above():
    low = np.array([[LIDAR.mount.x + 0.40, 0.02], [LIDAR.mount.x + 0.9, 0.4]])
    past = np.full(len(LIDAR.beams), math.inf)
    kept = renew(low, Pose(0.0, 0.0, 0.0), LIDAR, past, KEEP)
    assert kept.tolist() == low[:1].tolist()  # what is farther away would be seen
    again = past.copy()
    again[:] = 0.42
    kept = renew(low, Pose(0.0, 0.0, 0.0), LIDAR, again, KEEP)
    assert low[0].tolist() not in kept.tolist()  # it is seen anew


def test_readings_below_the_minimum_range_fill_no_memory():
    points, close = np.empty((0, 2)), np.full(len(LIDAR.beams), -math.inf)
    for _ in range(20):
        points = renew(points, Pose(0.0, 0.0, 0.0), LIDAR, close, KEEP)
    assert 10 < len(points) <= len(LIDAR.beams)


@pytest.mark.parametrize("edges", [False, True])
def test_where_floor_ends_nothing_sets_off_whatever_noise_makes_of_it(edges):
    """An edge that seems to come nearer was taken for a mover, and the robot fled from it."""
    eyes, seen = Perception(ROUND), None
    beams = ROUND.further_lidars[0].beams
    middle = slice(beams // 2 - 12, beams // 2 + 12)
    for k in range(12):
        t, far = 0.1 * k, np.full(beams, math.inf)
        far[middle] = 2.0 - 0.08 * k
        first = Scan(t, k, np.full(720, math.inf), 0.0, "planar")
        floor = Scan(t, k, far, 0.0, "deep", np.isfinite(far) if edges else None)
        odometry = Odometry(t, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0))
        seen = eyes.take(t, Readings(odometry, first, None, None, (floor,)))
    assert seen is not None
    assert (len(seen.obstacles.discs) == 0) == edges
    if edges:
        assert (np.hypot(*seen.obstacles.points.T) < 1.5).any()  # it stands
