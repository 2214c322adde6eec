import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.robot.contacts import ContactModel
from cohelm.robot.limits import Limits, unlimited
from cohelm.robot.model import SHIPPED, RobotModel, doubts, shipped_path
from cohelm.robot.sensors import LidarModel


def shipped(name):
    text = Path(shipped_path(name)).read_text(encoding="utf-8")
    return RobotModel.model_validate(yaml.safe_load(text))


SQUARE = {
    "name": "box", "footprint_m": [[1, 1], [-1, 1], [-1, -1], [1, -1]], "track_m": 0.5,
    "wheel_radius_m": 0.1,
}  # fmt: skip


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_robot_has_its_name_and_the_sources_of_its_numbers(name):
    model = shipped(name)
    assert model.name == name
    assert len(model.note) > 40


def test_sally_is_the_robot_of_the_paper():
    sally = shipped("sally")
    assert np.ptp(sally.outline, axis=0) == pytest.approx([0.72, 0.58])
    assert (sally.track_m, sally.wheel_radius_m) == (0.5, 0.075)
    assert sally.reach == pytest.approx(math.hypot(0.36, 0.29))


def test_jackal_is_the_robot_of_the_barn_challenge():
    jackal = shipped("jackal")
    assert np.ptp(jackal.outline, axis=0) == pytest.approx([0.42, 0.33])
    assert (jackal.track_m, jackal.wheel_radius_m) == (0.376, 0.098)
    bounds = jackal.bounds()
    assert bounds[:4] == (2.0, 20.0, 4.0, 25.0)
    assert bounds[4:] == (math.inf, math.inf, 0.376)  # nothing published for the single wheel


def test_dingo_d_turns_about_its_axle_before_the_middle_of_its_outline():
    dingo = shipped("dingo_d")
    assert np.ptp(dingo.outline, axis=0) == pytest.approx([2 * 0.275584, 2 * 0.258584], abs=2e-4)
    assert dingo.outline[:, 0].max() + dingo.axle_x_m == pytest.approx(0.275584, abs=1e-3)
    assert dingo.track_m == pytest.approx(2 * (0.2160016 + 0.01016), abs=1e-4)


def test_limits_that_are_not_enforced_are_those_of_an_ideal_unicycle():
    assert shipped("sally").bounds(enforced=False) == unlimited(0.5)


@pytest.mark.parametrize(
    ("corners", "why"),
    [
        ([[1, 1], [-1, 1], [0, 0], [-1, -1], [1, -1]], "convex"),  # a dent
        ([[1, 1], [-1, -1], [-1, 1], [1, -1]], "convex"),  # a bow tie
        ([[1, 1], [-1, 1]], "at least 3"),
        ([[1, 1], [-1, 1], [float("nan"), -1]], "finite"),
    ],
)
def test_an_outline_that_is_not_convex_is_refused(corners, why):
    with pytest.raises(ValidationError, match=why):
        RobotModel.model_validate(SQUARE | {"footprint_m": corners})


@pytest.mark.parametrize(
    "key", [{"height_m": 1e300}, {"odometry": {"rate_hz": 1e300}}], ids=lambda key: next(iter(key))
)
def test_what_a_simulation_can_not_count_with_is_refused(key):
    with pytest.raises(ValidationError, match="less than or equal to"):
        RobotModel.model_validate(SQUARE | key)


@pytest.mark.parametrize(
    "corners",
    [
        [[1, -1], [-1, -1], [-1, 1], [1, 1]],  # clockwise
        [[1, 1], [0, 1], [-1, 1], [-1, -1], [1, -1]],  # three corners in a line
        [[1, 1], [1, 1], [-1, 1], [-1, -1], [1, -1]],  # a corner twice
    ],
)
def test_an_outline_in_another_order_or_with_corners_too_many_is_kept_as_it_must_be(corners):
    made = RobotModel.model_validate(SQUARE | {"footprint_m": corners})
    assert made.outline.tolist() == SQUARE["footprint_m"]


BEHIND_THE_AXLE = [[-0.2, 0.3], [-1.2, 0.3], [-1.2, -0.3], [-0.2, -0.3]]


@pytest.mark.parametrize("corners", [SQUARE["footprint_m"], BEHIND_THE_AXLE])
def test_an_outline_that_the_robot_reports_is_at_least_half_as_large_as_that_of_its_file(corners):
    made = RobotModel(**{**SQUARE, "footprint_m": corners})
    outline, middle = made.outline, made.least_outline.mean(axis=0)
    for share in (0.51, 1.0, 3.0):
        smaller = middle + share * (outline - outline.mean(axis=0))
        assert made.checked_outline(smaller[::-1]).shape == outline.shape
    for share in (0.001, 0.49):
        with pytest.raises(CohelmError, match="give the bare robot as least_footprint_m"):
            made.checked_outline(middle + share * (outline - outline.mean(axis=0)))


def test_how_small_an_outline_may_be_can_be_given():
    bare = [[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]
    made = RobotModel(**{**SQUARE, "least_footprint_m": bare[::-1]})
    assert made.checked_outline(bare).tolist() == bare
    with pytest.raises(CohelmError, match="leaves out"):
        made.checked_outline(0.9 * np.array(bare))
    for wrong in ([[9.0, x] for x in (0.0, 0.1, 0.3)], [[9.0, 0.0], [9.2, 0.1], [9.0, 0.3]]):
        with pytest.raises(ValidationError, match=r"line|must lie within footprint_m"):
            RobotModel(**{**SQUARE, "least_footprint_m": wrong})


def test_an_outline_that_goes_round_twice_is_refused():
    """Every corner of a pentagram turns left, and yet it is no convex outline."""
    star = [[math.cos(a), math.sin(a)] for a in 4 * math.pi / 5 * np.arange(5)]
    with pytest.raises(ValidationError, match="convex"):
        RobotModel.model_validate(SQUARE | {"footprint_m": star})


@pytest.mark.parametrize("key", ["track_m", "wheel_radius_m"])
@pytest.mark.parametrize("value", [0.0, -0.1, math.inf, math.nan])
def test_sizes_are_positive_numbers(key, value):
    with pytest.raises(ValidationError, match=key):
        RobotModel.model_validate(SQUARE | {key: value})


@pytest.mark.parametrize("key", ["speed_mps", "wheel_acceleration_mps2"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_limit_is_a_positive_number(key, value):
    with pytest.raises(ValidationError, match=key):
        RobotModel.model_validate(SQUARE | {"limits": {key: value}})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("speed_mps", 1000.0), ("acceleration_mps2", 1500.0), ("wheel_acceleration_mps2", 1500.0),
        ("yaw_rate_radps", 90.0), ("yaw_acceleration_radps2", 180.0),
    ],
)  # fmt: skip
def test_a_limit_in_millimetres_or_degrees_is_refused(key, value):
    """With brakes that the robot does not have, the filter would stop too late."""
    with pytest.raises(ValidationError, match=key):
        RobotModel.model_validate(SQUARE | {"limits": {key: value}})


@pytest.mark.parametrize(("key", "value"), [("track_m", 500.0), ("wheel_radius_m", 75.0)])
def test_wheels_in_millimetres_are_refused(key, value):
    with pytest.raises(ValidationError, match=key):
        RobotModel.model_validate(SQUARE | {key: value})


def scaled(by: float) -> list[list[float]]:
    return [[by * x, by * y] for x, y in SQUARE["footprint_m"]]


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"name": ""}, "name: .* must not be empty"),
        ({"name": " "}, "name: .* must not be empty"),
        ({"footprint_m": scaled(40.0)}, r"got one 40 m away: .* centimetres by 100"),
        ({"footprint_m": scaled(16.0)}, "32 m wide, and its wheels are 0.5 m apart"),
        ({"track_m": 16.0}, r"track_m is in metres; 16 m is far wider than footprint_m, 2 m"),
        ({"wheel_radius_m": 3.3}, r"wheel_radius_m is in metres; 3.3 m is larger than the robot"),
        ({"limits": {"speed_mps": 50.0}}, "speed_mps"),
        ({"limits": {"wheel_speed_mps": 50.0}}, "wheel_speed_mps"),
        ({"height_m": 55.0}, "height_m"),
        ({"mass_kg": 1e9}, "mass_kg"),
        ({"lidar": {"mount_z_m": 200.0}}, r"mount_z_m is in metres; 200 m is far above the robot"),
        ({"lidar": {"mount_z_m": 20.0}}, r"mount_z_m is in metres; 20 m is far above the robot"),
        ({"lidar": {"mount_z_m": -20.0}}, r"mount_z_m is in metres; -20 m is far below the robot"),
        ({"lidar": {"range_max_m": 1000.0}}, r"range_max_m is in metres; 1000 looks like milli"),
        ({"lidar": {"rate_hz": 5000.0}}, "rate_hz"),
        ({"camera": {"mount_z_m": 30.0}}, r"camera: mount_z_m .* 30 m is far above the robot"),
        ({"camera": {"rate_hz": 5000.0}}, "rate_hz"),
    ],
)
def test_a_robot_in_centimetres_or_that_no_robot_is_like_is_refused(keys, why):
    """What is in centimetres is too small for the bounds of what is in millimetres."""
    with pytest.raises(ValidationError) as refused:
        RobotModel.model_validate(SQUARE | keys)
    said = "; ".join(
        f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in refused.value.errors()
    )
    assert re.search(why, said), said


@pytest.mark.parametrize(
    "keys",
    [
        {"track_m": 3.75},  # of one that skids, as its controller counts
        {"footprint_m": scaled(4.0)},
        {"footprint_m": scaled(0.05), "track_m": 0.06, "wheel_radius_m": 0.02},
        {"limits": {"speed_mps": 15.0}},
        {"height_m": 8.0, "lidar": {"mount_z_m": 8.5, "range_max_m": 500.0}},  # on a tall one
        {"lidar": {"mount_z_m": 4.0}},  # on a mast
        {"lidar": {"mount_z_m": -0.3}},  # of one whose origin is not on the floor
    ],
    ids=str,
)
def test_an_unusual_robot_is_taken(keys):
    assert RobotModel.model_validate(SQUARE | keys).name == "box"


def test_a_robot_made_of_numbers_without_a_track_has_its_wheels_within_its_outline():
    limits = Limits(1.0, 2.0, 2.0, 6.0)
    assert RobotModel.of("tiny", scaled(0.05), limits).track_m == pytest.approx(0.1)
    assert RobotModel.of("box", scaled(0.05), limits._replace(track=0.08)).track_m == 0.08


NOISY = {"lidar": {"noise_m": 0.02}, "delay_s": 0.1, "limits": {"wheel_acceleration_mps2": 2.0}}


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({}, ""),
        ({"delay_s": 0.0}, "its file has no delay_s, which every robot has: measure it"),
        ({"lidar": {}}, "its file has no noise_m: that a scan repeats is not noticed"),
        (
            {"further_lidars": [{"name": "rear"}]},
            "rear LiDAR: its file has no noise_m",
        ),
        ({"further_lidars": [{"name": "sonar", "range_sensor": True, "field_of_view_deg": 9}]}, ""),
        (
            {"track_m": 2.4},
            "its wheels, track_m 2.4 m apart, stand out of its footprint_m, 2 m wide",
        ),
        (
            {"limits": {"acceleration_mps2": 20.0, "yaw_acceleration_radps2": 9.0}},
            "it brakes with 20 m/s^2 by its file, and no wheels do with more than some 10",
        ),
    ],
)
def test_what_is_doubtful_in_the_file_of_a_real_robot_is_said_in_a_sentence(keys, why):
    said = doubts(RobotModel.model_validate(SQUARE | NOISY | keys))
    assert [one[: len(why)] for one in said] == ([why] if why else [])


def test_an_unknown_key_is_refused():
    with pytest.raises(ValidationError, match="wheel_base_m"):
        RobotModel.model_validate(SQUARE | {"wheel_base_m": 0.5})


def test_sally_rear_is_sally_with_a_second_lidar_behind():
    sally, rear = shipped("sally"), shipped("sally-rear")
    assert rear.model_copy(
        update={"name": "sally", "lidar": sally.lidar, "further_lidars": (), "note": sally.note}
    ) == sally  # fmt: skip
    front, behind = rear.lidars
    assert front.model_copy(update={"name": ""}) == sally.lidar
    assert (behind.name, behind.mount_x_m, behind.mount_yaw_deg) == ("rear", -0.30, 180.0)
    assert sally.lidars == (sally.lidar,)
    assert RobotModel.model_validate(SQUARE).lidars == ()


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"further_lidars": [{"name": "rear"}]}, "need a lidar"),
        ({"lidar": {}, "further_lidars": [{}]}, "a name of its own"),
        ({"lidar": {"name": "a"}, "further_lidars": [{"name": "a"}]}, "a name of its own"),
        ({"lidar": {}, "further_lidars": [{"name": "b"}, {"name": "b"}]}, "a name of its own"),
        ({"lidar": {"name": "Front left"}}, "pattern"),
        ({"lidar": {"timeout_s": 0.0}}, "greater than 0"),
    ],
)
def test_further_lidars_that_can_not_be_told_apart_are_refused(keys, why):
    with pytest.raises(ValidationError, match=why):
        RobotModel.model_validate(SQUARE | keys)


@pytest.mark.parametrize(
    ("lidar", "why"),
    [
        ({"field_of_view_deg": 4.712}, r"is in degrees; 4.712 looks like radians \(270 deg\)"),
        (
            {"range_max_m": 30000},
            r"in metres; 30000 looks like millimetres \(30 m\)",
        ),
        ({"range_min_m": 60, "range_max_m": 100}, "range_min_m is in metres"),
        ({"noise_m": 10}, "noise_m is in metres"),
        ({"rate_hz": 0.05}, "one every 20 s is too seldom to drive by"),
        ({"mount_x_m": 300}, "300 m is outside of the robot"),
        ({"mount_y_m": -150}, "150 m is outside of the robot"),
        ({"mount_yaw_deg": 3.1416}, r"is in degrees; 3.1416 looks like radians \(180 deg\)"),
        ({"mount_yaw_deg": -1.57}, r"is in degrees; -1.57 looks like radians \(-90 deg\)"),
        ({"mount_yaw_deg": 1.5707}, r"is in degrees; 1.5707 looks like radians \(90 deg\)"),
        ({"mount_yaw_deg": math.pi / 2}, r"is in degrees; 1.5708 looks like radians"),
        ({"height_band_m": [100, 1200]}, r"height_band_m is in metres; 1200 looks like milli"),
        ({"timeout_s": 500}, "less than or equal to 5"),
    ],
)
def test_a_lidar_in_wrong_units_is_refused_with_the_unit(lidar, why):
    with pytest.raises(ValidationError, match=why):
        RobotModel.model_validate(SQUARE | {"lidar": lidar})


def test_numbers_that_make_no_robot_are_one_sentence():
    limits = Limits(1.0, acceleration=1.0, yaw_rate=1.0, yaw_acceleration=1.0)
    corners = [[0.5, 0.3], [-0.5, 0.3], [-0.5, -0.3], [0.5, -0.3]]
    with pytest.raises(CohelmError) as error:
        RobotModel.of("cart", corners, limits, lidar=LidarModel(mount_x_m=300.0))
    assert str(error.value) == (
        "mount_x_m and mount_y_m are in metres, from the middle of the axle; 300 m is outside of "
        "the robot"
    )
    with pytest.raises(CohelmError, match=r"^delay_s: .* less than or equal to 1, got 50$"):
        RobotModel.of("cart", corners, limits, delay=50)


@pytest.mark.parametrize("yaw", [3.1, 1.5, 90.0, 180.0, -1.6, 1.5703125, 3.1402])
def test_a_lidar_that_is_turned_a_little_is_not_in_radians(yaw):
    model = RobotModel.model_validate(SQUARE | {"lidar": {"mount_yaw_deg": yaw}})
    assert model.lidar.mount_yaw_deg == yaw


@pytest.mark.parametrize("rate", [0.02, 0.5])
def test_odometry_of_which_the_period_is_given_is_refused(rate):
    """The gate would take readings of a minute ago."""
    with pytest.raises(ValidationError, match="greater than or equal to 1"):
        RobotModel.model_validate(SQUARE | {"odometry": {"rate_hz": rate}})


def test_an_outline_that_was_divided_by_a_thousand_twice_is_refused():
    tiny = [[x / 1000.0, y / 1000.0] for x, y in SQUARE["footprint_m"]]
    with pytest.raises(ValidationError, match=r"this outline is 0\.002 m long"):
        RobotModel.model_validate(SQUARE | {"footprint_m": tiny})


SONAR = {"name": "sonar", "range_sensor": True, "field_of_view_deg": 30}


def test_a_range_sensor_has_as_many_beams_as_its_cone_needs():
    given = {"lidar": {}, "further_lidars": [SONAR, SONAR | {"name": "ir", "beams": 7}]}
    _, sonar, infrared = RobotModel.model_validate(SQUARE | given).lidars
    assert (sonar.beams, infrared.beams) == (16, 7)
    fixed = SONAR | {"range_min_m": 0.3, "range_max_m": 0.3}
    assert RobotModel.model_validate(SQUARE | {"lidar": {}, "further_lidars": [fixed]})


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"field_of_view_deg": None}, "needs a field_of_view_deg of up to 180"),
        ({"field_of_view_deg": 270}, "needs a field_of_view_deg of up to 180"),
        ({"height_band_m": [0.1, 1.0]}, "range_sensor has no height_band_m"),
        ({"range_min_m": 2.0, "range_max_m": 1.0}, "range_min_m must be smaller"),
        ({"range_sensor": False, "range_min_m": 1.0, "range_max_m": 1.0}, "must be smaller"),
        ({"forget_s": -1.0}, "greater than or equal to 0"),
        ({"range_sensor": "sonar"}, "valid boolean"),
    ],
)
def test_a_range_sensor_that_is_none_is_refused(keys, why):
    with pytest.raises(ValidationError, match=why):
        RobotModel.model_validate(SQUARE | {"lidar": {}, "further_lidars": [SONAR | keys]})


def test_the_first_lidar_is_no_range_sensor():
    with pytest.raises(ValidationError, match="can not be a range_sensor"):
        RobotModel.model_validate(SQUARE | {"lidar": SONAR})


BUMPER = {"name": "front", "mount_x_m": 0.3}


def test_bumpers_and_cliff_sensors_are_described_with_their_place_and_side():
    cliff = {"name": "drop", "mount_x_m": 0.2, "floor_m": 0.04}
    model = RobotModel.model_validate(SQUARE | {"bumpers": [BUMPER], "cliff_sensors": [cliff]})
    assert [one.label for one in model.contacts] == ["front bumper", "drop cliff sensor"]
    left, right = ContactModel(name="a", mount_x_m=0.2, mount_yaw_deg=90, width_m=0.1).ends()
    assert (*left, *right) == pytest.approx((0.15, 0.0, 0.25, 0.0))


@pytest.mark.parametrize(
    ("x", "y", "yaw"),
    [
        (0.3, 0.0, 0.0), (-0.3, 0.0, 180.0), (0.0, 0.3, 90.0), (0.3, 0.3, 45.0), (0.0, 0.0, 0.0),
        (-0.4, 0.2, 0.0), (1.6, 0.0, 0.0), (0.0, 1.6, 0.0), (-0.9, -0.9, -135.0), (1.0, 1.0, 0.0),
    ],
)  # fmt: skip
def test_a_bumper_that_does_not_face_into_the_robot_is_taken(x, y, yaw):
    one = BUMPER | {"mount_x_m": x, "mount_y_m": y, "mount_yaw_deg": yaw}
    assert len(RobotModel.model_validate(SQUARE | {"bumpers": [one]}).contacts) == 1


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"bumpers": [BUMPER], "cliff_sensors": [BUMPER]}, "a name of its own"),
        ({"bumpers": [{"mount_x_m": 0.3}]}, "name"),
        ({"bumpers": [BUMPER | {"mount_x_m": 300}]}, "front bumper: mount_x_m .* are in metres"),
        ({"bumpers": [{"name": "front"}]}, "mount_x_m"),
        ({"bumpers": [BUMPER | {"name": "Front"}]}, "pattern"),
        ({"bumpers": [BUMPER | {"timeout_s": 0}]}, "greater than 0"),
        ({"bumpers": [BUMPER | {"width_m": -0.1}]}, "greater than or equal to 0"),
        ({"bumpers": [BUMPER | {"floor_m": 0.1}]}, "floor_m"),
        ({"bumpers": [BUMPER | {"mount_x_m": float("nan")}]}, "finite"),
        ({"bumpers": [BUMPER | {"timeout_s": 500}]}, "less than or equal to 5"),
        ({"bumpers": [BUMPER | {"width_m": 500}]}, "less than or equal to 20"),
        (
            {"bumpers": [BUMPER | {"mount_x_m": 0.9, "mount_yaw_deg": 180}]},
            "front bumper: it faces into the robot",
        ),
        (
            {"bumpers": [BUMPER | {"mount_x_m": -0.9}]},
            r"mount_yaw_deg is .* outwards \(180 is behind",
        ),
        ({"cliff_sensors": [BUMPER | {"mount_x_m": -1.1}]}, "front cliff sensor: it faces into"),
        ({"cliff_sensors": [BUMPER | {"floor_m": 40}]}, "less than or equal to 2"),
        ({"cliff_sensors": [BUMPER | {"drop_m": 30}]}, "less than or equal to 1"),
        ({"cliff_sensors": [BUMPER | {"drop_m": 0}]}, "greater than 0"),
        ({"cliff_sensors": [BUMPER | {"hazard": "cliff", "floor_m": 0.1}]}, "hazard or floor_m"),
    ],
)
def test_bumpers_and_cliff_sensors_that_are_none_are_refused(keys, why):
    with pytest.raises(ValidationError, match=why):
        RobotModel.model_validate(SQUARE | keys)
