"""The latency speed limit, and those of a lost robot and over ground never seen."""

import math
from types import SimpleNamespace

import pytest

from cohelm.core.types import Pose, Twist
from cohelm.law.guard.surroundings import surroundings
from cohelm.loop.driver import Driver
from cohelm.loop.speed_caps import (
    MAX_LOST_SPEED,
    MAX_UNSEEN_SPEED,
    NO_CAP,
    backed_slowly,
    latency_cap,
    lost_cap,
    unseen_cap,
)
from tests.pilot.drives import SETTINGS


def test_only_an_operator_with_latency_near_an_obstacle_is_slowed_down():
    late = 0.6
    assert latency_cap(late, 0.3, SETTINGS).speed < SETTINGS.gains.u_d
    assert "latency" in latency_cap(late, 0.3, SETTINGS).reason
    assert latency_cap(late, 5.0, SETTINGS) == NO_CAP
    assert latency_cap(late, math.inf, SETTINGS) == NO_CAP
    assert latency_cap(0.05, 0.3, SETTINGS) == NO_CAP
    assert latency_cap(math.nan, 0.3, SETTINGS) == NO_CAP


def test_the_clearance_is_from_the_outline_to_the_nearest_obstacle_of_any_kind():
    driver = Driver(None, SETTINGS, 0.0, None)
    pose = Pose(1.0, 2.0, 0.5 * math.pi)  # the nose, 0.36 m before the middle, looks up

    def clearance(obstacles, unobserved=0):
        n = len(obstacles.points)
        seen = SimpleNamespace(pose=pose, obstacles=obstacles, unobserved=slice(n - unobserved, n))
        return driver.clearance(seen)

    assert clearance(surroundings([])) == math.inf
    point = surroundings([], points=[[1.0, 2.0 + 0.36 + 0.5]])
    assert clearance(point) == pytest.approx(0.5)
    assert clearance(point, unobserved=1) == math.inf  # only ground that was never in view
    disc = surroundings([(1.0, 3.0, 0.0, 0.0, 0.1, 0.2)], points=[[1.0, 2.0 + 0.36 + 0.6]])
    assert clearance(disc) == pytest.approx(1.0 - 0.36 - 0.1)
    assert clearance(surroundings([(1.0, 2.0, 0.0, 0.0, 0.1, 0.2)])) == 0.0


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


def test_a_robot_has_slowed_down_where_ground_that_was_never_seen_begins():
    braking = min(SETTINGS.limits.acceleration, SETTINGS.limits.wheel_acceleration)
    assert unseen_cap(0.0, SETTINGS).speed == pytest.approx(MAX_UNSEEN_SPEED)
    assert unseen_cap(math.inf, SETTINGS) == NO_CAP
    for gap in (0.005, 0.01, 0.03):
        way = (unseen_cap(gap, SETTINGS).speed ** 2 - MAX_UNSEEN_SPEED**2) / (2.0 * braking)
        assert way == pytest.approx(gap)
    for twist in (Twist(-0.9, 0.3), Twist(-0.9, -0.3)):
        slow = backed_slowly(twist, 0.0, SETTINGS.limits)
        assert slow.v == pytest.approx(-MAX_UNSEEN_SPEED)
        assert slow.omega / slow.v == pytest.approx(twist.omega / twist.v)
    for twist in (Twist(-0.2, 1.0), Twist(0.9, 0.3), Twist(math.nan, 0.0)):
        assert backed_slowly(twist, 0.0, SETTINGS.limits) is twist
    assert backed_slowly(fast := Twist(-0.9, 0.3), math.inf, SETTINGS.limits) is fast
