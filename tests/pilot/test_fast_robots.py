"""A robot that needs many metres to stop knows what stands there in time."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.obstacles import Obstacles
from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception
from cohelm.pilot.safety_filter import SafetyFilter
from cohelm.plan.zones import Zoned, Zones, keep_out
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.model import LimitsModel, checked_sight
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import sight

SALLY = robot("sally")
PERIOD, WALL = 0.02, 30.0


def fast(speed, brakes, farthest=30.0):
    limits = LimitsModel(
        speed_mps=speed, acceleration_mps2=brakes, yaw_rate_radps=1.0, yaw_acceleration_radps2=2.0
    )
    assert SALLY.lidar is not None
    lidar = SALLY.lidar.model_copy(update={"range_max_m": farthest, "noise_m": 0.0})
    return SALLY.model_copy(update={"limits": limits, "lidar": lidar, "delay_s": 0.0})


def driven(model, obstacles):
    """Full ahead from rest through the filter, until it stands: where its bow is then [m]."""
    safe, limits = SafetyFilter(model, PERIOD), model.bounds()
    pose, twist, top = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), model.limits.speed_mps
    for k in range(4000):
        out = safe(pose, twist, Twist(top, 0.0), obstacles(PERIOD * k, pose, twist))
        twist = achievable(out.twist, twist, limits, PERIOD)
        pose = arc(pose, twist, PERIOD)
        if k > 100 and twist.v < 0.01:
            break
    return pose.x + 0.36


@pytest.mark.parametrize(("speed", "brakes"), [(1.0, 2.0), (4.0, 1.0), (3.0, 0.5)])
def test_it_stops_before_a_wall_that_its_lidar_sees(speed, brakes):
    model = fast(speed, brakes)
    eyes, lidar = Perception(model), model.lidar.lidar()
    walls = np.array([[WALL, -20.0, WALL, 20.0]])

    def seen(t, pose, twist):
        scan = None
        if round(t / PERIOD) % 5 == 0:
            ranges = np.empty(len(lidar.beams))
            sight(pose, lidar, np.empty((0, 6)), walls, NO_GRID, ranges)
            scan = Scan(t, round(t / PERIOD), ranges, 0.0)
        return Obstacles(eyes.take(t, Readings(Odometry(t, pose, twist), scan)).obstacles.points)

    assert WALL - 0.1 < driven(model, seen) < WALL


@pytest.mark.parametrize(("speed", "brakes"), [(1.0, 2.0), (4.0, 1.0), (3.0, 0.5)])
def test_it_stops_before_a_keep_out_zone(speed, brakes):
    model = fast(speed, brakes)
    marked = np.zeros((100, 500), np.bool_)  # 40 m ahead from 10 m behind on, 5 m to either side
    marked[:, 400:] = True
    zones = Zones(keep_out(marked, 0.1, Pose(-10.0, -5.0, 0.0)))
    zoned = Zoned(zones, model.outline, 0.5, model.bounds())
    stands = driven(model, lambda t, pose, twist: Obstacles(zoned.points(pose)))
    assert WALL - 0.1 < stands < WALL + 0.05


@pytest.mark.parametrize(
    ("speed", "brakes", "farthest", "most"), [(3.0, 0.5, 5.0, 2.17), (1.0, 0.1, 3.5, 0.81)]
)
def test_one_that_stops_farther_on_than_it_sees_is_refused(speed, brakes, farthest, most):
    model = fast(speed, brakes, farthest)
    with pytest.raises(CohelmError, match=rf"set limits.speed_mps to {most:g} at most"):
        checked_sight(model)
    assert checked_sight(fast(most, brakes, farthest)).limits.speed_mps == most
    back = model.lidar.model_copy(update={"mount_yaw_deg": 180.0})
    assert checked_sight(model.model_copy(update={"lidar": back}))
    assert checked_sight(model.model_copy(update={"lidar": None}))
    assert checked_sight(model.model_copy(update={"limits": LimitsModel()}))
    assert not math.isinf(most)
