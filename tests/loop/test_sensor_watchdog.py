"""Invalid, late and missing sensor readings are detected and reported."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.loop.sensor_watchdog import SensorWatchdog, timeouts
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot
from tests.ports.adapters import sally

NAN = math.nan


def odometry(stamp=10.0, x=0.0, psi=0.0, v=0.0, omega=0.0):
    return Odometry(stamp, Pose(x, 0.0, psi), Twist(v, omega))


def scan(stamp=9.95, number=1, value=3.0, duration=0.0):
    return Scan(stamp, number, np.full(720, value), duration)


def senses():
    return SensorWatchdog(sally(), timeouts(sally(), 0.02))


def readings(o=odometry(), s=scan()):  # noqa: B008
    return Readings(o, s, None, None)


def test_valid_readings_are_accepted():
    made = senses()
    for k in range(50):
        t = 10.0 + 0.02 * k
        assert made.problem(t, readings(odometry(t, 0.01 * k), scan(t - 0.03, k))) == ""


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (readings(None), "there is no odometry"),
        (readings(odometry(x=NAN)), "the odometry is not a number"),
        (readings(odometry(psi=math.inf)), "the odometry is not a number"),
        (readings(odometry(v=NAN)), "the odometry is not a number"),
        (readings(odometry(stamp=NAN)), "the odometry is not a number"),
        (readings(odometry(stamp=9.9)), "the odometry is 100 ms old"),
        (readings(odometry(stamp=10.5)), "the odometry comes 500 ms from the future"),
        (readings(s=None), "there is no scan"),
        (readings(s=scan(stamp=9.5)), "the scan is 500 ms old"),
        (readings(s=scan(stamp=10.5)), "the scan comes 500 ms from the future"),
        (readings(s=scan(stamp=NAN)), "the scan's time is not a number"),
        (readings(s=scan(duration=NAN)), "the scan's time is not a number"),
        (readings(s=scan(value=NAN)), "the scan is not a number"),
    ],
)
def test_invalid_readings_are_reported(given, said):
    assert senses().problem(10.0, given).startswith(said)


def test_a_scan_is_as_old_as_its_last_beam():
    assert senses().problem(10.0, readings(s=scan(stamp=9.6, duration=0.1))) == ""
    assert senses().problem(10.0, readings(s=scan(stamp=9.6, duration=0.0))) != ""


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (odometry(10.02, x=0.5), "the odometry jumped by 0.50 m"),
        (odometry(10.02, psi=1.0), "the odometry jumped by 57 deg"),
        (odometry(9.98), "the odometry's clock went back by 20 ms"),
    ],
)
def test_odometry_beyond_the_limits_of_the_wheels_is_a_jump(after, said):
    made = senses()
    assert made.problem(10.0, readings()) == ""
    assert made.problem(10.02, readings(after)) == said


STEPS = [3600.0, 31_536_000.0, 1.5]
CURE = "a clock jumped; if it stays so, set both clocks (chrony, ntp) and start again"


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("which", ["odometry", "scan"])
def test_a_set_clock_is_distinguished_from_a_silent_sensor(step, which):
    """Readings that go on coming, an hour after their stamps, are of another clock."""
    made = senses()
    said = set()
    for k in range(100):
        t = 10.0 + 0.02 * k
        off = step if k >= 10 else 0.0
        o = odometry(t - (off if which == "odometry" else 0.0))
        s = scan(t - 0.03 - (off if which == "scan" else 0.0), k)
        problem = made.problem(t, readings(o, s))
        if k >= 10:
            said.add(problem)
    assert all(one.startswith(f"the {which} comes ") and one.endswith(CURE) for one in said), said
    assert made.problem(12.02, readings(odometry(12.02), scan(12.0, 101))) == ""


def test_a_silent_sensor_is_detected_by_the_age_of_its_newest_reading():
    made = senses()
    assert made.problem(10.0, readings()) == ""
    said = [made.problem(10.0 + 0.1 * k, readings()) for k in range(2, 40)]
    assert said[-1] == "the odometry is 3900 ms old"
    assert all(one.endswith(" ms old") for one in said)


def test_a_turn_of_the_heading_over_pi_is_no_jump():
    made = senses()
    made.problem(10.0, readings(odometry(psi=math.pi)))
    assert made.problem(10.02, readings(odometry(10.02, psi=-math.pi))) == ""


def test_a_robot_without_a_lidar_needs_no_scan():
    blind = sally().model_copy(update={"lidar": None})
    assert SensorWatchdog(blind, timeouts(blind, 0.02)).problem(10.0, readings(s=None)) == ""


REAR = robot("sally-rear")


def behind(stamp=9.95, number=1, value=3.0):
    return readings()._replace(further=(scan(stamp, number, value)._replace(sensor="rear"),))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (behind(), ""),
        (readings(), "rear LiDAR: there is no scan"),
        (behind(stamp=9.5), "rear LiDAR: the scan is 500 ms old"),
        (behind(stamp=NAN), "rear LiDAR: the scan's time is not a number"),
        (behind(value=NAN), "rear LiDAR: the scan is not a number"),
        (behind()._replace(scan=None), "front LiDAR: there is no scan"),
    ],
)
def test_every_lidar_is_watched_and_named(given, said):
    assert SensorWatchdog(REAR, timeouts(REAR, 0.02)).problem(10.0, given) == said


def test_a_lidar_may_have_a_time_out_of_its_own():
    lidar = REAR.further_lidars[0].model_copy(update={"timeout_s": 0.6})
    patient = REAR.model_copy(update={"further_lidars": (lidar,)})
    made = SensorWatchdog(patient, timeouts(patient, 0.02))
    assert made.problem(10.0, behind(stamp=9.4)) == ""
    assert made.problem(10.0, behind(stamp=9.3)) == "rear LiDAR: the scan is 700 ms old"
