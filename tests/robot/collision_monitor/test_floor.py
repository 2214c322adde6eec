"""The collision monitor takes no robot onto unobserved floor, nor over an edge that left
the camera's view beneath it."""

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

DEEP = robot("sally-depth")
assert DEEP.lidar is not None
ALL_ROUND = DEEP.model_copy(
    update={"lidar": DEEP.lidar.model_copy(update={"field_of_view_deg": 360.0})}
)
STILL, BACK, ON = Twist(0.0, 0.0), Twist(-0.5, 0.0), Twist(0.3, 0.0)
BEAMS = DEEP.further_lidars[0].beams


def after(poses, deeps=None, model=DEEP):
    """A monitor that has seen a scan from each pose, and when that was."""
    it, t = CollisionMonitor(described(model, rules(model, 0.02))), 0.0
    for k, pose in enumerate(poses):
        for _ in range(5):
            t += 0.02
            it.observe(t, readings(t, k, pose, None if deeps is None else deeps[k], model), STILL)
    return it, t


def readings(t, k, pose, deep, model, outline=None):
    assert model.lidar is not None
    first = Scan(t, k, np.full(model.lidar.beams, math.inf), 0.0, "planar")
    given = np.full(BEAMS, math.inf) if deep is None else deep
    return Readings(
        Odometry(t, pose, STILL), first, None, None, (Scan(t, k, given, 0.0, "deep"),),
        outline=outline,
    )  # fmt: skip


def spun(last):
    return [Pose(0.0, 0.0, math.radians(d)) for d in range(0, last + 1, 10)]


def backed(by):
    """As if it had come backwards, up to the end of what was vouched for."""
    return [Pose(-x, 0.0, 0.0) for x in np.arange(0.0, by + 0.01, 0.04)]


def test_it_backs_no_farther_than_floor_was_observed_though_a_lidar_looks_there():
    it, t = after(backed(0.64), model=ALL_ROUND)
    found = it.restrict(t, BACK)
    assert found.share == 0.0
    assert "unobserved floor" in found.reason
    assert "behind" in found.reason
    it, t = after(backed(0.2), model=ALL_ROUND)
    assert it.restrict(t, Twist(-0.1, 0.0)) == UNRESTRICTED


def test_it_backs_where_it_has_looked_before():
    it, t = after([*spun(360), *backed(0.56)])
    assert it.restrict(t, Twist(-0.3, 0.0)) == UNRESTRICTED


def test_it_drives_on_where_the_camera_sees_the_floor():
    it, t = after(spun(0) * 3)
    assert it.restrict(t, Twist(0.6, 0.0)) == UNRESTRICTED


def test_an_edge_that_left_the_view_beneath_the_camera_stops_it_still():
    """Seen 0.9 m before the lens; then the robot is 0.55 m nearer, and beams go past above it."""
    edge, beams = np.full(BEAMS, math.inf), slice(BEAMS // 2 - 6, BEAMS // 2 + 6)
    edge[beams] = 0.9
    poses = [Pose(x, 0.0, 0.0) for x in np.arange(0.02, 0.6, 0.05)]
    deeps = []
    for pose in poses:
        deeps.append(np.full(BEAMS, math.inf))
        if 0.9 - pose.x > 0.56:
            deeps[-1][beams] = 0.9 - pose.x
    it, t = after(poses, deeps)
    found = it.restrict(t, Twist(1.0, 0.0))
    assert found.share < 0.9
    assert "something 0.2" in found.reason
    assert it.restrict(t, Twist(-0.3, 0.0)) == UNRESTRICTED


def test_switched_on_before_an_edge_that_is_nearer_than_its_picture_it_does_not_go_there():
    """Nobody vouches for floor before which the camera sees none."""
    edge = np.full(BEAMS, DEEP.further_lidars[0].range_min_m)
    it, t = after(spun(0), [edge])
    for ahead in (0.05, 0.3, 0.6):
        found = it.restrict(t, Twist(ahead, 0.0))
        assert found.share == 0.0
        assert "unobserved floor" in found.reason
    assert it.restrict(t, Twist(-0.08, 0.0)) == UNRESTRICTED


NONE = np.full(BEAMS, DEEP.further_lidars[0].range_min_m)
ALL = np.full(BEAMS, math.inf)
HERE = Pose(0.0, 0.0, 0.0)


def carried(*there):
    """It stood on floor that it saw, was lifted for half a second, and was put down where its
    camera shows this; its wheels have not turned."""
    shown = [ALL, *[NONE] * 5, *there]
    return after([HERE] * len(shown), shown)


def test_carried_to_an_edge_nearer_than_its_picture_it_does_not_go_there():
    """Nor turn over it; what it had seen was floor of another place."""
    edge = ALL.copy()
    edge[BEAMS // 3 : -BEAMS // 3] = NONE[0]  # the floor beside it is seen
    for there in (edge, NONE):
        it, t = carried(*[there] * 4)
        for ahead in (0.05, 0.3, 0.6):
            found = it.restrict(t, Twist(ahead, 0.0))
            assert found.share == 0.0
            assert "unobserved floor" in found.reason
        assert it.restrict(t, Twist(-0.08, 0.0)) == UNRESTRICTED


def known_floor(it, t):
    """Whether it may move ahead, at a walk; what stood before the lens is remembered farther on."""
    return all(it.restrict(t, way) == UNRESTRICTED for way in (Twist(0.1, 0.0), Twist(0.0, 0.3)))


def test_carried_to_where_there_is_floor_it_drives_on():
    """Who put it down has looked, as who switches one on; once it drives that is over."""
    assert known_floor(*carried(*[ALL] * 2))
    turned = [Pose(0.0, 0.0, math.radians(a)) for a in (5, 10, 0)]
    shown = [ALL, *[NONE] * 6, *[ALL] * 3]
    assert not known_floor(*after([HERE] * 7 + turned, shown))


@pytest.mark.parametrize(
    "shown", [[NONE] * 2, [np.full(BEAMS, math.nan)] * 2, [np.full(BEAMS, 0.4)] * 8, [-ALL] * 8]
)
def test_a_picture_that_fails_for_a_moment_or_that_something_fills_makes_no_floor_unknown(shown):
    it, t = after([HERE] * (len(shown) + 2), [ALL, *shown, ALL])
    assert known_floor(it, t)


def test_a_robot_at_an_edge_on_observed_floor_may_turn_there():
    """What was floor as it came is known, though the picture now begins behind the edge."""
    poses = [Pose(x, 0.0, 0.0) for x in np.arange(0.0, 0.5, 0.04)]
    deeps = [np.full(BEAMS, math.inf)] * (len(poses) - 1)
    deeps.append(np.full(BEAMS, DEEP.further_lidars[0].range_min_m))
    it, t = after(poses, deeps)
    assert it.restrict(t, Twist(0.0, 0.3)) == UNRESTRICTED
    assert it.restrict(t, Twist(1.0, 0.0)).share < 0.6


def test_a_return_below_the_minimum_range_is_not_where_the_robot_turned_to_since():
    """While it turned, something was closer than the minimum range: anywhere up to the lens, except
    where the robot is itself now."""
    near = np.full(BEAMS, math.inf)
    near[50:60] = -math.inf
    poses = [Pose(0.0, 0.0, math.radians(a)) for a in (0, 40)]
    it, t = after([*poses, poses[-1]], [near, None, None])
    assert it.restrict(t, Twist(-0.1, 0.0)) == UNRESTRICTED
    it, t = after(poses[:1], [near])
    assert it.restrict(t, Twist(0.0, 0.3)).share == 0.0


def test_a_load_that_sticks_out_over_floor_that_nothing_has_seen_keeps_it_from_nothing_else():
    """What is under the robot is not driven onto: a stern that is 0.3 m longer all at once."""
    poses = backed(0.64)
    it, t = after(poses, model=ALL_ROUND)
    assert it.restrict(t, Twist(-0.3, 0.0)).share == 0.0
    stern = float(DEEP.outline[:, 0].min())
    load = np.array([(0.2, 0.2), (stern - 0.3, 0.2), (stern - 0.3, -0.2), (0.2, -0.2)])
    for k in range(3):
        t += 0.02
        it.observe(t, readings(t, len(poses) + k, poses[-1], None, ALL_ROUND, load), STILL)
    assert it.restrict(t, Twist(0.3, 0.0)) == UNRESTRICTED
    found = it.restrict(t, Twist(-0.3, 0.0))
    assert found.share < 0.6  # it begins behind the load
    assert "unobserved floor" in found.reason
    for k in range(3, 6):  # the load is put down: what was beneath it is as unknown as before
        t += 0.02
        it.observe(t, readings(t, len(poses) + k, poses[-1], None, ALL_ROUND, DEEP.outline), STILL)
    found = it.restrict(t, Twist(-0.3, 0.0))
    assert found.share == 0.0
    assert "unobserved floor" in found.reason
