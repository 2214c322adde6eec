"""The twin's LiDAR sees what MuJoCo's own rays see, from where it was when each beam left."""

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.robot.model import RobotModel
from cohelm.sim.grid import NO_GRID, grid
from cohelm.sim.lidar import sight
from cohelm.sim.twin import mjcf
from cohelm.sim.twin.engine import mujoco
from cohelm.sim.twin.robot import Twin
from cohelm.sim.twin.settings import TwinModel
from tests.sim.twin.drives import brake, disc, drive, sally, scene

WALLS = [[-4.0, -3.0, 6.0, -3.0], [6.0, -3.0, 6.0, 3.0], [6.0, 3.0, -4.0, 3.0], [-4, 3, -4, -3]]


def exact(**changes: object) -> RobotModel:
    given = sally().lidar
    assert given is not None
    none = {"noise_m": 0.0, "dropout": 0.0, "latency_s": 0.0, "sweep_s": 0.0}
    return sally(lidar={**given.model_dump(), **none, **changes}, delay_s=0.0)


def test_beams_end_where_rays_through_physics_end():
    solid = np.zeros((10, 10), dtype=bool)
    solid[3:6, 2:8] = True
    robot = Twin(
        exact(), Pose(0.3, -0.2, 0.4),
        scene(disc(2.0, 1.0, 0.3), disc(3.0, -1.0, 0.1, 0.4, 0.1), walls=WALLS),
        grid=grid(solid, 0.1, Pose(-2.0, 1.0, 0.2)),
    )  # fmt: skip
    brake(robot, 0.5)
    scan, pose = robot.read().scan, robot.truth().pose
    assert scan is not None
    n = len(scan.ranges)
    bearings = np.radians(np.linspace(-135.0, 135.0, n)) + pose.psi
    rays = np.column_stack((np.cos(bearings), np.sin(bearings), np.zeros(n))).ravel()
    origin = np.array([pose.x + 0.3 * np.cos(pose.psi), pose.y + 0.3 * np.sin(pose.psi), 0.3])
    groups = np.zeros(6, dtype=np.uint8)
    groups[[mjcf.WALL, mjcf.SOLID]] = 1
    hit, distance = np.zeros(n, dtype=np.int32), np.zeros(n)
    mujoco.mj_forward(robot.mujoco, robot.data)
    mujoco.mj_multiRay(
        robot.mujoco, robot.data, origin, rays, groups, 1, -1, hit, distance, None, n, 50.0
    )
    off = np.abs(scan.ranges - distance)
    assert np.median(off) < 0.002  # walls are 2 mm thick in physics
    assert np.quantile(off, 0.98) < 0.02  # beams along a wall; a few pass an edge on one side only


def test_a_turning_lidar_measures_each_beam_from_where_it_was():
    twist = Twist(0.6, 1.0)
    robot, still = (
        Twin(exact(sweep_s=s), Pose(0.0, 0.0, 0.0), scene(walls=WALLS)) for s in (0.075, 0.0)
    )
    drive(still, twist, 1.2)
    times, *columns = np.array([(t.stamp, *t.pose) for t in drive(robot, twist, 1.2)]).T
    scan, skewed = robot.read().scan, still.read().scan
    assert scan is not None
    assert skewed is not None
    assert scan.duration == pytest.approx(0.075)
    assert robot.model.lidar is not None
    lidar, off = robot.model.lidar.lidar(), []
    for i in range(0, len(scan.ranges), 7):
        at = scan.stamp + i / len(scan.ranges) * scan.duration
        pose = Pose(*(float(np.interp(at, times, column)) for column in columns))
        ranges = np.empty(len(scan.ranges))
        sight(pose, lidar, np.empty((0, 6)), np.array(WALLS), NO_GRID, ranges)
        off.append(abs(ranges[i] - scan.ranges[i]))
    assert np.median(off) < 0.005
    assert np.quantile(off, 0.95) < 0.02
    assert np.abs(skewed.ranges - scan.ranges).max() > 0.05  # or the test shows nothing


def test_a_scan_is_read_when_its_sweep_and_latency_are_over():
    robot = Twin(exact(sweep_s=0.05, latency_s=0.1), obstacles=scene(walls=WALLS))
    first = None
    while first is None:
        robot.wait(robot.now() + 0.005)
        first = robot.read().scan
    assert (first.number, first.stamp) == (0, 0.0)
    assert robot.now() == pytest.approx(0.15, abs=0.006)
    robot.wait(1.0)
    last = robot.read().scan
    assert last is not None
    assert last.number == 8  # began at 0.8, read at 0.95
    assert last.stamp == pytest.approx(0.8)


def test_noise_dropouts_and_rate_can_be_set_for_the_twin():
    settings = TwinModel(lidar_noise_m=0.05, lidar_dropout=0.2, lidar_rate_hz=20.0)
    noisy_robot = Twin(exact(), obstacles=scene(walls=WALLS), settings=settings)
    true_robot = Twin(exact(), obstacles=scene(walls=WALLS))
    for robot in (noisy_robot, true_robot):
        brake(robot, 1.0)
    noisy, true = noisy_robot.read().scan, true_robot.read().scan
    assert noisy is not None
    assert true is not None
    assert (noisy.number, true.number) == (20, 10)
    lost = np.isinf(noisy.ranges)
    assert 0.1 < lost.mean() < 0.3
    assert (noisy.ranges - true.ranges)[~lost].std() == pytest.approx(0.05, rel=0.2)


def test_odometry_errors_can_be_set_for_the_twin():
    settings = TwinModel(gyro_drift_degps=5.0, odometry_distance_error=0.1)
    fitted = settings.fitted(sally())
    assert fitted.odometry.gyro_drift_degps == 5.0
    assert fitted.odometry.distance_error == 0.1
    assert fitted.odometry.slip == sally().odometry.slip


def test_a_sweep_longer_than_the_time_between_scans_is_refused():
    with pytest.raises(CohelmError, match=r"simulation.twin: .*lidar.*sweep_s must not be longer"):
        TwinModel(lidar_sweep_s=0.2).fitted(sally())


def test_sensors_that_no_robot_could_have_are_one_sentence():
    with pytest.raises(CohelmError) as error:
        TwinModel(lidar_rate_hz=0.5).fitted(sally())
    assert str(error.value) == (
        "simulation.twin: makes an impossible robot: lidar: rate_hz is in scans per second; one "
        "every 2 s is too seldom to drive by"
    )
