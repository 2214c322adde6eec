"""Every LiDAR's raw scan is judged by its own; what any of them sees counts."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.monitor import CollisionMonitor
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.watch import described
from cohelm.robot.monitor import UNRESTRICTED
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot

PERIOD = 0.02
REAR = robot("sally-rear")
STILL, BACK = Twist(0.0, 0.0), Twist(-1.0, 0.0)
HERE = Pose(0.0, 0.0, 0.0)


def empty(beams=720):
    return np.full(beams, math.inf)


def readings(t, front=None, rear=None, behind=True):
    scans = [
        Scan(t, round(100 * t), empty() if given is None else given, 0.0, name)
        for name, given in (("front", front), ("rear", rear))
    ]
    return Readings(Odometry(t, HERE, STILL), scans[0], None, None, (scans[1],) if behind else ())


def standing(given=readings, model=REAR):
    it = CollisionMonitor(described(model, rules(model, PERIOD)))
    for k in range(46, 51):
        it.observe(0.02 * k, given(0.02 * k), STILL)
    return it


def test_it_backs_as_fast_as_it_likes_where_the_rear_lidar_has_looked():
    assert standing().restrict(1.0, BACK) == UNRESTRICTED
    assert standing().restrict(1.0, Twist(1.0, 0.0)) == UNRESTRICTED
    only = robot("sally")
    blind = standing(lambda t: readings(t)._replace(further=()), only).restrict(1.0, BACK)
    assert blind.share < 1.0
    assert "ground that nothing looked at" in blind.reason


def test_what_only_the_rear_lidar_sees_stops_it():
    def near(t):
        rear = empty()
        rear[340:380] = 0.15  # 0.45 m behind the origin: 9 cm behind the outline
        return readings(t, rear=rear)

    found = standing(near).restrict(1.0, BACK)
    assert found.share < 0.6
    assert "behind" in found.reason
    assert standing(near).restrict(1.0, Twist(0.5, 0.0)) == UNRESTRICTED


def without_rear(t):
    return readings(t, behind=False)


def late(t):
    return readings(t)._replace(further=readings(t - 0.5).further)


def fewer_beams(t):
    return readings(t, rear=empty(360))


def no_time(t):
    given = readings(t)
    return given._replace(further=(given.further[0]._replace(duration=math.nan),))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (without_rear, "rear LiDAR: there is no scan"),
        (late, "rear LiDAR: no scan for 500 ms"),
        (fewer_beams, "rear LiDAR: a scan of 360 beams, and not 720"),
        (no_time, "rear LiDAR: the scan's time is no number"),
    ],
)
@pytest.mark.parametrize("twist", [Twist(0.3, 0.0), BACK])
def test_without_any_of_them_it_stops_and_names_it(given, said, twist):
    assert standing(given).restrict(1.0, twist) == (0.0, f"collision monitor: {said}", False)


def test_each_has_a_time_out_of_its_own():
    rear = REAR.further_lidars[0].model_copy(update={"timeout_s": 0.15})
    model = REAR.model_copy(update={"further_lidars": (rear,)})
    it = standing(model=model)
    assert it.restrict(1.149, BACK) == UNRESTRICTED
    assert it.restrict(1.16, BACK).reason == "collision monitor: rear LiDAR: no scan for 160 ms"


def test_all_scans_gone_is_as_one_gone():
    it = standing()
    assert it.restrict(2.0, Twist(0.3, 0.0)).reason.endswith("front LiDAR: no scan for 1000 ms")
