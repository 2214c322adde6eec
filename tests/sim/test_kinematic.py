"""The kinematic robot beyond the port: its truth, its errors, its delay, its movers."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.law.reference import through
from cohelm.robot.clock import SteppedClock, WallClock
from cohelm.robot.sensors import OdometryModel
from cohelm.sim.kinematic import TICK, Kinematic
from cohelm.sim.odometer import Odometer
from cohelm.sim.world import Body, world
from tests.ports.adapters import room, sally


def driven(robot: Kinematic, twist: Twist, seconds: float) -> None:
    end = robot.now() + seconds
    while robot.now() < end - 1e-9:
        robot.send(twist)
        robot.wait(robot.now() + 0.02)
        robot.read()


def test_a_command_reaches_the_wheels_after_the_delay():
    robot = Kinematic(sally(), obstacles=room())
    robot.send(Twist(0.5, 0.0))
    robot.wait(sally().delay_s)
    assert robot.truth().twist.v == 0.0
    robot.wait(sally().delay_s + TICK)
    assert robot.truth().twist.v == pytest.approx(2.0 * TICK)


def test_no_command_is_late_on_a_robot_without_delay():
    at_once = sally().model_copy(update={"delay_s": 0.0})
    robot = Kinematic(at_once, obstacles=room())
    robot.wait(0.013)
    robot.send(Twist(0.5, 0.0))
    robot.wait(0.013 + 5 * TICK)
    assert robot.truth().twist.v == pytest.approx(5 * 2.0 * TICK)
    robot.stop()
    robot.wait(0.013 + 7 * TICK)
    assert robot.truth().twist.v == pytest.approx(3 * 2.0 * TICK)


def test_whole_numbers_are_numbers():
    robot, same = (Kinematic(sally(), Pose(*at), room()) for at in ((1, 2, 0), (1.0, 2.0, 0.0)))
    for one, twist in ((robot, Twist(1, 0)), (same, Twist(1.0, 0.0))):
        one.send(twist)
        one.wait(0.5)
    assert repr(robot.truth()) == repr(same.truth())


def test_the_same_seed_makes_the_same_run_to_the_last_bit():
    def run(seed: int) -> tuple:
        robot = Kinematic(sally(), obstacles=room(), seed=seed)
        driven(robot, Twist(0.3, 0.5), 2.0)
        readings = robot.read()
        return robot.truth(), readings.odometry, readings.scan.ranges.tobytes()

    assert run(1) == run(1)
    assert run(1)[1] != run(2)[1]


def test_the_sampling_of_a_mover_does_not_change_its_motion():
    often, seldom = (Kinematic(sally(), obstacles=room(), seed=5) for _ in range(2))
    for robot, step in ((often, TICK), (seldom, 0.1)):
        robot.send(Twist(0.4, 0.7))
        while robot.now() < 0.4 - 1e-9:
            robot.wait(robot.now() + step)
            robot.read()
    assert often.truth() == seldom.truth()
    assert often.read().odometry == seldom.read().odometry


def test_driving_into_a_wall_is_seen_by_the_truth():
    robot = Kinematic(sally(), Pose(5.0, 0.0, 0.0), room())
    before = robot.truth()
    assert before.clearance == pytest.approx(0.64, abs=1e-9)
    driven(robot, Twist(0.8, 0.0), 2.0)
    assert robot.truth().least_moving < 0.0


def test_walked_into_while_standing_is_not_driven_into():
    path = through(np.array([[3.0, 0.0], [0.0, 0.0]]), 1.0)
    robot = Kinematic(
        sally(), obstacles=world(([Body((3, 0, 0, 0, 0.2, 0.2), path)], np.empty((0, 4))))
    )
    robot.wait(4.0)
    truth = robot.truth()
    assert truth.least < 0.0
    assert truth.least_moving == math.inf


def test_a_push_moves_the_robot_but_not_its_odometry():
    robot = Kinematic(sally(), obstacles=room())
    robot.wait(0.1)
    before = robot.read().odometry
    robot.push(1.0, -0.5, 0.3)
    robot.wait(0.12)
    assert robot.truth().pose == pytest.approx((1.0, -0.5, 0.3))
    assert robot.read().odometry.pose == pytest.approx(before.pose, abs=1e-3)


def test_movers_are_in_the_scans():
    robot = Kinematic(
        sally(), obstacles=world(([Body((4.0, 0.0, -1.0, 0.0, 0.3, 0.2))], np.empty((0, 4))))
    )
    middle = sally().lidar.beams // 2
    robot.wait(1.0)
    assert robot.read().scan.ranges[middle] == pytest.approx(4.0 - 1.0 - 0.3 - 0.3, abs=0.1)


def test_a_robot_without_a_lidar_has_no_scan():
    robot = Kinematic(sally().model_copy(update={"lidar": None}), obstacles=room())
    robot.wait(1.0)
    assert robot.read().scan is None


def test_exact_odometry_is_the_truth():
    model = OdometryModel()
    robot = Kinematic(sally().model_copy(update={"odometry": model}), obstacles=room())
    driven(robot, Twist(0.4, 0.6), 3.0)
    pose = robot.read().odometry.pose
    # readings are arcs over 20 ms, the truth gathers speed in between
    assert pose == pytest.approx(robot.truth().pose, abs=2e-4)


def test_odometry_errors_follow_its_model():
    """500 robots drive 10 m straight: scale and slip show in the distance, the gyro in the yaw."""
    model = OdometryModel(
        distance_error=0.01, slip=0.005, gyro_drift_degps=0.05, gyro_noise_degps=0.2
    )
    ends = []
    for seed in range(500):
        odometer = Odometer(model, seed)
        for k in range(200):
            last = odometer.reading(0.1 * (k + 1), 0.1, 0.05, 0.05, 0.0)
        ends.append((last.pose.x, last.pose.psi))
    x, psi = np.array(ends).T
    scale, slip = 10.0 * 0.01 / math.sqrt(2), 0.005 * math.sqrt(10.0) / math.sqrt(2)
    assert x.mean() == pytest.approx(10.0, abs=0.02)
    assert x.std() == pytest.approx(math.hypot(scale, slip), rel=0.12)
    drift, noise = math.radians(0.05) * 20.0, math.radians(0.2) * 0.1 * math.sqrt(200)
    assert psi.std() == pytest.approx(math.hypot(drift, noise), rel=0.12)


def test_as_fast_as_it_can_does_not_look_at_the_wall():
    clock = SteppedClock()
    clock.wait(3600.0)
    assert clock.due() == 3600.0
    clock.wait(10.0)
    assert clock.due() == 3600.0


@pytest.mark.xdist_group("realtime")
def test_in_real_time_a_second_is_a_second():
    import time

    clock = WallClock()
    begin = time.monotonic()
    clock.wait(clock.due() + 0.2)
    assert 0.2 <= time.monotonic() - begin < 0.6
