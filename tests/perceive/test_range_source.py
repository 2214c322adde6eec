"""A range sensor's one range stands all across its cone, and is forgotten after a while."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.scan.odometry_buffer import EMPTY, extended
from cohelm.perceive.source.range_source import RangeSource
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.load import robot

SONAR = LidarModel.model_validate(
    {"name": "sonar", "range_sensor": True, "field_of_view_deg": 30, "range_min_m": 0.1,
     "range_max_m": 4.0, "noise_m": 0.01, "mount_x_m": 0.3, "mount_yaw_deg": 90, "forget_s": 5}
)  # fmt: skip
HERE = Pose(0.0, 0.0, 0.0)


def shown(*measured, poses=(), model=SONAR, source=None):
    """The points after measurements a second apart, each from its pose."""
    source, trail = source or RangeSource(model), EMPTY
    for k, reach in enumerate(measured):
        pose = poses[k] if poses else HERE
        for t in (k - 0.01, k + 0.0):
            trail = extended(trail, Odometry(t, pose, Twist(0.0, 0.0)))
        scan = Scan(float(k), k, np.full(len(model.lidar().beams), reach), 0.0, model.name)
        assert source.number != scan.number
        source.take(scan, trail)
        assert source.number == scan.number
    return source.points


def test_it_stands_all_across_the_cone_nearer_by_three_standard_deviations():
    points = shown(1.0) - (0.3, 0.0)
    assert np.hypot(*points.T) == pytest.approx(0.97)
    bearings = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    assert (bearings.min(), bearings.max()) == pytest.approx((75.0, 105.0))
    assert np.diff(bearings).max() < 2.001


def test_what_is_too_near_is_at_the_sensor_and_at_its_least_range():
    distances = np.hypot(*(shown(-math.inf) - (0.3, 0.0)).T)
    assert distances.min() == 0.0
    assert distances.max() == pytest.approx(0.1)
    assert len(shown(-math.inf, math.inf)) == 0


def test_a_farther_range_takes_a_nearer_one_away_and_nothing_measured_does_not():
    assert len(shown(1.0, 2.0)) == len(shown(2.0))
    assert len(shown(1.0, math.inf)) == 0
    assert len(shown(1.0, math.nan)) == len(shown(1.0))
    assert len(shown(2.0, 1.0)) == 2 * len(shown(1.0))  # what is hidden may be there


def test_a_beam_without_a_number_hides_no_obstacle_of_the_others():
    seen = np.full(len(SONAR.lidar().beams), 1.0)
    seen[3] = math.nan
    assert np.array_equal(shown(seen), shown(1.0))


def test_out_of_the_cone_it_is_remembered_for_a_while_only():
    away = Pose(0.0, 0.0, math.pi)
    once = len(shown(1.0))
    assert len(shown(1.0, *[math.inf] * 5, poses=[HERE, *[away] * 5])) == once
    assert len(shown(1.0, *[math.inf] * 6, poses=[HERE, *[away] * 6])) == 0


def test_scans_of_another_length_or_time_are_none():
    source = RangeSource(SONAR)
    trail = extended(EMPTY, Odometry(0.0, HERE, Twist(0.0, 0.0)))
    source.take(Scan(0.0, 0, np.ones(3), 0.0, "sonar"), trail)
    source.take(Scan(math.nan, 1, np.ones(len(SONAR.lidar().beams)), 0.0, "sonar"), trail)
    assert len(source.points) == 0


def test_its_points_are_static_beside_the_lidars_and_observe_no_ground():
    sally = robot("sally")
    behind = SONAR.model_copy(update={"mount_x_m": -0.3, "mount_yaw_deg": 180.0})
    model = sally.model_copy(update={"further_lidars": (behind,)})
    beams, n = sally.lidar.beams, len(behind.lidar().beams)

    def seen(eyes, reach):
        for k in range(20):  # comes nearer, at half a metre a second
            t = 0.1 * k
            scan = Scan(t, k, np.full(beams, math.inf), 0.0)
            further = (Scan(t, k, np.full(n, reach - 0.05 * k), 0.0, "sonar"),) if reach else ()
            reported = Readings(Odometry(t, HERE, Twist(0.0, 0.0)), scan, None, None, further)
            made = eyes.take(t, reported)
        return made

    with_it, without = seen(Perception(model), 2.0), seen(Perception(sally), None)
    assert len(with_it.obstacles.points) == len(without.obstacles.points) + n
    ground, alone = (one.obstacles.points[one.unobserved] for one in (with_it, without))
    assert len(ground) == len(alone) > 0
    assert len(with_it.obstacles.discs) == 0
    nearest = with_it.obstacles.points[:n, 0].max()
    assert nearest == pytest.approx(-0.3 - 1.02 * math.cos(math.radians(15)))
