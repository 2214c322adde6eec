"""Loss of the driver, speed scale, and the latency speed limit."""

import math

import pytest

from cohelm.core.types import Pose, Stick
from cohelm.law.guard.surroundings import surroundings
from cohelm.link.messages import Arming, Command, Device
from cohelm.link.operator import OperatorInput
from cohelm.loop.driver import Driver
from cohelm.loop.latency_limit import (
    MAX_LOST_SPEED,
    NO_CAP,
    allowed_share,
    driver_lost,
    latency_cap,
    lost_cap,
    steering_delay,
)
from cohelm.loop.stick_arming import StickState
from tests.pilot.drives import SETTINGS

ARMED = StickState(Arming.ARMED)


def received(age=0.02, driver=1, fresh=True, scale=1.0, round_trip=0.0):
    command = Command(Stick(0.0, 0.0), False, False, Device.NONE, scale, ())
    return OperatorInput(driver, "anna", command if fresh else None, age, round_trip, ())


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (received(), ""),
        (received(0.29, fresh=False), ""),
        (received(0.31, fresh=False), "no command for 310 ms"),
        (received(math.nan, fresh=False), "no command yet"),
        (received(driver=0), "there is no driver any more"),
    ],
)
def test_a_driver_is_lost_after_the_watchdog_whether_there_was_a_stick_or_not(said, why):
    assert driver_lost(said, 0.3) == why


def test_the_newest_speed_scale_applies():
    assert allowed_share(received(scale=0.25), 1.0) == 0.25
    assert allowed_share(received(fresh=False), 0.25) == 0.25


def test_only_an_operator_with_latency_near_an_obstacle_is_slowed_down():
    late = steering_delay(received(round_trip=0.6), ARMED)
    assert latency_cap(late, 0.3, SETTINGS).speed < SETTINGS.gains.u_d
    assert "latency" in latency_cap(late, 0.3, SETTINGS).reason
    assert latency_cap(late, 5.0, SETTINGS) == NO_CAP
    assert latency_cap(late, math.inf, SETTINGS) == NO_CAP
    assert latency_cap(steering_delay(received(round_trip=0.05), ARMED), 0.3, SETTINGS) == NO_CAP
    assert math.isnan(steering_delay(received(round_trip=0.6), StickState()))


def test_the_clearance_is_from_the_outline_to_the_nearest_obstacle_of_any_kind():
    driver = Driver(None, SETTINGS, 0.0, None)
    pose = Pose(1.0, 2.0, 0.5 * math.pi)  # the nose, 0.36 m before the middle, looks up
    nothing = surroundings([])
    assert driver.clearance(pose, nothing, 0) == math.inf
    point = surroundings([], points=[[1.0, 2.0 + 0.36 + 0.5]])
    assert driver.clearance(pose, point, 0) == pytest.approx(0.5)
    assert driver.clearance(pose, point, 1) == math.inf  # only ground that was never in view
    disc = surroundings([(1.0, 3.0, 0.0, 0.0, 0.1, 0.2)], points=[[1.0, 2.0 + 0.36 + 0.6]])
    assert driver.clearance(pose, disc, 0) == pytest.approx(1.0 - 0.36 - 0.1)
    assert driver.clearance(pose, surroundings([(1.0, 2.0, 0.0, 0.0, 0.1, 0.2)]), 0) == 0.0


def test_a_lost_robot_creeps_with_the_clearance_of_the_scan_alone():
    settings = SETTINGS
    caps = [lost_cap(clear, 0.05, settings) for clear in (0.0, 0.02, 0.1, 1.0, math.inf)]
    speeds = [c.speed for c in caps]
    assert speeds == sorted(speeds)
    assert 0.0 < speeds[0] <= 0.05  # it can leave what it stands against
    assert speeds[-1] == MAX_LOST_SPEED
    assert all(c.reason.startswith("lost, with") for c in caps)
    braking = min(settings.limits.acceleration, settings.limits.wheel_acceleration)
    braking = braking if math.isfinite(braking) else 1.0
    for c, clear in zip(caps[1:4], (0.02, 0.1, 1.0), strict=True):
        stops_within = c.speed * 0.05 + c.speed**2 / (2.0 * braking)
        assert stops_within <= max(0.5 * clear, 0.05 * 0.05 + 0.05**2 / (2.0 * braking)) + 1e-9
