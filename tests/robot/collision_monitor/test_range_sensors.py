"""By a range sensor the collision monitor slows and stops, too; on its word no ground is free."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.monitor import CollisionMonitor
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.watch import described
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.load import robot

SALLY = robot("sally")
SONAR = LidarModel.model_validate(
    {"name": "sonar", "range_sensor": True, "field_of_view_deg": 30, "range_min_m": 0.05,
     "range_max_m": 4.0, "rate_hz": 10, "noise_m": 0.01, "mount_x_m": 0.35, "forget_s": 2}
)  # fmt: skip
BEHIND = SONAR.model_copy(update={"mount_x_m": -0.35, "mount_yaw_deg": 180.0})
STILL = Twist(0.0, 0.0)


HERE = Pose(0.0, 0.0, 0.0)


def readings(t, reach, model, pose=HERE):
    number = round(100 * t)
    scan = Scan(t, number, np.full(SALLY.lidar.beams, math.inf), 0.0)
    sonar = Scan(t, number, np.full(model.beams, reach), 0.0, "sonar")
    further = () if reach is None else (sonar,)
    return Readings(Odometry(t, pose, STILL), scan, None, None, further)


def standing(reach, model=SONAR, told=readings):
    whole = SALLY.model_copy(update={"further_lidars": (model,)})
    it = CollisionMonitor(described(whole, rules(whole, 0.02)))
    for k in range(46, 51):
        it.observe(0.02 * k, told(0.02 * k, reach, model), STILL)
    return it


def test_what_only_the_sonar_sees_slows_and_stops_it():
    ahead = Twist(0.8, 0.0)
    assert standing(math.inf).restrict(1.0, ahead) == UNRESTRICTED
    near = standing(0.12).restrict(1.0, ahead)
    assert near.share < 0.6
    assert "ahead" in near.reason
    assert standing(0.12).restrict(1.0, Twist(-0.05, 0.0)) == UNRESTRICTED


def test_too_near_to_be_measured_holds_it_still_unless_it_backs_away():
    assert standing(-math.inf).restrict(1.0, Twist(0.3, 0.0)).share == 0.0
    assert standing(-math.inf).restrict(1.0, Twist(-0.05, 0.0)) == UNRESTRICTED


def test_silent_it_stops_the_robot_and_is_named():
    said = standing(None).restrict(1.0, Twist(0.3, 0.0))
    assert said == Restriction(0.0, "collision monitor: sonar LiDAR: there is no scan")
    late = standing(1.0).restrict(1.6, Twist(0.3, 0.0))
    assert late.share == 0.0


def test_it_vouches_for_no_ground():
    back = Twist(-1.0, 0.0)
    only = CollisionMonitor(described(SALLY, rules(SALLY, 0.02)))
    for k in range(46, 51):
        only.observe(0.02 * k, readings(0.02 * k, None, SONAR), STILL)
    assert standing(math.inf, BEHIND).restrict(1.0, back) == only.restrict(1.0, back)
    assert "unobserved ground" in only.restrict(1.0, back).reason


def test_its_error_is_that_of_one_measurement():
    """All beams say the same: that makes it no surer."""
    fine = SONAR.model_copy(update={"beams": 200})
    shares = [standing(0.3, one).restrict(1.0, Twist(0.8, 0.0)).share for one in (SONAR, fine)]
    assert shares[0] == pytest.approx(shares[1], abs=0.02)


def test_out_of_its_cone_an_obstacle_is_forgotten_after_a_while():
    whole = SALLY.model_copy(update={"further_lidars": (BEHIND,)})
    it = CollisionMonitor(described(whole, rules(whole, 0.02)))
    for k in range(225):
        t, psi = 0.02 * k, 0.5 * math.pi * min(max(k - 5, 0) / 30.0, 1.0)
        if k <= 5 or psi == 0.5 * math.pi:  # nothing is measured while it turns
            given = readings(t, 0.3 if k <= 5 else math.inf, BEHIND)
        odometry = Odometry(t, Pose(0.0, 0.0, psi), STILL)
        it.observe(t, given._replace(odometry=odometry), STILL)
        things = it._sources[1].by_odometry
        assert len(things.points) > 0 or t > 2.0
    assert len(things.points) == 0


def test_the_plausibility_monitor_has_no_opinion_of_it():
    """A sonar repeats itself, jumps from wall to nothing, and moves with the robot."""
    whole = SALLY.model_copy(update={"further_lidars": (SONAR,)})
    with_it, without = PlausibilityMonitor(whole), PlausibilityMonitor(SALLY)
    for k in range(200):
        t = 0.05 * k
        told = readings(t, (1.0, 1.0, math.inf, 3.0)[k // 10 % 4], SONAR)
        assert with_it.observe(t, told, STILL) == without.observe(t, told, STILL)
        assert with_it.restrict(t, Twist(0.3, 0.0)) == without.restrict(t, Twist(0.3, 0.0))
