"""Scans as drivers send them end up as the robot's model has them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__LaserScan as LaserScan

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.record.ros2 import header
from cohelm.ros import laser
from cohelm.ros.laser import Ranges, lidar_model, taken
from cohelm.ros.transforms import Mount

UPRIGHT = Mount(Pose(0.1, 0.0, 0.0), False, 0.2)


def message(first, step, ranges, **more):
    values = {"time_increment": 0.0, "range_min": 0.1, "range_max": 10.0} | more
    ranges = np.asarray(ranges, dtype=np.float32)
    return LaserScan(
        header(0, "laser"), first, first + step * (len(ranges) - 1), step,
        values["time_increment"], 0.1, values["range_min"], values["range_max"], ranges,
        np.empty(0, dtype=np.float32),
    )  # fmt: skip


def around(scan, mount) -> dict[int, float]:
    """Range by bearing in the body [deg]."""
    model = lidar_model(scan, "/scan", mount, 10.0, 0.0, None)
    numbers = model.lidar()
    got = Ranges(model, mount, "/scan").of(scan)
    bearings = np.degrees(numbers.mount.psi + numbers.first + numbers.step * np.arange(len(got)))
    return {round(b) % 360: r for b, r in zip(bearings, got, strict=True)}


STEP = math.radians(1.0)


@pytest.mark.parametrize("first", [0.0, -math.pi, 1.0])
def test_a_full_circle_is_one_wherever_it_begins(first):
    ranges = np.arange(360) + 1.0
    seen = around(message(first, STEP, ranges / 100.0), UPRIGHT)
    assert len(seen) == 360
    for k in (0, 17, 200, 359):
        bearing = round(math.degrees(first) + k) % 360
        assert seen[bearing] == pytest.approx((k + 1.0) / 100.0 if k >= 9 else -math.inf)


def test_a_circle_whose_last_beam_is_its_first_has_one_less():
    scan = message(-math.pi, 2 * math.pi / 360, np.full(361, 2.0))
    model = lidar_model(scan, "/scan", UPRIGHT, 10.0, 0.0, None)
    assert (model.beams, model.field_of_view_deg) == (360, 360.0)


def test_clockwise_and_upside_down_scans_are_turned_the_right_way_round():
    ranges = np.arange(91) / 10.0 + 1.0
    plain = around(message(-0.25 * math.pi, STEP, ranges), UPRIGHT)
    clockwise = around(message(0.25 * math.pi, -STEP, ranges[::-1]), UPRIGHT)
    below = around(message(-0.25 * math.pi, STEP, ranges[::-1]), UPRIGHT._replace(upside_down=True))
    for other in (clockwise, below):
        assert other == pytest.approx(plain)


def test_zero_is_nothing_measured_and_too_near_is_too_near():
    far = [9.0] * 3
    got = around(message(-4 * STEP, STEP, [*far, 0.0, 0.05, math.inf, *far]), UPRIGHT)
    assert math.isnan(got[359])
    assert got[0] == -math.inf
    assert got[1] == math.inf


def test_a_scan_with_other_beams_than_the_first_keeps_the_nearest():
    model = lidar_model(message(0.0, STEP, np.full(360, 5.0)), "/scan", UPRIGHT, 10.0, 0.0, None)
    finer = np.full(720, 3.0)
    finer[100] = 1.0
    got = Ranges(model, UPRIGHT, "/scan").of(message(0.0, 0.5 * STEP, finer))
    assert len(got) == 360
    assert np.nanmin(got) == 1.0
    assert (got == 1.0).sum() == 1


def test_the_time_of_a_sweep_is_that_of_its_beams():
    scan = message(0.0, STEP, np.full(101, 5.0), time_increment=1e-3)
    assert taken(scan, UPRIGHT) == pytest.approx((0.0, 0.1))
    backwards = message(1.0, -STEP, np.full(101, 5.0), time_increment=1e-3)
    assert taken(backwards, UPRIGHT) == pytest.approx((0.05, 0.0))


@pytest.mark.parametrize(
    "wrong",
    [message(0.0, 0.0, [1.0, 2.0]), message(math.nan, STEP, [1.0, 2.0]), message(0.0, STEP, [1.0]),
     message(0.0, 0.1, np.ones(100)), message(0.0, STEP, [1.0, 2.0], range_max=math.nan)],
)  # fmt: skip
def test_invalid_scans_are_refused(wrong):
    with pytest.raises(CohelmError, match="/scan"):
        lidar_model(wrong, "/scan", UPRIGHT, 10.0, 0.0, None)
    assert laser.NOISE > 0.0


def test_a_damaged_scan_is_refused_by_the_name_of_its_topic():
    scan = message(-1.0, 0.1, np.ones(21))
    ranges = Ranges(
        lidar_model(scan, "/rear/scan", UPRIGHT, 10.0, 0.0, None), UPRIGHT, "/rear/scan"
    )
    with pytest.raises(CohelmError, match=r"^/rear/scan holds no scan"):
        ranges.of(message(-1.0, 0.0, np.ones(21)))
