"""The paper's experiments on the reconstructed lab, to an independent simulation's numbers."""

import numpy as np
import pytest

from cohelm.law.gains import Gains
from cohelm.sim.run import run
from tests.oracle import lab, paper
from tests.sim.runs import lab_run


@pytest.fixture(scope="module")
def tracking():
    return run(lab_run(None))


def least(trace):
    return dict(zip(trace.names, trace.h.min(axis=0), strict=True))


def test_tracking_alone_stays_within_three_centimetres(tracking):
    """Figs. 6 and 7."""
    assert tracking.rows["e_p"].max() <= 0.03
    assert tracking.rows["e_p"].max() == pytest.approx(0.0242, abs=2e-3)
    assert tracking.rows["e_p"][-1] <= 1e-3
    assert tracking.rows["t"][-1] == pytest.approx(58.74, abs=1e-9)


def test_without_the_barrier_the_robot_drives_straight_through_the_obstacles(tracking):
    """Fig. 9: h = −r² is the centre itself."""
    h = least(tracking)
    for cone in ("cone_1", "cone_2", "cone_3"):
        assert h[cone] == pytest.approx(-0.04, abs=1e-3)
    assert h["mover"] < 0.0


def test_with_the_barrier_every_obstacle_is_passed_outside_its_safe_circle():
    """Figs. 8 and 9, and E3: k_cbf = 1.5."""
    trace = run(lab_run(1.5))
    h = least(trace)
    assert min(h.values()) >= 0.14
    told = {"cone_1": 0.16, "cone_2": 0.15, "cone_3": 0.20, "mover": 0.26}
    assert h == pytest.approx(told, abs=0.006)
    assert np.abs(trace.rows["safe_v"]).max() == pytest.approx(0.77, abs=0.02)
    assert np.abs(trace.rows["safe_omega"]).max() == pytest.approx(1.4, abs=0.05)
    assert trace.rows["e_p"].max() == pytest.approx(1.0, abs=0.05)
    assert trace.rows["e_p"][-1] < 0.03  # back on the path


def test_with_less_steering_the_mover_is_met_barely_outside_its_circle():
    """E3: k_cbf = 1."""
    trace = run(lab_run(1.0))
    told = {"cone_1": 0.16, "cone_2": 0.145, "cone_3": 0.15, "mover": 0.02}
    assert least(trace) == pytest.approx(told, abs=0.01)
    assert np.abs(trace.rows["safe_v"]).max() == pytest.approx(2.2, abs=0.1)


def test_with_a_small_k_cbf_the_robot_is_held_and_then_commanded_metres_per_second():
    """E3, E5: k_cbf = 0.25; the reference runs up to 5 m ahead."""
    trace = run(lab_run(0.25))
    assert 0.0 < min(least(trace).values()) < 0.002
    assert np.abs(trace.rows["safe_v"]).max() > 4.0
    assert trace.rows["e_p"].max() > 4.0


def test_the_obstacles_are_passed_on_their_right():
    """Fig. 8: the robot heads north past (0, 1), and yaw is positive to the left (E1)."""
    trace = run(lab_run(1.5))
    north = trace.rows[(trace.rows["t"] < 15.0) & (np.abs(trace.rows["y"] - 1.0) < 0.02)]
    assert (north["x"] > 0.3).all()


def test_the_printed_sign_of_the_moving_obstacle_term_costs_clearance_at_the_mover():
    """E2: it takes an approaching obstacle for a receding one."""
    true = least(run(lab_run(1.5)))
    printed = least(run(lab_run(gains=Gains(true_sign=False))))
    for cone in ("cone_1", "cone_2"):
        assert printed[cone] == pytest.approx(true[cone], abs=1e-9)  # nothing has moved yet
    assert printed["mover"] < true["mover"] - 0.05


@pytest.fixture(scope="module")
def continuous():
    """The twin: tracking in continuous time, RK4 at 1 ms."""
    spline = paper.Spline(lab.WAYPOINTS, lab.SPEED)
    return paper.closed_loop(np.array(lab.START), spline, lab.SPEED, paper.Parameters())[1]


@pytest.mark.parametrize("dt", [0.02, 0.01, 0.002, 0.001])
def test_the_closed_loop_approaches_the_continuous_one_with_the_control_period(continuous, dt):
    """A command held for dt lags by half of it: 0.08 m and 0.14 rad per second of period."""
    rows = run(lab_run(None, dt=dt)).rows
    k = np.round(rows["t"] / 1e-3).astype(int)
    k = k[k < len(continuous)]
    assert len(k) > 0.99 * len(rows)
    off = [
        np.abs(rows[c][: len(k)] - continuous[k, i]).max() for i, c in enumerate(("x", "y", "psi"))
    ]
    assert off[0] < 0.1 * dt
    assert off[1] < 0.1 * dt
    assert off[2] < 0.17 * dt
    assert max(off) > 0.03 * dt  # the lag is real, and shrinks in proportion


@pytest.mark.parametrize("k_cbf", [None, 1.5])
def test_every_recorded_command_is_the_twins_for_the_recorded_state(k_cbf):
    trace = run(lab_run(k_cbf))
    p = paper.Parameters(barrier=k_cbf is not None)
    for row, discs in list(zip(trace.rows, trace.discs, strict=True))[::37]:
        eta = np.array([row["x"], row["y"], row["psi"]])
        goal = paper.Goal(*(float(row[c]) for c in ("x_d", "y_d", "psi_d", "u_d", "r_d")))
        stick = np.array([row["stick_x"], row["stick_psi"]])
        told = paper.step(eta, goal, lab.SPEED, stick, discs[:, [0, 1, 2, 3, 5]], p)
        assert (row["safe_v"], row["safe_omega"]) == pytest.approx(
            tuple(told.U), rel=1e-8, abs=1e-9
        )
        assert row["e_p"] == pytest.approx(paper.pose_error(eta, goal), abs=1e-9)
