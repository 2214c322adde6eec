"""Where returns are, and how surely."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.robot.collision_monitor.returns import (
    NEIGHBOURS,
    PATCH,
    SURE,
    TOO_NEAR,
    Sensor,
    averaged as averaged_of,
    returns,
)

STEP = math.radians(270.0) / 719
SENSOR = Sensor(
    Pose(0.3, 0.1, 0.5), STEP * (np.arange(720) - 359.5), STEP, 0.06, 0.02, 10.0, 0.0, 0.0
)  # fmt: skip
NOTHING = np.full(720, math.inf)


def wall(distance):
    """A wall square to the sensor's axis, in its frame x = distance."""
    with np.errstate(divide="ignore"):
        ranges = distance / np.cos(SENSOR.bearings)
    return np.where((ranges > 0.0) & (ranges < 12.0), ranges, math.inf)


def averaged(ranges, beams, sensor):
    return np.transpose([averaged_of(ranges, i, sensor.step, sensor.noise) for i in beams])


def test_a_return_stands_where_its_beam_ends():
    ranges = NOTHING.copy()
    ranges[100] = 2.0
    found = returns(ranges, SENSOR, 5.0)
    at = 0.5 + SENSOR.bearings[100]
    assert found.points == pytest.approx(
        np.array([[0.3 + 2.0 * math.cos(at), 0.1 + 2.0 * math.sin(at)]])
    )
    assert found.errors == pytest.approx([0.02])
    assert found.margins == pytest.approx([SURE * 0.02 + 2.0 * STEP])
    assert found.passed == pytest.approx([100 / 719])


def test_beams_without_return_and_far_points_do_not_count():
    ranges = NOTHING.copy()
    ranges[3], ranges[7], ranges[9] = math.nan, 5.001, 5.0
    assert returns(ranges, SENSOR, 5.0).passed == pytest.approx([9 / 719])
    assert len(returns(NOTHING, SENSOR, 5.0).points) == 0


def test_too_near_to_measure_is_something_from_the_sensor_to_its_least_range():
    ranges = NOTHING.copy()
    ranges[360] = -math.inf
    ranges[20] = 1.0
    found = returns(ranges, SENSOR, 5.0)
    at = 0.5 + SENSOR.bearings[360]
    assert found.points[1] == pytest.approx((0.3 + 0.06 * math.cos(at), 0.1 + 0.06 * math.sin(at)))
    assert found.points[2] == pytest.approx((0.3, 0.1))
    assert found.errors[1:].tolist() == [TOO_NEAR, TOO_NEAR]
    assert TOO_NEAR + 1e-9 == 1e-9
    assert found.margins[1:] == pytest.approx([0.06 * STEP, 0.0])
    assert found.passed == pytest.approx([20 / 719, 360 / 719, 360 / 719])


def test_a_surface_near_by_is_known_better_than_one_beam_of_it():
    random = np.random.default_rng(5)
    off, single = [], []
    for _ in range(200):
        ranges = wall(0.34)
        noisy = ranges + 0.02 * random.standard_normal(720)
        mean, count = averaged(noisy, np.arange(300, 420), SENSOR)
        off.append(mean - ranges[300:420])
        single.append(noisy[300:420] - ranges[300:420])
        assert count.mean() > 12.0
    assert np.std(single) == pytest.approx(0.02, rel=0.1)
    beams = 2 * int(PATCH / (0.34 * STEP)) + 1  # of the patch
    assert beams < 2 * NEIGHBOURS + 1
    assert np.std(off) == pytest.approx(0.02 / math.sqrt(beams), rel=0.15)
    assert abs(np.mean(off)) < 0.002


def test_the_stated_error_is_that_of_the_average():
    ranges = np.full(720, 1.0)  # beams 6.5 mm apart: two on either side
    found = returns(ranges, SENSOR, 5.0)
    assert found.errors[2:-2] == pytest.approx(np.full(716, 0.02 / math.sqrt(5.0)))
    assert found.errors[0] == pytest.approx(0.02 / math.sqrt(3.0))  # the first has none before it
    assert found.errors[-1] == pytest.approx(0.02 / math.sqrt(3.0))
    far = returns(np.full(720, 3.0), SENSOR, 5.0)
    assert far.errors == pytest.approx(np.full(720, 0.02))


def test_a_thin_leg_in_front_of_a_wall_is_not_averaged_away():
    ranges = wall(1.0)
    ranges[350:353] = 0.7
    mean, count = averaged(ranges, np.arange(720)[340:362], SENSOR)
    assert mean[10:13] == pytest.approx([0.7] * 3)
    assert count[10:13].tolist() == [3, 3, 3]
    assert (mean[:10] > 0.99).all()


def test_missing_beams_are_left_out_of_the_average():
    ranges = np.full(720, 0.2)
    ranges[355:365:2] = math.nan
    ranges[356:366:2] = -math.inf
    mean, count = averaged(ranges, np.array([354, 300]), SENSOR)
    assert mean == pytest.approx([0.2, 0.2])
    assert count.tolist() == [NEIGHBOURS + 1, 2 * NEIGHBOURS + 1]


def test_a_range_of_zero_is_a_return_at_the_sensor():
    ranges = NOTHING.copy()
    ranges[50] = 0.0
    found = returns(ranges, SENSOR, 5.0)
    assert found.points.tolist() == [[0.3, 0.1]]


@pytest.mark.parametrize("beams", [1, 2, 3])
def test_few_beams_are_a_scan_too(beams):
    few = SENSOR._replace(bearings=STEP * np.arange(beams))
    found = returns(np.full(beams, 0.2), few, 5.0)
    assert found.passed == pytest.approx(np.linspace(0.0, 1.0, beams))
    assert found.errors == pytest.approx(np.full(beams, 0.02 / math.sqrt(beams)))


def test_a_sensor_without_noise_is_used_unfiltered():
    exact = SENSOR._replace(noise=0.0)
    ranges = wall(0.5)
    mean, _ = averaged(ranges, np.arange(300, 400), exact)
    assert mean == pytest.approx(ranges[300:400])
    assert returns(ranges, exact, 5.0).errors.max() == 0.0
