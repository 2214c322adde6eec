"""Time and memory of maps and mapping are bounded by sentences, not by the machine."""

import math
import resource
import time

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.perceive.localize.localization_map import MOST_BORDER, map_from_occupancy
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.perceive.map.mapping_scans import mapping_scans
from cohelm.perceive.map.raster import raster
from cohelm.perceive.match.surfaces import MOST_CELLS, FlatPoints, surfaces
from cohelm.perceive.pipeline import Perception
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import borders, grid
from tests.few import first

HERE = Pose(0.0, 0.0, 0.0)


def noise(side, share=0.5, seed=1):
    return np.random.default_rng(seed).random((side, side)) < share


def peak_gib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


@pytest.mark.parametrize("side", first([2500, 5000]))
def test_a_map_of_noise_is_refused_within_seconds_and_little_memory(side):
    solid = noise(side)
    begun, before = time.monotonic(), peak_gib()
    with pytest.raises(CohelmError, match="to localise by: clear it of noise"):
        map_from_occupancy(solid, ~solid, 0.05, HERE)
    with pytest.raises(CohelmError, match="a world may have: clear it of noise"):
        borders(grid(solid, 0.05, HERE))
    assert time.monotonic() - begun < 60.0
    assert peak_gib() - before < 2.0


@pytest.mark.slow
def test_a_noisy_map_within_the_bound_is_used_within_its_time_and_memory():
    solid = noise(900)
    assert 0.5 * MOST_BORDER < np.count_nonzero(solid) <= MOST_BORDER
    begun, before = time.monotonic(), peak_gib()
    made = map_from_occupancy(solid, ~solid, 0.05, HERE)
    assert len(made.surfaces.points) > 1000
    assert time.monotonic() - begun < 120.0
    assert peak_gib() - before < 2.0


def test_a_drive_across_half_the_earth_is_refused_and_asks_for_no_memory():
    points = [np.array([[1.0, 0.0]])] * 2
    with pytest.raises(CohelmError, match=r"million cells of 0\.025 m: choose a coarser"):
        raster([HERE, Pose(1e9, 0.0, 0.0)], points, HERE, 0.025)
    with pytest.raises(CohelmError, match="million cells"):
        raster([HERE, Pose(math.inf, 0.0, 0.0)], points, HERE, 0.025)
    far = np.array([[0.0, 0.0], [20_000.0, 20_000.0]])
    with pytest.raises(CohelmError, match="check the odometry for jumps"):
        surfaces(FlatPoints(far, np.ones((2, 2))), 0.05, 0.65)
    assert MOST_CELLS * 8 < 2**30


def test_odometry_that_no_drive_can_have_is_refused_before_the_work():
    lidar = LidarModel(beams=180, field_of_view_deg=180.0, rate_hz=10.0).lidar()
    path = [
        Odometry(0.1 * k, Pose(1e9 if k == 5 else 0.0, 0.0, 0.0), Twist(0.0, 0.0))
        for k in range(10)
    ]
    scans = [Scan(0.1 * k, k, np.full(180, 2.0), 0.0) for k in range(10)]
    with pytest.raises(CohelmError, match=r"the odometry spans 1e\+09 m"):
        mapping_scans(lidar, path, scans)


@pytest.mark.parametrize(("half", "far"), [(1.0, 8.0), (0.15, 0.15)])
def test_a_map_of_another_place_or_of_a_cupboard_leaves_the_robot_lost(half, far):
    corners = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    known = map_from_geometry(np.hstack((corners, np.roll(corners, -1, axis=0))), HERE)
    lidar = LidarModel(beams=180, field_of_view_deg=360.0, range_max_m=20.0).lidar()
    eyes = Perception(lidar, known)
    for k in range(100):  # longer than a search
        odometry = Odometry(0.02 * k, HERE, Twist(0.0, 0.0))
        scan = Scan(0.1 * (k // 5), k // 5, np.full(180, far), 0.0)
        seen = eyes.take(0.02 * k, Readings(odometry, scan))
    assert seen.lost
    assert seen.reason == "no place on the map looks like what the LiDAR sees"


def test_scans_without_any_odometry_are_no_drive():
    lidar = LidarModel(beams=180, field_of_view_deg=180.0, rate_hz=10.0).lidar()
    with pytest.raises(CohelmError, match="no scan came while there was odometry"):
        mapping_scans(lidar, [], [Scan(0.0, 0, np.full(180, 2.0), 0.0)])
