"""Every LiDAR's raw scan is judged by its own; what any of them sees counts."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.monitor import CollisionMonitor
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.watch import described
from cohelm.robot.monitor import UNRESTRICTED, Restriction
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
    assert "unobserved ground" in blind.reason


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
        (no_time, "rear LiDAR: the scan's time is not a number"),
    ],
)
@pytest.mark.parametrize("twist", [Twist(0.3, 0.0), BACK])
def test_without_any_of_them_it_stops_and_names_it(given, said, twist):
    assert standing(given).restrict(1.0, twist) == Restriction(0.0, f"collision monitor: {said}")


def test_each_has_a_time_out_of_its_own():
    rear = REAR.further_lidars[0].model_copy(update={"timeout_s": 0.15})
    model = REAR.model_copy(update={"further_lidars": (rear,)})
    it = standing(model=model)
    assert it.restrict(1.149, BACK) == UNRESTRICTED
    assert it.restrict(1.16, BACK).reason == "collision monitor: rear LiDAR: no scan for 160 ms"


def test_the_loss_of_all_scans_counts_like_that_of_one():
    it = standing()
    assert it.restrict(2.0, Twist(0.3, 0.0)).reason.endswith("front LiDAR: no scan for 1000 ms")


def described_at(front, rear, **changes):
    """Sally with both, their planes so high."""
    given = (front, rear)
    lidars = [
        one.model_copy(update={"mount_z_m": z, **changes})
        for one, z in zip(REAR.lidars, given, strict=True)
    ]
    return REAR.model_copy(update={"lidar": lidars[0], "further_lidars": (lidars[1],)})


def who_went_ahead(model, front=None):
    """The rear LiDAR sees somebody at its left end; then the robot turns left, and he would stand
    0.2 m before its bow, where that one does not look. front: the scan of the front one then, by
    default of nothing."""
    it = CollisionMonitor(described(model, rules(model, PERIOD)))
    turn = math.radians(60.0)
    for k in range(46, 86):
        t, turned = 0.02 * k, turn * min(max(k - 50, 0) / 25.0, 1.0)
        if k <= 50 or turned == turn:  # no scan while it turns
            rear = empty()
            if k <= 50:
                rear[:14] = 0.75  # from 45 deg to the left of straight ahead
            given = readings(t, front=front if k > 50 else None, rear=rear)
        odometry = Odometry(t, Pose(0.0, 0.0, turned), STILL)
        it.observe(t, given._replace(odometry=odometry), STILL)
    return it.restrict(1.7, Twist(1.0, 0.0))


def test_what_one_lidar_remembers_goes_when_another_as_high_sees_past_it():
    assert who_went_ahead(described_at(0.2, 0.2)) == UNRESTRICTED
    assert who_went_ahead(described_at(0.2, 0.205)) == UNRESTRICTED


@pytest.mark.parametrize("heights", [(None, None), (0.2, None), (None, 0.2), (0.2, 0.25)])
def test_an_obstacle_persists_where_lidar_heights_differ_or_are_unknown(heights):
    found = who_went_ahead(described_at(*heights))
    assert found.share < 0.9
    assert "ahead" in found.reason


def test_a_point_cloud_sees_past_nothing():
    assert who_went_ahead(described_at(0.2, 0.2, height_band_m=(0.1, 0.5))).share < 0.9


@pytest.mark.parametrize("front", [np.full(720, math.nan), np.full(720, -math.inf)])
def test_it_stays_where_the_other_one_sees_nothing(front):
    assert who_went_ahead(described_at(0.2, 0.2), front).share < 0.9


def test_it_stays_where_the_other_ones_range_ends_before_it():
    assert who_went_ahead(described_at(0.2, 0.2, range_max_m=0.3)).share < 0.9


def test_an_obstacle_persists_where_another_lidar_returns_it():
    front = empty()
    front[340:380] = 0.3
    found = who_went_ahead(described_at(0.2, 0.2), front)
    assert found.share < 0.9
    assert "ahead" in found.reason


def test_what_one_lidar_sees_itself_stays_whatever_another_sees_past():
    """Beside the robot, in view of both; the newer scan, of the front one, goes past it."""
    model = described_at(0.2, 0.2)

    def beside(t):
        rear = empty()
        rear[:14] = 0.55
        given = readings(t, rear=rear)
        return given._replace(scan=given.scan._replace(stamp=t + 0.01))

    rear = standing(beside, model)._sources[1]
    assert len(rear.by_odometry.points) == 14
