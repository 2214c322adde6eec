"""What is said of an assumption, and what is written in its place."""

import json
import math

import numpy as np
import pytest

from cohelm.calibrate.interval import half_widths
from cohelm.calibrate.mount import MeasuredMount
from cohelm.calibrate.response import AxisResponse, Measured, Response
from cohelm.calibrate.verdict import as_dict, earlier_run, findings, with_load
from cohelm.core.errors import CohelmError
from cohelm.robot.model import LimitsModel
from cohelm.scenario.load import load_robot

SALLY = load_robot("sally")  # 0.05 s, 1 m/s, 2 rad/s, 2 m/s^2 at the rim, track 0.5 m
NONE = np.empty(0)


def channel(total, rise, brake, speed, gain=1.0, off=0.01):
    return AxisResponse(
        Measured(0.0, 0.001), Measured(total, 0.001), Measured(rise, off), Measured(brake, off),
        Measured(gain, 0.001), speed, speed, 0.001, NONE, NONE, NONE,
    )  # fmt: skip


def answered(total=0.05, rise=2.0, brake=2.0, speed=1.0, turn_gain=1.0, off=0.01, turns=0.0):
    return Response(
        Measured(total, 0.001), channel(total, rise, brake, speed, off=off),
        channel(turns or total, 8.0, 8.0, 2.0, turn_gain, off),
    )  # fmt: skip


def placed(x=0.30, way=1.0, heading=1.0):
    return MeasuredMount(Measured(x, 0.001), Measured(0.0, 0.001), Measured(0.0, 0.001),
                 Measured(way, 0.0), Measured(heading, 0.0), NONE, 0.02)  # fmt: skip


def said(key, *args, model=SALLY, **more):
    one = {f.key: f for f in findings(model, *args, **more)}[key]
    return one.verdict, one.write


RIM = "limits.wheel_acceleration_mps2"


def test_a_robot_that_matches_its_file_is_safe_and_its_file_unchanged():
    found = findings(SALLY, answered(), placed())
    assert {one.verdict for one in found} == {"safe"}
    assert all(one.write == one.assumed for one in found)
    assert len(found) == 10


def test_a_late_robot_is_unsafe_and_an_early_one_wasteful():
    assert said("delay_s", answered(total=0.08), placed()) == ("unsafe", 0.081)
    assert said("delay_s", answered(total=0.02), placed()) == ("wasteful", 0.021)


@pytest.mark.parametrize(
    ("total", "off", "write"), [(0.12, 0.008, 0.128), (0.03, 0.0, 0.03), (0.9, 0.3, 1.0)]
)
def test_the_late_end_of_the_delays_interval_is_written(total, off, write):
    """As no robot may be later than that, and a file takes no more than a second."""
    late = answered()
    late = late._replace(straight=late.straight._replace(total=Measured(total, off)))
    late = late._replace(turn=late.straight)
    assert said("delay_s", late, placed())[1] == pytest.approx(write)


def test_a_robot_that_answers_later_in_turns_is_as_late_as_those():
    assert said("delay_s", answered(turns=0.09), placed()) == ("unsafe", 0.091)
    assert said("delay_s", answered(turns=0.02), placed()) == ("safe", 0.05)


def test_a_lag_that_the_loop_adds_by_itself_is_not_written_twice():
    assert said("delay_s", answered(total=0.07), placed(), added=0.02) == ("safe", 0.05)
    assert said("delay_s", answered(total=0.10), placed(), added=0.02) == ("unsafe", 0.081)


@pytest.mark.parametrize(("rise", "brake"), [(2.0, 1.5), (1.5, 2.0), (1.5, 9.0)])
def test_a_robot_that_does_less_is_unsafe_and_the_end_of_the_interval_is_written(rise, brake):
    verdict, write = said(RIM, answered(rise=rise, brake=brake), placed())
    assert verdict == "unsafe"
    assert write == pytest.approx(1.49)


def test_a_limit_is_never_raised():
    assert said(RIM, answered(brake=9.0), placed()) == ("safe", 2.0)  # turns brake with 2
    straight = SALLY.model_copy(update={"limits": LimitsModel(acceleration_mps2=2.0)})
    key = "limits.acceleration_mps2"
    assert said(key, answered(brake=9.0), placed(), model=straight) == ("wasteful", 2.0)


@pytest.mark.parametrize(
    ("off", "expected"), [(0.1, ("safe", 2.0)), (0.5, ("unsure", 1.47)), (3.0, ("unsure", 0.985))]
)
def test_a_limit_in_a_wide_interval_is_not_safe_and_its_low_end_is_written(off, expected):
    """That it may be as assumed says nothing of what it may be."""
    straight = SALLY.model_copy(update={"limits": LimitsModel(acceleration_mps2=2.0)})
    (one,) = (
        one
        for one in findings(straight, answered(rise=1.97, off=off), placed())
        if one.key == "limits.acceleration_mps2"
    )
    assert (one.verdict, one.write) == expected
    if one.verdict == "unsure":
        assert one.why == f"it may be only {one.write:g}: drive it again, with more --floor"
        assert one.measured.value == 1.97


def test_a_delay_in_a_wide_interval_is_not_safe_and_its_late_end_is_written():
    assert said("delay_s", wide(0.05, 0.015), placed()) == ("safe", 0.05)
    assert said("delay_s", wide(0.05, 0.03), placed()) == ("unsure", 0.08)
    assert said("delay_s", wide(0.02, 0.2), placed()) == ("unsure", 0.22)
    (one, *_) = findings(SALLY, wide(0.05, 0.03), placed())
    assert one.why == "it may obey 30 ms later: drive it again, with more --floor"


def wide(total, off):
    made = answered()
    made = made._replace(straight=made.straight._replace(total=Measured(total, off)))
    return made._replace(turn=made.straight)


def test_a_mount_that_is_hardly_known_is_not_safe_and_stays():
    far = placed()._replace(x=Measured(0.31, 0.05))
    assert said("lidar.mount_x_m", answered(), far) == ("unsure", 0.3)


def test_an_uncertain_value_does_not_make_a_limit_of_zero():
    verdict, write = said(RIM, answered(brake=0.5, off=0.9), placed())
    assert verdict == "unsafe"
    assert write == pytest.approx(0.25)


def test_a_missing_limit_is_written_as_it_was_seen():
    bare = SALLY.model_copy(update={"limits": LimitsModel(speed_mps=1.0)})
    key = "limits.acceleration_mps2"
    assert said(key, answered(rise=3.0, brake=2.5), placed(), model=bare) == ("unsafe", 2.49)


def test_a_speed_that_is_not_reached_is_unsafe_and_one_beyond_is_not_written():
    assert said("limits.speed_mps", answered(speed=0.99), placed()) == ("safe", 1.0)
    asked = answered()
    slow = asked._replace(straight=asked.straight._replace(speed=0.8))
    fast = asked._replace(straight=asked.straight._replace(speed=1.2))
    assert said("limits.speed_mps", slow, placed()) == ("unsafe", 0.8)
    assert said("limits.speed_mps", fast, placed()) == ("unsafe", 1.0)


def test_the_track_width_follows_from_commands_whichever_sensor_gives_the_heading():
    # 4 % farther apart than assumed: wheels' odometry turns as commanded and is wrong by 4 %, a
    # gyro's is right
    by_wheels = said("track_m", answered(), placed(heading=1.0 / 1.04))
    by_gyro = said("track_m", answered(turn_gain=1.0 / 1.04), placed())
    assert by_wheels == by_gyro == ("unsafe", 0.52)


def test_without_scans_only_odometry_faults_are_reported():
    keys = {one.key for one in findings(SALLY, answered(), None)}
    assert keys == {"delay_s", RIM, "limits.speed_mps", "limits.yaw_rate_radps"}


def test_with_a_load_the_worse_of_both_counts_and_the_rest_stays(tmp_path):
    empty = as_dict(findings(SALLY, answered(total=0.09), placed(x=0.35)))
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps({"robot": "sally", "findings": empty, "odometry": {}}))
    earlier, _ = earlier_run(file, "sally")
    both = with_load(findings(SALLY, answered(brake=1.2), placed()), earlier)
    write = {one.key: one.write for one in both}
    assert (write["delay_s"], write["lidar.mount_x_m"]) == (0.091, 0.35)
    assert write[RIM] == pytest.approx(1.19)
    alone = with_load(findings(SALLY, answered(brake=1.2), None), earlier)
    assert {one.key for one in alone} == set(empty)


@pytest.mark.parametrize("text", [
    None, "", "[]", '{"robot": "husky", "findings": {}}',
    '{"robot": "sally", "findings": [], "odometry": {}}',
    '{"robot": "sally", "findings": {"delay_s": {}}, "odometry": {}}',
    '{"robot": "sally", "findings": {}, "odometry": {"odometry.slip": "small"}}',
])  # fmt: skip
def test_a_load_without_a_run_before_is_refused(tmp_path, text):
    if text is not None:
        (tmp_path / "run").write_text(text)
    with pytest.raises(CohelmError, match="--load needs a run"):
        earlier_run(tmp_path / "run", "sally")


def test_a_load_after_a_run_of_another_robot_is_refused(tmp_path):
    (tmp_path / "run").write_text('{"robot": "husky", "findings": {}, "odometry": {}}')
    with pytest.raises(CohelmError, match="of husky, not of sally"):
        earlier_run(tmp_path / "run", "sally")


def test_an_interval_holds_what_it_promises_where_errors_come_in_lumps():
    """A mean of 20 lumps of 10 equal errors: 95 % of the intervals hold the truth, 0 here. The
    usual formula, which takes them for 200 new draws, holds it in less than half of all cases."""
    random = np.random.default_rng(5)
    lump, ones = np.arange(20).repeat(10), np.ones((200, 1))
    held = usual = 0
    for _ in range(400):
        errors = random.normal(size=20).repeat(10)
        mean = errors.mean()
        left = errors - mean
        held += abs(mean) < half_widths(ones, left, lump, np.eye(1))[0]
        usual += abs(mean) < 1.96 * left.std() / math.sqrt(200)
    assert 0.92 < held / 400 < 0.98
    assert usual / 400 < 0.6
