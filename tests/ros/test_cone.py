"""Range sensors over ROS 2: what a Range says, in REP-117's words, and what is no cone."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.robot.sensors import LidarModel
from cohelm.ros.cone import ConeRanges, described, rep117_range

INF, NAN = math.inf, math.nan
GIVEN = LidarModel.model_validate(
    {"name": "left", "range_sensor": True, "field_of_view_deg": 30, "timeout_s": 0.5}
)


def message(measured=1.0, low=0.02, high=4.0, view=0.5):
    return SimpleNamespace(min_range=low, max_range=high, field_of_view=view, range=measured)


def level(yaw=0.0, pitch=0.0):
    """Its mount: where it looks, and how far down [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    made = np.eye(4)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    tilt = np.array(
        [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
    )
    made[:3, :3], made[:3, 3] = turn @ tilt, (0.2, 0.1, 0.15)
    return made


@pytest.mark.parametrize(
    ("measured", "low", "high", "means"),
    [
        (1.0, 0.02, 4.0, 1.0), (4.0, 0.02, 4.0, 4.0), (0.02, 0.02, 4.0, 0.02),
        (4.01, 0.02, 4.0, INF), (INF, 0.02, 4.0, INF), (0.01, 0.02, 4.0, -INF),
        (-INF, 0.02, 4.0, -INF), (NAN, 0.02, 4.0, NAN), (0.0, 0.02, 4.0, NAN),
        (-1.0, 0.02, 4.0, NAN), (-INF, 0.3, 0.3, -INF), (INF, 0.3, 0.3, INF),
        (0.3, 0.3, 0.3, -INF), (0.1, 0.3, 0.3, -INF), (0.31, 0.3, 0.3, INF), (NAN, 0.3, 0.3, NAN),
    ],
)  # fmt: skip
def test_ranges_follow_rep_117(measured, low, high, means):
    assert rep117_range(measured, low, high) == means or math.isnan(
        rep117_range(measured, low, high)
    )
    assert math.isnan(rep117_range(measured, low, high)) == math.isnan(means)


def test_the_cone_is_as_the_message_says_and_where_its_frame_is():
    found = described(message(), "/left", level(yaw=0.6), 12.0, 0.03, GIVEN)
    assert (found.name, found.timeout_s, found.rate_hz) == ("left", 0.5, 12.0)
    assert found.field_of_view_deg == pytest.approx(math.degrees(0.5))
    assert (found.range_min_m, found.range_max_m) == pytest.approx((0.02, 4.0))
    assert (found.mount_x_m, found.mount_y_m) == pytest.approx((0.2, 0.1))
    assert found.mount_yaw_deg == pytest.approx(math.degrees(0.6))
    assert math.degrees(found.lidar().step) <= 2.0
    ranges = ConeRanges(found, level(yaw=0.6), "/sonar").of(message(1.5))
    assert ranges.tolist() == [1.5] * found.beams


def test_a_sensor_that_looks_down_a_little_measures_along_the_floor():
    tilted = level(pitch=math.radians(15.0))
    found = described(message(), "/left", tilted, 12.0, 0.03, GIVEN)
    flat = math.cos(math.radians(15.0))
    assert ConeRanges(found, tilted, "/sonar").of(message(1.0))[0] == pytest.approx(flat)
    assert found.range_max_m == pytest.approx(4.0 * flat)


@pytest.mark.parametrize(
    ("wrong", "mount", "said"),
    [
        (message(low=NAN), level(), "from nan to 4 m: fix min_range"),
        (message(high=INF), level(), "to inf m"),
        (message(low=5.0), level(), "from 5 to 4 m"),
        (message(low=-1.0), level(), "from -1"),
        (message(low=0.0, high=0.0), level(), "from 0 to 0 m"),
        (message(view=1e-9), level(), "describes no range sensor"),
        (message(view=0.0), level(), "cone is 0 deg wide: fix field_of_view"),
        (message(view=30.0), level(), "cone is 1718.87 deg wide"),
        (message(view=NAN), level(), "cone is nan"),
        (message(), level(pitch=math.radians(90.0)), "looks 90 deg down, and up to 20 can"),
        (message(), level(pitch=math.radians(-30.0)), "looks 30 deg up"),
    ],
)
def test_an_invalid_cone_is_refused_in_one_sentence(wrong, mount, said):
    with pytest.raises(CohelmError, match=said) as error:
        described(wrong, "/left", mount, 12.0, 0.03, GIVEN)
    assert "\n" not in str(error.value)
