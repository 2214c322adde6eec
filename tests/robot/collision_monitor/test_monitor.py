"""What the collision monitor lets through, reading by reading."""

import math
from itertools import pairwise

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.fields import CRAWL, RESERVE
from cohelm.robot.collision_monitor.monitor import LASTS, CollisionMonitor
from cohelm.robot.collision_monitor.odometry import GAP, advanced, seen_from
from cohelm.robot.collision_monitor.source import MISSED
from cohelm.robot.collision_monitor.surroundings import REMEMBERED, MonitorSurroundings, seen_by
from cohelm.robot.collision_monitor.switched_on import VOUCHED
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.watch import described, monitors
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.port import AHEAD, Odometry, Readings, Scan
from cohelm.scenario.load import robot

PERIOD, DELAY, BRAKES = 0.02, 0.05, 2.0
FRONT, SENSOR = 0.36, 0.30
STILL = Twist(0.0, 0.0)
HERE = Pose(0.0, 0.0, 0.0)
STEP = math.radians(270.0) / 719
BEARINGS = STEP * (np.arange(720) - 359.5)


def model(noise=0.0, **lidar):
    sally = robot("sally")
    return sally.model_copy(
        update={"lidar": sally.lidar.model_copy(update={"noise_m": noise} | lidar)}
    )


def watch(noise=0.0, **lidar):
    made = model(noise, **lidar)
    return CollisionMonitor(described(made, rules(made, PERIOD)))


def empty():
    return np.full(720, math.inf)


def wall(gap, room=None):
    """Square ahead of the front, so far off it; or behind nothing: only where a beam goes."""
    ranges = empty() if room is None else room
    ahead = np.abs(BEARINGS) < 1.2
    ranges[ahead] = np.minimum(ranges[ahead], (FRONT - SENSOR + gap) / np.cos(BEARINGS[ahead]))
    return ranges


def readings(t, ranges, pose=HERE, twist=STILL, number=None, duration=0.0):
    number = round(100 * t) if number is None else number
    return Readings(Odometry(t, pose, twist), Scan(t, number, ranges, duration), None, None)


def standing(ranges, noise=0.0, **lidar):
    """A monitor of a robot that has stood in front of it for a while; it is 1.0 s."""
    it = watch(noise, **lidar)
    for k in range(46, 51):
        assert it.observe(0.02 * k, readings(0.02 * k, ranges), STILL) == UNRESTRICTED
    return it


def going(twist, ranges, applied=None, poses=True, at=1.0):
    """The same at a steady twist, ranges seen now; until it is 1.0 s."""
    it = watch()
    for k in range(20, -1, -1):
        t = at - 0.02 * k
        pose = advanced(HERE, twist, -0.02 * k) if poses else HERE
        here = ranges if k == 0 else empty()
        it.restrict(t - PERIOD, twist)
        it.observe(t, readings(t, here, pose, twist), twist if applied is None else applied)
    return it


def ramped(speed, wanted):
    """As the gate passes it: no faster than the wheels may change their speed."""
    return speed + max(-BRAKES * PERIOD, min(BRAKES * PERIOD, wanted - speed))


def fits(room, most, reaction, brakes):
    """The largest speed that has come down to a crawl within a room: by steps of 0.1 mm/s."""
    v = np.arange(0.0, most, 1e-4)
    ways = v * reaction + np.maximum(v**2 - CRAWL**2, 0.0) / (2.0 * brakes)
    return v[(ways <= room) | (v <= CRAWL)].max()


def test_in_free_space_everything_passes():
    it = standing(empty())
    for twist in (Twist(1.0, 0.0), Twist(-0.7, 0.0), Twist(0.2, 1.5), STILL):
        assert it.restrict(1.0, twist) == UNRESTRICTED


@pytest.mark.parametrize("gap", [0.03, 0.1, 0.2])
def test_towards_a_wall_nothing_passes_that_can_not_stop_before_it(gap):
    it = standing(wall(gap))
    share = it.restrict(1.0, Twist(1.0, 0.0)).share
    margin = (FRONT - SENSOR + gap) * STEP / math.cos(math.atan2(0.29, FRONT - SENSOR + gap))
    least = fits(gap - margin, 1.0, PERIOD, (1.0 - RESERVE) * BRAKES)
    most = fits(gap, 1.0, PERIOD, (1.0 - RESERVE) * BRAKES)
    assert least - 1e-3 <= share <= most + 1e-3
    slow = it.restrict(1.0, Twist(0.9 * least, 0.0))
    assert slow == UNRESTRICTED
    assert it.restrict(1.0, Twist(-0.7, 0.0)) == UNRESTRICTED


@pytest.mark.parametrize(("gap", "slower"), [(0.32, True), (0.345, False)])
def test_a_post_before_a_front_corner_is_looked_for_as_far_as_it_has_to_slow_down(gap, slower):
    """From 1 m/s it takes a period and 0.31 m, with what the field does not count on."""
    x, y, ranges = FRONT + gap - SENSOR, 0.28, empty()
    ranges[np.abs(BEARINGS - math.atan2(y, x)) < STEP] = math.hypot(x, y)
    assert (standing(ranges).restrict(1.0, Twist(1.0, 0.0)).share < 1.0) == slower


def test_a_post_before_a_front_corner_is_looked_for_as_far_as_what_was_sent_brakes():
    x, y, ranges = FRONT + 0.25 - SENSOR, 0.28, empty()
    ranges[np.abs(BEARINGS - math.atan2(y, x)) < STEP] = math.hypot(x, y)
    assert going(Twist(1.0, 0.0), ranges).restrict(1.0, Twist(0.001, 0.0)).share == 0.0


def test_the_arc_stays():
    twist = Twist(0.8, 0.5)
    restriction = standing(wall(0.05)).restrict(1.0, twist)
    assert 0.0 < restriction.share < 1.0
    assert not restriction.fault


def test_in_contact_it_stands_and_may_leave_at_a_crawl():
    it = standing(wall(-0.005))
    ahead = it.restrict(1.0, Twist(0.5, 0.0))
    assert ahead.share == 0.0
    assert ahead.reason == "collision monitor: something 0.00 m ahead on the braking path"
    assert it.restrict(1.0, Twist(-0.5, 0.0)).share == pytest.approx(CRAWL / 0.5)
    assert it.restrict(1.0, Twist(-0.9 * CRAWL, 0.0)) == UNRESTRICTED


def test_where_noise_may_hide_it_there_is_a_crawl_and_no_more():
    it = standing(wall(0.01, None), noise=0.02)
    assert it.restrict(1.0, Twist(0.5, 0.0)).share <= CRAWL / 0.5 + 1e-9
    assert it.restrict(1.0, Twist(-0.5, 0.0)).share == pytest.approx(CRAWL / 0.5)


def test_a_robot_that_moves_too_fast_brakes_whatever_is_commanded():
    """Braking from the measured 0.5 m/s: delay, a period and 62.5 mm."""
    needs = 0.5 * (DELAY + PERIOD) + 0.5**2 / (2.0 * BRAKES) - CRAWL**2 / (2.0 * BRAKES)
    margin = 0.006
    for gap, stops in ((needs - 0.002, True), (needs + margin, False)):
        it = going(Twist(0.5, 0.0), wall(gap))
        found = it.restrict(1.0, Twist(0.001, 0.0))
        assert (found.share == 0.0) == stops
        if stops:
            assert found.reason.endswith("m ahead on the braking path")


def test_the_age_of_the_odometry_is_way():
    it = going(Twist(0.5, 0.0), wall(0.105))
    assert it.restrict(1.0, Twist(0.001, 0.0)) == UNRESTRICTED
    assert it.restrict(1.03, Twist(0.001, 0.0)).share == 0.0


def test_moving_poses_are_trusted_over_a_twist_of_zero():
    it = watch()
    for k in range(10):
        t = 0.02 * k
        it.observe(
            t, readings(t, wall(0.08) if k == 9 else empty(), Pose(0.5 * t, 0.0, 0.0)), STILL
        )
    assert it.restrict(0.18, Twist(0.001, 0.0)).share == 0.0


def rolling(ranges, poses=True, twists=True):
    """At 0.5 m/s, by one sense or both, though it was sent nothing for a second; it is 1.0 s."""
    it = watch()
    for k in range(51):
        t = 0.02 * k
        pose = Pose(0.5 * (t - 1.0) if poses else 0.0, 0.0, 0.0)
        twist = Twist(0.5 if twists else 0.0, 0.0)
        it.restrict(t - PERIOD, STILL)
        it.observe(t, readings(t, ranges if k == 50 else empty(), pose, twist), STILL)
    return it


@pytest.mark.parametrize("senses", [(True, True), (True, False), (False, True)])
def test_motion_without_a_command_is_braked_for_by_whichever_sensor_shows_it(senses):
    """Odometry's age, delay and a period of it, and 62.5 mm."""
    needs = 0.5 * (DELAY + PERIOD) + 0.5**2 / (2.0 * BRAKES) - CRAWL**2 / (2.0 * BRAKES)
    margin, ask = 0.006, Twist(0.001, 0.0)
    assert rolling(wall(needs - 0.002), *senses).restrict(1.0, ask).share == 0.0
    assert rolling(wall(needs + margin), *senses).restrict(1.0, ask) == UNRESTRICTED
    assert rolling(wall(needs + margin), *senses).restrict(1.03, ask).share == 0.0


@pytest.mark.parametrize("sent", [Twist(0.5, 0.0), Twist(-0.5, 0.0), Twist(0.0, 1.0)])
def test_the_opposite_of_what_was_sent_is_not_explained_by_it(sent):
    it = watch()
    for k in range(51):
        t = 0.02 * k
        it.restrict(t - PERIOD, sent)
        it.observe(t, readings(t, empty()), sent)
    assert not it._unexplained(sent)
    assert it._unexplained(Twist(-sent.v, -sent.omega))


def test_the_predicted_pose_follows_the_sent_commands_by_the_delay():
    it = watch()
    it.observe(0.0, readings(0.0, empty()), STILL)
    for k in range(10):
        it.restrict(0.02 * k, Twist(0.5, 0.0))
        it.observe(0.02 * (k + 1), readings(0.02 * (k + 1), empty()), Twist(0.5, 0.0))
    late = watch()
    late.observe(0.0, readings(0.0, empty()), STILL)
    late.restrict(0.01, Twist(0.5, 0.0))
    late.observe(0.02, readings(0.02, empty()), Twist(0.5, 0.0))
    assert late._commanded.stamp == pytest.approx(0.01 + DELAY)
    start = it._commanded.at(0.0)
    for when, way in ((DELAY, 0.0), (0.1 + DELAY, 0.05), (0.2 + DELAY, 0.1)):
        assert it._commanded.at(when).x - start.x == pytest.approx(way)
    for k in range(11, 20):  # nothing is proposed: the watchdog brakes
        it.observe(0.02 * k, readings(0.02 * k, empty()), STILL)
    assert it._commanded.at(1.0).x - start.x == pytest.approx(0.1)
    assert it._commanded.stamp == pytest.approx(0.36 + DELAY)


def test_the_ground_around_a_standing_robot_does_not_depend_on_its_heading():
    def unknown(psi):
        it = watch(sweep_s=0.075)
        for k in range(5):
            t = 0.1 * k
            it.observe(t, readings(t, empty(), Pose(2.0, 1.0, psi), duration=0.075), STILL)
        return len(it._all.points)  # nothing returns

    assert unknown(2.0) == pytest.approx(unknown(0.0), rel=0.05)


@pytest.mark.parametrize("back", [None, 0.3, 1.5, 3600.0])
def test_sent_commands_are_trusted_though_the_odometry_is_frozen(back):
    """The scan is 0.1 s old and the odometry stands; but 0.5 m/s is sent. Before that the robot's
    clock may have been set back."""
    it = watch()
    sent = Twist(0.5, 0.0)
    ranges = wall(0.15)
    for k in range(0 if back is None else 30):
        t = 0.02 * k - 0.6 + back
        it.observe(t, readings(t, empty(), number=-30 + k), STILL)
        it.restrict(t, STILL)
    for k in range(30):
        t = 0.02 * k
        scan = Scan(0.02 * min(k, 24), min(k, 24), ranges, 0.0)
        it.observe(t, Readings(Odometry(t, HERE, STILL), scan, None, None), sent if k else STILL)
        it.restrict(t, sent)
    share = it.restrict(0.58, sent).share
    gone = 0.5 * (0.58 + DELAY - 0.48)
    assert share * 0.5 == pytest.approx(
        fits(0.15 - gone, 0.5, PERIOD, (1.0 - RESERVE) * BRAKES), abs=0.012
    )
    assert share < 1.0


def test_points_come_nearer_as_the_robot_moves_on():
    it = going(Twist(0.3, 0.0), wall(0.3))
    scan = it._sources[0]._scan
    shares = []
    for k in range(1, 12):
        t = 1.0 + 0.02 * k
        it.restrict(t - PERIOD, Twist(0.3, 0.0))
        odometry = Odometry(t, Pose(0.3 * (t - 1.0), 0.0, 0.0), Twist(0.3, 0.0))
        it.observe(t, Readings(odometry, scan, None, None), Twist(0.3, 0.0))
        shares.append(it.restrict(t, Twist(1.0, 0.0)).share)
    assert all(b < a for a, b in pairwise(shares))
    gone = 0.3 * (0.22 + DELAY)
    assert shares[-1] == pytest.approx(fits(0.3 - gone, 1.0, PERIOD, 1.6), abs=0.01)


def test_beside_a_wall_it_passes_along():
    for side in (1.0, -1.0):
        it = standing(beside(0.03, side))
        assert it.restrict(1.0, Twist(1.0, 0.0)) == UNRESTRICTED
        assert it.restrict(1.0, Twist(-0.7, 0.0)) == UNRESTRICTED
        towards = it.restrict(1.0, Twist(0.3, side))
        assert towards.share < 1.0
        assert towards.reason.endswith("left" if side > 0.0 else "right")


def beside(gap, side=1.0, first=0.3, last=2.2):
    """A wall along its side, so far off it, as it is seen between two bearings."""
    ranges = empty()
    there = (side * BEARINGS > first) & (side * BEARINGS < last)
    ranges[there] = (0.29 + gap) / np.abs(np.sin(BEARINGS[there]))
    return ranges


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_may_touch_its_side_is_passed_along_at_a_crawl_and_not_turned_into(side):
    """A post 4 mm off, where the average has 6 mm of noise: it is not caught between two such."""
    it = standing(beside(0.004, side, 1.8, 1.83), noise=0.02)
    for v in (0.5, -0.5):
        assert it.restrict(1.0, Twist(v, 0.0)).share == pytest.approx(CRAWL / 0.5)
        assert it.restrict(1.0, Twist(0.1 * v, 0.0)) == UNRESTRICTED
    assert it.restrict(1.0, Twist(0.0, 0.3 * side)).share == 0.0
    assert it.restrict(1.0, Twist(0.05, 0.3 * side)).share == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_obstacle_measured_in_its_side_may_only_be_left(side):
    it = standing(beside(-0.004, side, 1.8, 1.83), noise=0.02)
    assert it.restrict(1.0, Twist(0.5, 0.0)).share == 0.0
    assert it.restrict(1.0, Twist(-0.5, 0.0)).share == 0.0
    assert it.restrict(1.0, Twist(0.0, -0.3 * side)).share > 0.0


def test_a_walker_out_of_view_past_a_standing_robot_does_not_stay_beside_it():
    """1 cm off its side, with odometry that drifts by 0.01 deg/s."""
    it = watch()
    for k in range(60):
        t = 0.05 * k
        x, ranges = 1.5 - t, empty()
        seen_at = SENSOR + 0.3 / np.tan(np.where(BEARINGS > 0.0, BEARINGS, math.nan))
        leg = np.abs(seen_at - x) < 0.05
        ranges[leg] = 0.3 / np.sin(BEARINGS[leg])
        drifts = Pose(0.0, 0.0, -1e-5 * k)
        it.observe(t, readings(t, ranges, drifts), STILL)
        if 0.1 < x < 0.3:
            assert it.restrict(t, Twist(0.0, 1.5)).share < 1.0
    assert x < -1.0
    for twist in (Twist(0.5, 0.0), Twist(0.5, -1.5), Twist(-0.5, 1.5)):
        assert it.restrict(t, twist) == UNRESTRICTED


def test_something_too_near_to_measure_holds_it_but_for_backing():
    ranges = empty()
    ranges[355:365] = -math.inf
    it = standing(ranges)
    assert it.restrict(1.0, Twist(0.3, 0.0)).share == 0.0
    assert it.restrict(1.0, Twist(0.0, 0.5)).share == 0.0
    assert it.restrict(1.0, Twist(0.0, -0.5)).share == 0.0
    assert it.restrict(1.0, Twist(-0.3, 0.0)).share == pytest.approx(CRAWL / 0.3)


def test_nothing_to_take_from_is_not_restricted():
    it = standing(wall(-0.01))
    assert it.restrict(1.0, STILL) == UNRESTRICTED
    assert it.restrict(1.0, Twist(math.nan, 0.0)) == UNRESTRICTED
    assert it.restrict(1.0, Twist(0.1, math.inf)) == UNRESTRICTED


def test_a_scan_that_does_not_come_stops_it():
    it = standing(empty())
    patience = MISSED / 10.0
    assert it.restrict(1.0 + patience - 1e-6, Twist(0.3, 0.0)) == UNRESTRICTED
    late = it.restrict(1.0 + patience + 0.0006, Twist(0.3, 0.0))
    assert late == Restriction(0.0, "collision monitor: no scan for 301 ms")
    assert standing(empty()).restrict(3.0, Twist(0.3, 0.0)).reason.endswith("no scan for 2000 ms")


def test_a_slow_sweep_and_a_late_reading_are_no_loss():
    it = standing(empty(), sweep_s=0.08, latency_s=0.05)
    patience = MISSED / 10.0 + 0.08 + 0.05
    assert it.restrict(1.0 + patience - 1e-6, Twist(0.3, 0.0)) == UNRESTRICTED
    assert it.restrict(1.0 + patience + 1e-6, Twist(0.3, 0.0)).share == 0.0


def test_the_age_of_a_scan_counts_from_its_last_beam():
    it = watch()
    it.observe(1.1, readings(1.0, empty(), duration=0.1), STILL)
    assert it.restrict(1.39, Twist(0.3, 0.0)) == UNRESTRICTED
    assert it.restrict(1.41, Twist(0.3, 0.0)).reason == "collision monitor: no scan for 310 ms"


WRONG = {
    "there is no odometry": Readings(None, Scan(1.02, 9, empty(), 0.0), None, None),
    "the odometry is not a number": readings(1.02, empty(), Pose(0.0, math.nan, 0.0)),
    "there is no scan": Readings(Odometry(1.02, HERE, STILL), None, None, None),
    "a scan of 3 beams, and not 720": readings(1.02, np.ones(3)),
    "the scan's time is not a number": readings(1.02, empty(), duration=math.nan),
}


@pytest.mark.parametrize("said", list(WRONG))
def test_unusable_readings_stop_it_with_the_reason(said):
    it = standing(empty())
    assert it.observe(1.02, WRONG[said], STILL) == UNRESTRICTED
    assert it.restrict(1.02, Twist(0.3, 0.0)) == Restriction(0.0, f"collision monitor: {said}")
    fresh = watch()
    assert fresh.observe(1.02, WRONG[said], STILL) == UNRESTRICTED
    assert fresh.restrict(1.02, Twist(0.3, 0.0)) == Restriction(0.0, f"collision monitor: {said}")
    it.observe(1.04, readings(1.04, empty()), STILL)
    assert it.restrict(1.04, Twist(0.3, 0.0)) == UNRESTRICTED


@pytest.mark.parametrize("which", range(5))
def test_no_number_of_the_odometry_is_used_that_is_none(which):
    numbers = [0.0] * 5
    numbers[which] = math.inf
    it = standing(empty())
    odometry = Odometry(1.02, Pose(*numbers[:3]), Twist(*numbers[3:]))
    it.observe(1.02, Readings(odometry, Scan(1.02, 9, empty(), 0.0), None, None), STILL)
    assert it.restrict(1.02, Twist(0.3, 0.0)).reason.endswith("the odometry is not a number")
    it.observe(1.04, Readings(Odometry(math.nan, HERE, STILL), None, None, None), STILL)
    assert it.restrict(1.04, Twist(0.3, 0.0)).reason.endswith("the odometry is not a number")


def test_before_any_reading_nothing_passes():
    found = watch().restrict(1.0, Twist(0.3, 0.0))
    assert found == Restriction(0.0, "collision monitor: there is no scan")


def test_a_scan_from_the_future_is_refused():
    it = standing(empty())
    it.observe(1.02, readings(1.02 + AHEAD - 1e-6, empty()), STILL)
    assert it.restrict(1.02, Twist(0.3, 0.0)) == UNRESTRICTED
    late = readings(1.04 + AHEAD + 1e-6, empty())._replace(odometry=Odometry(1.04, HERE, STILL))
    it.observe(1.04, late, STILL)
    assert it.restrict(1.04, Twist(0.3, 0.0)).reason == (
        "collision monitor: the scan comes from the future"
    )


def test_odometry_from_the_future_is_refused_and_memory_is_kept():
    it = standing(wall(0.02))
    tomorrow = Odometry(86_400.0, HERE, STILL)
    it.observe(1.02, readings(1.02, wall(0.02))._replace(odometry=tomorrow), STILL)
    assert it.restrict(1.02, Twist(0.3, 0.0)).reason == (
        "collision monitor: the odometry comes from the future"
    )
    only = readings(1.02, wall(0.02))
    for k in range(60):
        t, turned = 1.04 + 0.02 * k, Pose(0.0, 0.0, math.pi * min(k / 55.0, 1.0))
        given = only._replace(odometry=Odometry(t, turned, STILL))
        it.observe(t, given if k < 55 else readings(t, empty(), turned), STILL)
    assert "something 0.0" in it.restrict(t, Twist(-0.3, 0.0)).reason


def test_after_the_clock_went_back_earlier_readings_do_not_count():
    it = standing(wall(0.02))
    it.observe(0.5, Readings(Odometry(0.5, HERE, STILL), None, None, None), STILL)
    assert it.restrict(0.5, Twist(0.3, 0.0)).reason.endswith("there is no scan")
    it.observe(0.52, readings(0.52, empty()), STILL)
    assert it.restrict(0.52, Twist(0.3, 0.0)) == UNRESTRICTED


def test_a_reason_keeps_its_text_while_it_lasts():
    it = standing(wall(0.05))
    first = it.restrict(1.0, Twist(1.0, 0.0)).reason
    assert first == "collision monitor: slower, something 0.05 m ahead"
    it.observe(1.1, readings(1.1, wall(0.03)), STILL)
    assert it.restrict(1.1, Twist(1.0, 0.0)).reason == first
    for k in range(1, 30):
        t = 1.1 + 0.1 * k
        it.observe(t, readings(t, wall(0.03)), STILL)
        assert it.restrict(t, Twist(1.0, 0.0)).reason == first
    later = t + LASTS + 0.01
    it.observe(later, readings(later, wall(0.03)), STILL)
    assert it.restrict(later, Twist(1.0, 0.0)).reason.endswith("0.03 m ahead")


def test_what_went_out_of_sight_is_not_turned_or_backed_into():
    """Something stands 0.14 m behind the robot's left, seen before it turned its back on it."""
    it = watch()
    at = np.array([-0.5, 0.2])
    for k in range(200):
        t = 0.02 * k
        psi = math.pi - min(1.0 * t, math.pi)
        c, s = math.cos(psi), math.sin(psi)
        x, y = c * at[0] + s * at[1] - SENSOR, -s * at[0] + c * at[1]
        ranges, bearing = empty(), math.atan2(y, x)
        near = np.abs(BEARINGS - bearing) < 2.0 * STEP
        ranges[near] = math.hypot(x, y)
        turning = Twist(0.0, -1.0 if psi > 0.0 else 0.0)
        it.observe(t, readings(t, ranges, Pose(0.0, 0.0, psi), turning), turning)
    assert not near.any()
    back = it.restrict(t, Twist(-0.8, 0.0))
    assert back.share < 1.0
    assert back.reason.endswith("behind")
    assert back.share * 0.8 == pytest.approx(fits(0.14, 0.8, PERIOD, 1.6), abs=0.02)
    assert it.restrict(t, Twist(0.8, 0.0)) == UNRESTRICTED
    it.observe(0.5, readings(0.5, empty()), STILL)  # its clock goes back: that was another time
    assert "unobserved ground" in it.restrict(0.5, Twist(-0.8, 0.0)).reason


def test_an_obstacle_seen_from_afar_counts_when_backed_at():
    """It stood 2.3 m before the LiDAR; then the robot turned, and backed at it."""
    it = watch()
    for k in range(200):
        t = 0.02 * k
        psi = math.pi - min(1.0 * t, math.pi)
        x, y = -2.6 * math.cos(psi) - SENSOR, 2.6 * math.sin(psi)
        ranges = empty()
        ranges[np.abs(BEARINGS - math.atan2(y, x)) < 3.0 * STEP] = math.hypot(x, y)
        it.observe(t, readings(t, ranges, Pose(0.0, 0.0, psi)), STILL)
    for k in range(150):
        t = 4.0 + 0.02 * k
        it.observe(t, readings(t, empty(), Pose(-min(0.02 * k, 2.22), 0.0, 0.0)), STILL)
    back = it.restrict(t, Twist(-1.0, 0.0))
    assert "something 0.02 m behind" in back.reason


def test_ground_is_looked_at_from_where_the_robot_was_half_way_through_the_scan():
    it, ahead = watch(), Twist(1.0, 0.0)
    for k in range(20):
        t = 0.02 * k
        it.observe(t, Readings(Odometry(t, Pose(t, 0.0, 0.0), ahead), None, None, None), ahead)
    scan = Scan(t - 0.2, 1, empty(), 0.2)
    it.observe(t, Readings(Odometry(t, Pose(t, 0.0, 0.0), ahead), scan, None, None), ahead)
    assert it._sources[0].ground._at.x == pytest.approx(t - 0.1 + SENSOR)


def test_ground_that_nothing_looked_at_is_backed_into_at_a_crawl_and_no_faster():
    """It was switched on there: its turning circle and 0.2 m are vouched for, and no more."""
    it = standing(empty())
    reach = math.hypot(FRONT, 0.29)
    free = reach + VOUCHED - FRONT  # straight behind; to a cell and its corner
    back = it.restrict(1.0, Twist(-1.0, 0.0))
    assert fits(free - 0.1, 1.0, PERIOD, 1.6) <= back.share <= fits(free, 1.0, PERIOD, 1.6)
    assert back.reason.startswith("collision monitor: slower, unobserved ground 0.")
    assert back.reason.endswith("m behind")
    at, speed, passed = 0.0, 0.0, []
    for k in range(1, 500):
        t = 1.0 + 0.02 * k
        at += PERIOD * speed
        it.observe(t, readings(t, empty(), Pose(at, 0.0, 0.0), Twist(speed, 0.0)),
                   Twist(speed, 0.0))  # fmt: skip
        speed = ramped(speed, -it.restrict(t, Twist(-1.0, 0.0)).share)
        passed.append((at, -speed))
    assert at < -0.8
    assert max(v for _, v in passed) > 0.5
    assert all(v <= CRAWL + 1e-9 for x, v in passed if x < -free)
    assert all(v >= CRAWL - 1e-9 for x, v in passed if x < -free)
    assert it.restrict(t, Twist(1.0, 0.0)) == UNRESTRICTED


def test_ground_that_was_in_view_is_backed_onto_as_fast_as_one_likes():
    it = watch()
    for k in range(200):
        t = 0.02 * k
        ahead = Twist(1.0, 0.0)
        it.restrict(t - PERIOD, ahead)
        it.observe(t, readings(t, empty(), Pose(1.0 * t, 0.0, 0.0), ahead), ahead)
    for k in range(200, 300):
        t = 0.02 * k
        it.restrict(t - PERIOD, STILL)
        it.observe(t, readings(t, empty(), Pose(3.98, 0.0, 0.0), STILL), STILL)
    for twist in (Twist(-1.0, 0.0), Twist(-0.7, 0.7), Twist(0.0, 2.0), Twist(0.3, -1.5)):
        assert it.restrict(t, twist) == UNRESTRICTED


def test_a_stale_obstacle_behind_is_approached_at_a_crawl():
    it = watch()
    at = np.array([-0.5, 0.0])
    for k in range(200):
        t = 0.02 * k
        psi = math.pi - min(1.0 * t, math.pi)
        x, y = math.cos(psi) * at[0] - SENSOR, -math.sin(psi) * at[0]
        ranges = empty()
        ranges[np.abs(BEARINGS - math.atan2(y, x)) < 2.0 * STEP] = math.hypot(x, y)
        turning = Twist(0.0, -1.0 if psi > 0.0 else 0.0)
        it.observe(t, readings(t, ranges, Pose(0.0, 0.0, psi), turning), turning)
    assert "slower, something" in it.restrict(t, Twist(-0.8, 0.0)).reason
    for later in (t + REMEMBERED + 1.0, t + REMEMBERED + 1.1):
        it.observe(later, readings(later, empty()), STILL)
    back = it.restrict(later, Twist(-0.8, 0.0))
    assert back.reason.startswith("collision monitor: slower, unobserved ground")
    x, speed, later_x = 0.0, 0.0, []
    for k in range(1, 300):
        now = later + 0.02 * k
        x += PERIOD * speed
        it.observe(now, readings(now, empty(), Pose(x, 0.0, 0.0), Twist(speed, 0.0)),
                   Twist(speed, 0.0))  # fmt: skip
        speed = ramped(speed, -0.5 * it.restrict(now, Twist(-0.5, 0.0)).share)
        later_x.append((x, -speed))
    assert all(v <= CRAWL + 1e-9 for x, v in later_x if -0.3 < x < -0.14)
    assert x < -0.3


def test_after_it_was_switched_on_anew_ground_is_unknown_again():
    it = standing(empty())
    for k in range(1, 100):
        t = 1.0 + 0.02 * k
        it.observe(t, readings(t, empty(), Pose(0.02 * k, 0.0, 0.0)), STILL)
    assert it.restrict(t, Twist(-1.0, 0.0)) == UNRESTRICTED
    it.observe(0.5, readings(0.5, empty(), Pose(2.0, 0.0, 0.0)), STILL)
    assert it.restrict(0.5, Twist(-1.0, 0.0)).share < 1.0


JUMPS = [Pose(0.0, 0.0, 0.0), Pose(1.5, 2.0, 0.0), Pose(0.4, 0.0, 2.0)]


@pytest.mark.parametrize("gap", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("to", JUMPS)
def test_where_odometry_jumps_the_ground_behind_stays_as_it_was_seen(to, gap):
    """The watchdog stops the robot then; reset, it backs off. gap: without odometry before, as
    where its driver is started anew [s]."""
    for post, passes in ((False, True), (True, False)):
        it = watch()

        def look(x, post=post):
            ranges = empty()
            if post:  # 4 cm from its left side; out of view beside the rear in the end
                px, py = 0.9 - x - SENSOR, 0.33
                ranges[np.abs(BEARINGS - math.atan2(py, px)) < 3.0 * STEP] = math.hypot(px, py)
            return ranges

        for k in range(150):
            t, x = 0.02 * k, 0.008 * k
            given = readings(t, look(x), Pose(x, 0.0, 0.0), Twist(0.4, 0.0))
            it.observe(t, given, Twist(0.4, 0.0))
        for k in range(1, round(gap / 0.02)):
            scan = Scan(t + 0.02 * k, 200 + k, look(x), 0.0)
            it.observe(scan.stamp, given._replace(scan=scan), STILL)
            old = it.restrict(scan.stamp, Twist(-0.2, 0.0))
            assert old.reason.endswith("ms old") == (0.02 * k > GAP)
        t += gap
        for k in range(40):
            t += 0.02
            it.observe(t, readings(t, empty(), to), STILL)
            jumped = it.restrict(t, Twist(-0.2, 0.0))
            assert (jumped.share == 0.0) == (k == 0)
            if k == 0:  # a text stays while it lasts
                assert jumped.reason.endswith("ms old" if gap else "the odometry jumped")
        turn = it.restrict(t, Twist(0.0, -2.0))
        assert (turn == UNRESTRICTED) == passes
        if post:
            assert "something" in turn.reason
        assert it.restrict(t, Twist(-0.2, 0.0)) == UNRESTRICTED


def test_a_slow_sweep_that_arrives_late_is_placed_where_it_was_measured():
    """Its first beams are 1.9 s old: the robot has driven 1.5 m since."""
    made = model(rate_hz=1.0, sweep_s=1.0, latency_s=0.9)
    it = CollisionMonitor(described(made, rules(made, PERIOD)))
    speed, wall_at = 0.8, 4.0
    for k in range(176):
        t = 0.02 * k
        begun = max(math.floor((t - 1.9) / 1.0 + 1e-9), 0)  # the newest that has arrived
        along = speed * (begun + np.arange(720) / 719.0) + SENSOR
        ranges = empty()
        ahead = np.abs(BEARINGS) < 0.5
        ranges[ahead] = ((wall_at - along) / np.cos(BEARINGS))[ahead]
        scan = Scan(float(begun), begun, ranges, 1.0) if t >= 1.9 else None
        odometry = Odometry(t, Pose(speed * t, 0.0, 0.0), Twist(speed, 0.0))
        it.restrict(t - PERIOD, Twist(speed, 0.0))
        it.observe(t, Readings(odometry, scan), Twist(speed, 0.0))
    points = it._all.points[it._all.errors > -math.inf]
    assert len(points) > 50
    assert np.abs(points[np.abs(points[:, 1]) < 0.5, 0] - wall_at).max() < 0.02


@pytest.mark.parametrize("back", [Pose(1.25, 0.0, 0.0), Pose(1.6, 0.02, 0.1)])
def test_after_a_gap_odometry_that_went_on_is_no_jump(back):
    """The network was gone, and the robot braked meanwhile."""
    it = watch()
    for k in range(150):
        t, pose = 0.02 * k, Pose(0.008 * k, 0.0, 0.0)
        it.observe(t, readings(t, empty(), pose, Twist(0.4, 0.0)), Twist(0.4, 0.0))
    it.observe(t + 3.0, readings(t + 3.0, empty(), back), STILL)
    assert it.restrict(t + 3.0, Twist(0.2, 0.0)) == UNRESTRICTED


@pytest.mark.parametrize("omega", [0.5, 1.0, 2.0])
def test_while_odometry_is_silent_no_ground_becomes_known(omega):
    """The gate stops the robot, which turned; by its last twist it would turn on and on."""
    it, psi = watch(), 0.0
    for k in range(60):
        t, turns = 0.02 * k, Twist(0.0, omega if k > 50 else 0.0)
        psi += 0.02 * turns.omega
        given = readings(t, empty(), Pose(0.0, 0.0, psi), turns)
        it.observe(t, given, turns)
    before = it.restrict(t, Twist(-1.0, 0.0)).share
    for k in range(150):
        t += 0.02
        it.observe(t, given._replace(scan=Scan(t, 200 + k, empty(), 0.0)), STILL)
    it.observe(t, readings(t, empty(), Pose(0.0, 0.0, psi + 0.1 * omega)), STILL)
    assert it.restrict(t, Twist(-1.0, 0.0)).share == pytest.approx(before, abs=0.06)


def test_an_all_round_lidar_leaves_no_ground_unknown():
    it = watch(field_of_view_deg=360.0, mount_x_m=0.0)
    for t in (1.0, 0.5):  # its clock goes back, too
        it.observe(t, readings(t, empty()), STILL)
        for twist in (Twist(-1.0, 0.0), Twist(0.0, 2.0)):
            assert it.restrict(t, twist) == UNRESTRICTED


def test_the_reason_has_the_side_of_the_obstacle():
    it = standing(empty())
    nothing, unknown = np.zeros(1), np.full(1, -math.inf)
    for point, said in (
        ((0.46, 0.1), "0.10 m ahead"), ((-0.56, 0.1), "0.20 m behind"),
        ((0.1, 0.39), "0.10 m to the left"), ((0.1, -0.31), "0.02 m to the right"),
        ((0.3, 0.2), "0.00 m ahead"), ((0.5, 0.32), "0.14 m ahead"),
    ):  # fmt: skip
        here = np.array([point])
        assert it._where(MonitorSurroundings(here, *[nothing] * 3), 0) == f"something {said}"
        there = MonitorSurroundings(here, unknown, nothing, nothing)
        assert it._where(there, 0) == f"unobserved ground {said}"


def test_returns_below_the_minimum_range_are_named_so():
    """Else who has a driver that says 0, or less, where nothing came back looks for a thing."""
    ranges = empty()
    ranges[len(ranges) // 2] = -math.inf
    found = standing(ranges).restrict(1.0, Twist(0.5, 0.0))
    assert found.share < 1.0
    assert "something closer than the minimum range 0.00 m" in found.reason


def test_a_robot_that_runs_away_is_a_fault():
    it = watch()
    for k in range(100):
        t = 0.02 * k
        pose = Pose(0.2 * t, 0.0, 0.0)
        found = it.observe(t, readings(t, empty(), pose, Twist(0.2, 0.0)), STILL)
        if found.fault:
            break
    assert found.share == 0.0
    assert found.reason == (
        "collision monitor: the robot moves at 0.20 m/s although it is commanded to stand"
    )
    full = 1.0 / BRAKES  # from full speed
    assert DELAY + full + 0.25 < t < DELAY + full + 0.35


def test_odometry_that_does_not_come_any_more_shows_no_robot_that_runs_away():
    """Else a sensor that is silent, or a clock that was set, is called a robot that moves."""
    it = watch()
    for k in range(400):
        t = 0.02 * k
        seen = min(t, 0.2) if t < 6.0 else t
        speed = 0.2 if t < 6.0 else 0.0
        found = it.observe(
            t, readings(seen, empty(), Pose(0.2 * min(seen, 0.2), 0.0, 0.0), Twist(speed, 0.0)),
            Twist(0.2, 0.0) if t < 0.2 else STILL,
        )  # fmt: skip
        assert not found.fault, t


def test_one_that_still_runs_when_its_odometry_comes_back_is_a_fault_at_once():
    it = watch()
    for k in range(400):
        t = 0.02 * k
        seen = min(t, 0.2) if t < 6.0 else t
        found = it.observe(
            t, readings(seen, empty(), Pose(0.2 * seen, 0.0, 0.0), Twist(0.2, 0.0)),
            Twist(0.2, 0.0) if t < 0.2 else STILL,
        )  # fmt: skip
        if found.fault:
            break
    assert 5.99 < t < 6.05


@pytest.mark.parametrize("back", [1.5, 3600.0])
def test_after_the_robots_clock_was_set_back_one_that_runs_away_is_a_fault_as_soon(back):
    it, at = watch(), 3.0
    for k in range(400):
        t = 0.02 * k
        clock = t if t < at else t - back
        speed = 0.0 if t < at + 1.0 else 0.2
        way = 0.2 * max(t - at - 1.0, 0.0)
        found = it.observe(
            clock, readings(clock, empty(), Pose(way, 0.0, 0.0), Twist(speed, 0.0), k), STILL
        )
        if found.fault:
            break
    assert at + 1.2 < t < at + 1.4


def test_a_robot_that_takes_longer_to_stop_turning_has_that_time():
    """As fast as its wheels turn it, and with no more than 2 rad/s^2 to stop that."""
    sally = model()
    limits = {"yaw_rate_radps": None, "yaw_acceleration_radps2": 2.0}
    slow = sally.model_copy(update={"limits": sally.limits.model_copy(update=limits)})
    it = CollisionMonitor(described(slow, rules(slow, PERIOD)))
    spin = 2.0 * sally.limits.wheel_speed_mps / sally.track_m
    for k in range(1000):
        t = 0.02 * k
        sent = Twist(0.0, 0.5) if k < 10 else STILL
        found = it.observe(t, readings(t, empty(), Pose(0.0, 0.0, 0.5 * t)), sent)
        if found.fault:
            break
    assert DELAY + spin / 2.0 + 0.25 < t - 0.2 < DELAY + spin / 2.0 + 0.35


def test_motion_in_the_poses_alone_is_running_away_too():
    it, found = watch(), UNRESTRICTED
    for k in range(100):
        t = 0.02 * k
        found = it.observe(t, readings(t, empty(), Pose(0.0, 0.0, -0.5 * t)), STILL)
    assert found.fault


def test_every_robot_with_a_lidar_is_watched():
    sally = robot("sally")
    assert any(isinstance(m, CollisionMonitor) for m in monitors(sally, rules(sally, PERIOD)))
    blind = sally.model_copy(update={"lidar": None})
    assert not any(isinstance(m, CollisionMonitor) for m in monitors(blind, rules(blind, PERIOD)))
    with pytest.raises(ValueError, match="LiDAR"):
        described(blind, rules(blind, PERIOD))


def test_a_robot_without_limits_is_monitored_too():
    none = dict.fromkeys(
        ("speed_mps", "yaw_rate_radps", "wheel_speed_mps", "wheel_acceleration_mps2")
    )
    limits = robot("sally").limits.model_copy(update=none)
    free = model().model_copy(update={"limits": limits})
    it = CollisionMonitor(described(free, rules(free, PERIOD)))
    it.observe(1.0, readings(1.0, wall(0.1)), STILL)
    assert it.restrict(1.0, Twist(1.0, 0.0)) == UNRESTRICTED  # it stands at once, when told to
    share = it.restrict(1.0, Twist(10.0, 0.0)).share
    assert share == pytest.approx(0.1 / (10.0 * PERIOD), rel=0.05)
    it.observe(1.02, readings(1.02, empty()), Twist(0.2, 0.0))
    for k in range(52, 200):  # it is told to stand, and does not
        t = 0.02 * k
        if it.observe(t, readings(t, empty(), HERE, Twist(0.2, 0.0)), STILL).fault:
            break
    assert t - 1.04 == pytest.approx(DELAY + 0.25, abs=0.03)


def test_what_a_lidar_in_front_sees_behind_a_slow_robot_counts():
    slow = {"speed_mps": 0.2, "yaw_rate_radps": 0.2}
    made = model(field_of_view_deg=360.0)
    made = made.model_copy(update={"limits": made.limits.model_copy(update=slow)})
    it = CollisionMonitor(described(made, rules(made, PERIOD)))
    ranges = empty()
    ranges[[0, -1]] = SENSOR + FRONT + 0.005
    it.observe(1.0, readings(1.0, ranges), STILL)
    assert it.restrict(1.0, Twist(-0.2, 0.0)).share < 1.0


def test_the_same_reading_twice_is_nothing_new():
    it = standing(wall(0.1))
    once = readings(1.02, wall(0.05))
    it.observe(1.02, once, STILL)
    found = it.restrict(1.02, Twist(1.0, 0.0))
    it.observe(1.02, once, STILL)
    assert it.restrict(1.02, Twist(1.0, 0.0)) == found
    assert len(it._measured) == 6
    told = len(it._commanded)
    it.observe(1.02, once, STILL)
    assert len(it._commanded) == told


def test_nothing_near_enough_is_left_out():
    random = np.random.default_rng(3)
    points = random.uniform(-1.0, 1.0, (200, 2))
    margins = random.uniform(0.0, 0.2, 200)
    things = MonitorSurroundings(points, np.zeros(200), margins, np.arange(200.0))
    pose = Pose(0.3, -0.2, 2.0)
    found = seen_by(things, pose, 0.5)
    near = np.hypot(*(points - (0.3, -0.2)).T) <= 0.5 + margins
    assert found.seen.tolist() == np.flatnonzero(near).tolist()
    assert found.points == pytest.approx(seen_from(points[near], pose))


def test_what_left_the_view_after_the_scan_began_is_in_its_view():
    """It turns to the left, and its first beam, on the right, saw that nothing stands there now."""
    it, turning = watch(), Twist(0.0, 1.0)
    for k in range(60):
        t = 0.02 * k
        odometry = Odometry(t, Pose(0.0, 0.0, t), turning)
        it.observe(t, Readings(odometry, None, None, None), turning)
    ranges = empty()
    ranges[np.abs(BEARINGS - (BEARINGS[0] + 0.3)) < STEP] = 0.5
    it.observe(t, Readings(odometry, Scan(0.0, 0, ranges, 0.0), None, None), turning)
    assert len(it._sources[0].by_odometry.points) > 0
    it.observe(t, Readings(odometry, Scan(0.1, 1, empty(), 0.9), None, None), turning)
    assert len(it._sources[0].by_odometry.points) == 0


def test_what_left_the_view_while_the_scan_turned_is_remembered():
    """It turns to the right; the scan's last beam, on the left, does not reach what stood there."""
    it, turning = watch(), Twist(0.0, -1.0)

    def odometry(t):
        return Odometry(t, Pose(0.0, 0.0, -1.0 * t), turning)

    for k in range(60):
        t = 0.02 * k
        it.observe(t, Readings(odometry(t), None, None, None), turning)
    ranges = empty()
    ranges[np.abs(BEARINGS - (BEARINGS[-1] - 0.1)) < STEP] = 0.5
    it.observe(t, Readings(odometry(t), Scan(0.0, 0, ranges, 0.0), None, None), turning)
    assert len(it._sources[0].by_odometry.points) > 0
    it.observe(t, Readings(odometry(t), Scan(0.1, 1, empty(), 0.2), None, None), turning)
    assert len(it._sources[0].by_odometry.points) > 0
    it.observe(t, Readings(odometry(t), Scan(0.1, 2, empty(), 0.05), None, None), turning)
    assert len(it._sources[0].by_odometry.points) == 0


def test_recent_commands_explain_motion_and_old_ones_do_not():
    for ago, explained in ((0.06, True), (0.3, False)):
        it = watch()
        for k in range(50, -1, -1):
            t = 1.0 - 0.02 * k
            sent = Twist(0.5, 0.0) if t < 1.0 - ago else STILL
            it.restrict(t - PERIOD, sent)
            it.observe(t, readings(t, empty(), Pose(0.5 * t, 0.0, 0.0), Twist(0.5, 0.0)), sent)
        assert it._unexplained(Twist(0.5, 0.0)) != explained


def test_a_robot_three_metres_long_only_crawls_onto_ground_it_never_saw():
    """Its LiDAR is at its front, and its rear is farther from that than a small robot's memory of
    the ground reaches."""
    corners = [[1.5, 1.0], [-1.5, 1.0], [-1.5, -1.0], [1.5, -1.0]]
    long = model(mount_x_m=1.4).model_copy(update={"footprint_m": corners, "track_m": 1.6})
    it = CollisionMonitor(described(long, rules(long, PERIOD)))
    for k in range(46, 51):
        it.observe(0.02 * k, readings(0.02 * k, empty()), STILL)
    shares = [it.restrict(1.0, Twist(-v, 0.0)).share * v for v in (0.2, 0.5, 0.8, 1.0)]
    room = VOUCHED + long.reach - 1.5  # vouched for about the turning circle, behind the rear
    assert max(shares) <= fits(room, 1.0, PERIOD, (1.0 - RESERVE) * BRAKES)
    assert it.restrict(1.0, Twist(1.0, 0.0)) == UNRESTRICTED


def test_a_return_behind_counts_as_far_as_it_brakes_though_the_lidar_is_on_a_boom_ahead():
    """All round, 1 m ahead of the outline."""
    boom = model(field_of_view_deg=360.0, mount_x_m=1.4)
    it = CollisionMonitor(described(boom, rules(boom, PERIOD)))
    ranges, gap = empty(), 0.25
    ranges[0] = 1.4 + 0.36 + gap  # straight behind; beam 0 looks back
    for k in range(46, 51):
        it.observe(0.02 * k, readings(0.02 * k, ranges), STILL)
    assert it.restrict(1.0, Twist(-1.0, 0.0)).share < 1.0
