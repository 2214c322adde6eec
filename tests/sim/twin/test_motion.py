"""What is asked is reached, and what differs from the kinematic simulator stays as documented."""

import math

import numpy as np
import pytest

from cohelm.core.types import Twist
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.sim.twin.settings import TwinModel
from tests.sim.twin.drives import brake, drive, sally

ROVER = {
    "name": "rover", "track_m": 0.3, "wheel_radius_m": 0.1, "mass_kg": 12.0,
    "footprint_m": [[0.4, 0.0], [0.2, 0.2], [-0.1, 0.2], [-0.1, -0.2], [0.2, -0.2]],
}  # fmt: skip


@pytest.mark.parametrize("twist", [(1.0, 0.0), (-0.5, 0.0), (0.0, 1.0), (0.0, -1.9), (0.4, 0.8)])
def test_a_commanded_speed_is_reached_within_one_percent(twist):
    asked = Twist(*twist)
    robot = Twin(sally())
    drive(robot, asked, 1.5)
    seen = drive(robot, asked, 1.0)
    assert np.mean([t.twist.v for t in seen]) == pytest.approx(asked.v, rel=0.01, abs=1e-3)
    assert np.mean([t.twist.omega for t in seen]) == pytest.approx(asked.omega, rel=0.01, abs=1e-3)


def test_a_robot_of_another_shape_does_so_too():
    seen = drive(Twin(sally(**ROVER)), Twist(0.8, 0.5), 2.0)[-1]
    assert seen.twist.v == pytest.approx(0.8, rel=0.01)
    assert seen.twist.omega == pytest.approx(0.5, rel=0.01)


def test_a_circle_closes_where_it_began():
    robot = Twin(sally())
    start = drive(robot, Twist(0.4, 0.5), 2.0)[-1].pose
    end = drive(robot, Twist(0.4, 0.5), 2.0 * math.pi / 0.5)[-1].pose
    assert math.hypot(end.x - start.x, end.y - start.y) < 0.08  # of 5.03 m


def test_braking_takes_no_more_than_the_lag_longer_than_the_kinematic_simulator():
    ways = []
    for robot in (Twin(sally()), Kinematic(sally())):
        start = drive(robot, Twist(0.8, 0.0), 2.0)[-1].pose.x
        ways.append(brake(robot).pose.x - start)
    assert 0.0 <= ways[0] - ways[1] <= 0.8 * TwinModel().wheel_lag_s + 0.005


def test_on_ice_the_robot_needs_longer_to_stop():
    ways = []
    for friction in (0.8, 0.1):
        robot = Twin(sally(), settings=TwinModel(friction=friction))
        start = drive(robot, Twist(0.8, 0.0), 3.0)[-1].pose.x
        ways.append(brake(robot, 3.0).pose.x - start)
    assert ways[1] > 1.3 * ways[0]


def test_the_encoders_do_not_notice_that_the_wheels_slip():
    robot = Twin(sally(odometry={"rate_hz": 50.0}), settings=TwinModel(friction=0.05))
    truth = drive(robot, Twist(0.8, 0.0), 1.5)[-1]
    odometry = robot.read().odometry
    assert odometry is not None
    assert odometry.pose.x > 1.05 * truth.pose.x


def test_without_errors_and_slip_the_odometry_is_the_truth():
    robot = Twin(sally(odometry={"rate_hz": 50.0}))
    truth = drive(robot, Twist(0.4, 0.4), 5.0)[-1]
    odometry = robot.read().odometry
    assert odometry is not None
    assert odometry.pose == pytest.approx(truth.pose, abs=0.01)
    assert odometry.twist == pytest.approx(truth.twist, abs=0.005)


def test_equal_seeds_make_equal_runs_and_others_other_errors():
    def run(seed: int):
        robot = Twin(sally(), seed=seed)
        return drive(robot, Twist(0.5, 0.4), 1.0)[-1], robot.read()

    (truth, first), (again, second), (_, other) = run(1), run(1), run(2)
    assert truth == again
    assert first.odometry == second.odometry
    assert np.array_equal(first.scan.ranges, second.scan.ranges)
    assert first.odometry != other.odometry


def test_how_time_is_cut_makes_no_difference():
    fine, coarse = Twin(sally(), seed=4), Twin(sally(), seed=4)
    for robot, step in ((fine, 0.005), (coarse, 0.1)):
        robot.send(Twist(0.5, 0.4))
        while robot.now() < 0.4 - 1e-9:
            robot.wait(robot.now() + step)
            robot.read()
    assert fine.truth() == coarse.truth()


def test_a_push_moves_the_robot_and_nothing_notices():
    robot = Twin(sally(), seed=1)
    before, seen = drive(robot, Twist(0.4, 0.0), 1.0)[-1], robot.read().odometry
    robot.push(1.0, -2.0, 0.5)
    after = robot.truth()
    assert after.pose == pytest.approx((before.pose.x + 1.0, before.pose.y - 2.0, 0.5), abs=1e-3)
    assert robot.read().odometry == seen
    later = drive(robot, Twist(0.4, 0.0), 0.5)[-1]
    assert later.pose.psi == pytest.approx(0.5, abs=0.01)
    assert later.twist.v == pytest.approx(0.4, rel=0.01)


def test_energy_of_getting_going_is_that_of_the_motion_and_of_rolling():
    truth = drive(Twin(sally()), Twist(0.8, 0.0), 2.0)[-1]
    kinetic = 0.5 * 60.0 * truth.twist.v**2
    rolling = 0.01 * 60.0 * 9.81 * truth.pose.x
    assert truth.energy == pytest.approx(kinetic + rolling, rel=0.1)
