"""What is seen replaces what was remembered; what can not be seen is not forgotten."""

import math

import numpy as np
import pytest

from cohelm.core.frames import placed
from cohelm.core.types import Pose, disc, discs
from cohelm.perceive.source.observation_source import filtered_ranges
from cohelm.perceive.space.scan_memory import KEEP, renew, smoothed
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan
from tests.perceive.scenes import NOTHING

MODEL = LidarModel(beams=720, field_of_view_deg=270.0, noise_m=0.01, mount_x_m=0.1)


def look(pose, world, number=0, model=MODEL):
    lidar = model.lidar()
    ranges = np.empty(model.beams)
    scan(pose, lidar, world, np.empty((0, 4)), NO_GRID, 1, number, ranges)
    return ranges


def seen(points, pose, world, number=0, model=MODEL):
    return renew(points, pose, model.lidar(), look(pose, world, number, model), KEEP)


POLE = discs(disc(2.0, 0.5, 0.2))
AT = Pose(0.0, 0.0, 0.0)


def off_surface(points):
    return np.abs(np.hypot(points[:, 0] - 2.0, points[:, 1] - 0.5) - 0.2)


@pytest.mark.parametrize("pose", [AT, Pose(1.0, -1.0, 1.0), Pose(3.5, 0.0, 3.0)])
def test_points_lie_on_what_was_hit_in_the_world_frame(pose):
    points = seen(NOTHING, pose, POLE)
    assert len(points) > 5
    assert off_surface(points).max() < 0.04


def test_averaging_over_a_surface_takes_most_of_the_noise_away():
    near = Pose(1.2, 0.5, 0.0)
    lidar, ranges = MODEL.lidar(), look(near, POLE)
    hit = np.isfinite(ranges)
    raw = placed(placed(ranges[hit, None] * lidar.beams[hit], lidar.mount), near)
    clean = seen(NOTHING, near, POLE)
    assert off_surface(clean)[8:-8].mean() < 0.5 * off_surface(raw)[8:-8].mean()


def test_averaging_does_not_mix_two_surfaces():
    ranges = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
    assert smoothed(ranges, 0.005, 0.02).tolist() == ranges.tolist()


def test_averaging_leaves_missing_returns_missing():
    ranges = np.array([math.inf, 1.0, math.nan, -math.inf, 1.0])
    assert np.array_equal(smoothed(ranges, 0.005, 0.02), ranges, equal_nan=True)


def test_a_point_that_vanished_in_view_is_forgotten():
    points = seen(NOTHING, AT, POLE)
    assert len(seen(points, AT, discs())) == 0


def test_points_behind_the_robot_are_remembered():
    points = seen(NOTHING, AT, POLE)
    after = seen(points, Pose(2.0, 0.0, -1.57), discs())  # the pole is now behind, and gone
    assert len(after) == len(points)


def test_occluded_points_are_remembered():
    points = seen(NOTHING, AT, POLE)
    both = discs(*POLE.tolist(), disc(1.0, 0.25, 0.2))
    after = seen(points, AT, both)
    assert (off_surface(after) < 0.05).sum() == len(points)
    assert (np.hypot(after[:, 0] - 1.0, after[:, 1] - 0.25) < 0.25).sum() > 5


def test_a_point_that_is_seen_again_is_not_stored_twice():
    points = NOTHING
    counts = []
    for number in range(60):
        points = seen(points, AT, POLE, number)
        counts.append(len(points))
    assert max(counts) < 1.5 * counts[0]


def test_beams_without_a_return_clear_nothing():
    points = seen(NOTHING, AT, POLE)
    blind = np.full(MODEL.beams, math.nan)
    assert len(renew(points, AT, MODEL.lidar(), blind, KEEP)) == len(points)


def test_a_dropped_beam_clears_no_occluded_point():
    points = seen(NOTHING, AT, POLE)
    ranges = look(AT, discs(disc(1.0, 0.25, 0.2)))
    ranges[::2] = math.inf
    after = renew(points, AT, MODEL.lidar(), ranges, KEEP)
    assert (off_surface(after) < 0.05).sum() == len(points)


def test_points_below_the_minimum_range_are_not_forgotten():
    world = discs(disc(0.25, 0.0, 0.1))  # 5 cm from the sensor, nearer than range_min
    points = seen(NOTHING, AT, world)
    distances = np.hypot(points[:, 0] - 0.1, points[:, 1])
    assert distances.min() == pytest.approx(MODEL.range_min_m, abs=0.04)


def test_far_points_are_forgotten():
    points = np.array([[-3.0, 0.0], [-KEEP - 1.0, 0.0]])
    assert seen(points, AT, discs()).tolist() == [[-3.0, 0.0]]


ROUND = LidarModel(beams=960, field_of_view_deg=360.0, noise_m=0.02)
SHEET = np.array([[0.0, 0.0, 2.0, 0.0]])


def lost_end(aside, seed):
    """How far the nearest thing remembered ever was from the near end of a thin wall, when the
    sensor crossed its line some 0.6 m away, by `aside` from scan to scan [m]."""
    rng, lidar = np.random.default_rng(seed), ROUND.lidar()
    ahead = rng.uniform(-1.0, 1.0)  # of what it comes nearer, while it goes aside by 1
    points, worst = NOTHING, 0.0
    for k, y in enumerate(np.arange(0.3, -0.1, -aside) - aside * rng.uniform()):
        pose = Pose(-0.6 - ahead * y, y, rng.uniform(-0.01, 0.01))
        ranges = np.empty(ROUND.beams)
        scan(pose, lidar, discs(), SHEET, NO_GRID, seed, k, ranges)
        points = renew(points, pose, lidar, filtered_ranges(ranges, lidar.noise), KEEP)
        if y < 0.2:
            worst = max(worst, float(np.hypot(*points.T).min(initial=9.0)))
    return worst


@pytest.mark.parametrize("aside", [0.005, 0.01, 0.03])
def test_a_thin_wall_that_points_at_the_sensor_is_not_forgotten(aside):
    assert max(lost_end(aside, seed) for seed in range(40)) < 0.1


def left_behind(seed):
    """How far from somebody who walks away or aside anything is remembered [m]."""
    rng, lidar = np.random.default_rng(seed), ROUND.lidar()
    radius, speed, course = rng.uniform(0.05, 0.5), rng.uniform(0.1, 1.3), rng.uniform(-1.5, 1.5)
    along = np.array([math.cos(course), math.sin(course)])
    at, points = np.array([rng.uniform(0.8, 2.0) + radius, 0.0]), NOTHING
    for k in range(40):
        ranges = np.empty(ROUND.beams)
        at = at + 0.1 * speed * along
        scan(AT, lidar, discs(disc(*at, radius)), np.empty((0, 4)), NO_GRID, seed, k, ranges)
        points = renew(points, AT, lidar, filtered_ranges(ranges, lidar.noise), KEEP)
    return float(np.hypot(*(points - at).T).max(initial=0.0)) - radius


def test_a_walker_in_view_leaves_no_points_behind():
    assert max(left_behind(seed) for seed in range(300)) < 0.15
