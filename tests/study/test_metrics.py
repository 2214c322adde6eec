"""Scores of traces made by hand, where the right answer can be counted on fingers."""

import json
import math

import numpy as np
import pytest

from cohelm.core.row import ROW
from cohelm.core.trace import Trace
from cohelm.core.types import discs
from cohelm.law.barrier import HEADING
from cohelm.law.verdict import POWERLESS, SHAPED
from cohelm.study.metrics import measure, spans, wheel_acceleration

DT = 0.1


def straight(steps=101, speed=1.0, y=0.0, **columns):
    """A robot driving along x at 1 m/s past nothing, on its reference but for what is given."""
    rows = np.zeros(steps, dtype=ROW)
    rows["t"] = DT * np.arange(steps)
    rows["x"] = rows["x_d"] = speed * rows["t"]
    rows["y"] = y
    rows["u_d"] = rows["safe_v"] = rows["applied_v"] = speed
    rows["authority_x"] = rows["authority_psi"] = 1.0
    rows["clearance"] = math.inf
    rows["e_p"] = abs(y)
    rows["rate"] = 1.0
    rows["arrived"][-1] = True
    for name, values in columns.items():
        rows[name] = values
    return rows


def trace(rows, *obstacles, names=None):
    table = np.repeat(discs(*obstacles)[None], len(rows), axis=0)
    away = np.hypot(
        rows["x"][:, None] - table[:, :, 0], rows["y"][:, None] - table[:, :, 1]
    ).reshape(len(rows), -1)
    names = names or tuple(f"disc_{i}" for i in range(len(obstacles)))
    return Trace(rows, away**2 - table[:, :, 5] ** 2, table, names, DT)


def at(x, y, safe=0.2):
    return (x, y, 0.0, 0.0, 0.1, safe)


def test_a_perfect_run_scores_perfectly():
    m = measure(trace(straight()))
    assert m.duration_s == pytest.approx(10.0)
    assert m.path_length_m == pytest.approx(10.0)
    assert m.reached
    assert not m.contact
    assert (m.max_pose_error, m.rms_pose_error, m.final_pose_error) == (0.0, 0.0, 0.0)
    assert m.human_windows_s == []
    assert m.return_s == []
    assert m.longest_stall_s == 0.0
    assert m.human_share == 0.0
    assert m.min_auto_authority == 1.0


def test_pose_errors_are_the_largest_the_root_mean_square_and_the_last():
    m = measure(trace(straight(steps=4, e_p=[0.3, 0.4, 0.0, 0.0])))
    assert m.max_pose_error == 0.4
    assert m.rms_pose_error == pytest.approx(0.25)
    assert m.final_pose_error == 0.0


def test_a_run_has_reached_its_end_where_its_last_step_has_arrived():
    passed_by = np.zeros(101, dtype=bool)
    passed_by[40] = True
    assert not measure(trace(straight(arrived=passed_by))).reached


def test_each_obstacle_has_its_smallest_h_and_its_time():
    m = measure(trace(straight(), at(3.0, 0.5), at(7.0, -1.0), names=("near", "far")))
    assert m.discs["near"].min_h == pytest.approx(0.25 - 0.04)
    assert m.discs["near"].at_s == pytest.approx(3.0)
    assert m.discs["far"].min_h == pytest.approx(1.0 - 0.04)
    assert m.discs["far"].at_s == pytest.approx(7.0)
    assert m.min_h == m.discs["near"].min_h


def test_the_side_is_the_one_the_robot_passes_on():
    past = (at(3.0, 0.5), at(5.0, -0.5), at(7.0, 0.1), at(5.0, 3.0))
    m = measure(trace(straight(), *past, names=("left_of_us", "right_of_us", "ahead", "aside")))
    assert m.discs["left_of_us"].side == "right"
    assert m.discs["right_of_us"].side == "left"
    assert m.discs["ahead"].side == "through"
    assert m.discs["aside"].side is None


def test_the_side_follows_the_heading_and_not_the_map():
    rows = straight(psi=math.pi)  # drives backwards along x
    assert measure(trace(rows, at(3.0, 0.5))).discs["disc_0"].side == "left"


@pytest.mark.parametrize(("least", "touched"), [(0.01, False), (0.0, True), (-0.2, True)])
def test_contact_is_a_footprint_gap_that_closes(least, touched):
    clearance = np.full(101, 0.5)
    clearance[40] = least
    m = measure(trace(straight(clearance=clearance)))
    assert m.contact is touched
    assert m.min_clearance_m == least
    assert m.min_clearance_at_s == pytest.approx(4.0)


def test_the_person_leads_in_the_windows_where_authority_is_below_half():
    share = np.ones(101)
    share[20:40] = 0.1
    share[70:80] = 0.49
    share[90:95] = 0.5
    m = measure(trace(straight(authority_x=share, authority_psi=share)))
    assert m.human_windows_s == [
        (pytest.approx(2.0), pytest.approx(4.0)),
        (pytest.approx(7.0), pytest.approx(8.0)),
    ]
    assert m.min_auto_authority == 0.1
    assert m.human_share == pytest.approx((20 * 0.9 + 10 * 0.51 + 5 * 0.5) / 101)


def test_leading_on_one_axis_is_leading():
    share = np.ones(101)
    share[50:60] = 0.2
    m = measure(trace(straight(authority_psi=share)))
    assert len(m.human_windows_s) == 1
    assert m.human_share == pytest.approx(0.5 * 10 * 0.8 / 101)


def test_the_return_is_timed_from_letting_go_until_back_on_the_path():
    share, error = np.ones(101), np.zeros(101)
    share[20:40] = 0.1
    error[20:65] = 1.0
    m = measure(trace(straight(authority_x=share, authority_psi=share, e_p=error)))
    assert m.return_s == [pytest.approx(2.5)]


def test_a_robot_that_never_returns_has_no_return_time_in_json():
    share, error = np.ones(101), np.full(101, 1.0)
    share[20:40] = 0.1
    m = measure(trace(straight(authority_x=share, authority_psi=share, e_p=error)))
    assert m.return_s == [math.inf]
    assert m.as_dict()["return_s"] == [None]


def test_the_longest_stall_is_the_longest_stand_while_the_reference_moves():
    speed, wanted = np.ones(101), np.ones(101)
    speed[10:20] = 0.0
    speed[30:55] = -0.01
    speed[60:] = 0.0
    wanted[60:] = 0.0  # the reference has ended: standing is right
    m = measure(trace(straight(applied_v=speed, u_d=wanted)))
    assert m.longest_stall_s == pytest.approx(2.5)


def test_filter_activity_is_split_by_its_cause():
    verdict, limiting = np.zeros(100, dtype=int), np.full(100, HEADING)
    verdict[:30] = SHAPED
    limiting[:10] = 0
    verdict[50:55] = POWERLESS
    m = measure(trace(straight(steps=100, verdict=verdict, limiting=limiting), at(3.0, 0.5)))
    assert m.filter_share == pytest.approx(0.3)
    assert m.heading_share == pytest.approx(0.2)
    assert m.powerless_share == pytest.approx(0.05)


def test_saturation_and_the_largest_command_are_what_was_asked():
    flags = np.zeros(100, dtype=bool)
    flags[:25] = True
    v, omega = np.ones(100), np.zeros(100)
    v[3], omega[5] = -4.6, -1.4
    m = measure(trace(straight(steps=100, saturated=flags, safe_v=v, safe_omega=omega)))
    assert m.saturated_share == 0.25
    assert (m.max_speed_mps, m.max_yaw_rate_radps) == (4.6, 1.4)


def test_the_jump_of_a_wheel_adds_both_axes():
    v, omega = np.ones(101), np.zeros(101)
    v[50:], omega[50:] = 1.2, -0.4
    made = trace(straight(applied_v=v, applied_omega=omega))
    assert wheel_acceleration(made, track=0.5) == pytest.approx((0.2 + 0.25 * 0.4) / DT)
    m = measure(made)
    assert m.max_acceleration_mps2 == pytest.approx(2.0)
    assert m.max_yaw_acceleration_radps2 == pytest.approx(4.0)


def test_the_passivity_minimum_is_the_least_energy():
    energy = np.linspace(0.0, 1.0, 101)
    energy[30] = -0.3
    assert measure(trace(straight(energy=energy))).min_supplied_energy == -0.3


def test_json_has_no_infinity_where_there_is_nothing_to_hit():
    text = json.dumps(measure(trace(straight())).as_dict(), allow_nan=False)
    assert json.loads(text)["min_h"] is None
    assert json.loads(text)["min_clearance_m"] is None


def test_one_step_is_a_run():
    m = measure(trace(straight(steps=1), at(3.0, 0.5)))
    assert m.duration_s == 0.0
    assert m.max_acceleration_mps2 == 0.0
    json.dumps(m.as_dict(), allow_nan=False)


def test_spans_touch_both_ends():
    assert spans(np.array([True, True, False, True])) == [(0, 2), (3, 4)]
    assert spans(np.zeros(3, dtype=bool)) == []
