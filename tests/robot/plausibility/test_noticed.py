"""What can not be is noticed, within the time that docs/plausibility.md says, and said."""

import math
import re

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.plausibility.bow import RangeBias, bows
from cohelm.robot.plausibility.content import CAREFUL, CRAWL
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.plausibility.sight import sighted
from cohelm.robot.plausibility.source import Arrival
from cohelm.robot.plausibility.trail import Trail
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan
from tests.robot.plausibility.watched import PERIOD, SALLY, watched

AT = 3.0
SCAN = 0.1


def ahead(t: float) -> Twist:
    return Twist(0.4, 0.0) if t < 9.0 else Twist(0.0, 0.0)


def turning(t: float) -> Twist:
    return Twist(0.3, 0.4)


def of_scan(change):
    """From AT on each new scan is changed, once."""
    made: list = []

    def told(t, readings, _):
        scan = readings.scan
        if t < AT:
            made[:] = [scan, scan, scan]
            return None
        if made[0].number != scan.number:
            made[:] = [scan, change(scan, made[2]), made[2]]
            return readings._replace(scan=made[1])
        return readings._replace(scan=made[1])

    return told


def ranges(change):
    return of_scan(lambda scan, old: scan._replace(ranges=change(scan.ranges.copy(), old.ranges)))


def front(r, value):
    r[240:480] = value
    return r


IMPOSSIBLE = {
    "repeats": ranges(lambda r, old: old),
    "repeats, mirrored": of_scan(lambda scan, old: scan),  # replaced below
    "same 9.99 m": ranges(lambda r, old: np.full(len(r), 9.99)),
    "beams instead of 720": ranges(lambda r, old: r[:360]),
    "number stays": of_scan(lambda scan, old: scan._replace(number=old.number)),
    "numbers went back": of_scan(lambda scan, old: scan._replace(number=scan.number - 10)),
    "stamps stand still": of_scan(lambda scan, old: scan._replace(stamp=old.stamp)),
    "stamps went back by 0.80 s, as if a clock was set": of_scan(
        lambda scan, old: scan._replace(stamp=old.stamp - 0.8)
    ),
    "more often": of_scan(
        lambda scan, old: scan._replace(stamp=old.stamp + 0.01 * (scan.number - old.number))
    ),
}
last: list = [np.full(720, 3.0)]


def _mirrored(scan, old):
    before, last[0] = last[0], scan.ranges
    return scan._replace(ranges=before[::-1].copy()) if scan.number % 2 else scan


IMPOSSIBLE["repeats, mirrored"] = of_scan(_mirrored)


@pytest.mark.parametrize("said", list(IMPOSSIBLE))
def test_a_scan_that_can_not_be_is_a_fault_within_two_scans_or_three(said):
    found = watched(ahead, AT + 1.0, told=IMPOSSIBLE[said])
    faults = [(t, one.reason) for t, one in found if one.fault]
    assert faults
    assert faults[0][0] <= AT + (3.5 if said == "more often" else 2.5) * SCAN
    assert said in faults[0][1]


REAR = robot("sally-rear").model_copy(update={"camera": None})


def behind(change):
    """The same changes on the scans of the rear LiDAR."""

    def told(t, readings, plant):
        if not readings.further:
            return None
        given = change(t, readings._replace(scan=readings.further[0]), plant)
        return given and readings._replace(further=(given.scan,))

    return told


def test_two_consistent_lidars_are_accepted():
    assert watched(ahead, AT + 1.0, model=REAR) == []


@pytest.mark.parametrize("said", ["repeats", "number stays"])
def test_a_rear_scan_that_can_not_be_is_a_fault_and_named(said):
    found = watched(ahead, AT + 1.0, model=REAR, told=behind(IMPOSSIBLE[said]))
    faults = [(t, one.reason) for t, one in found if one.fault]
    assert faults[0][0] <= AT + 2.5 * SCAN
    assert faults[0][1].startswith("rear LiDAR: ")
    assert said in faults[0][1]


def test_a_rear_lidar_that_was_blind_from_the_start_is_backed_at_a_crawl_and_forward_is_free():
    blind = behind(lambda t, readings, _: readings._replace(
        scan=readings.scan._replace(ranges=front(readings.scan.ranges.copy(), math.inf))
    ))  # fmt: skip
    found = watched(lambda t: Twist(-0.4, 0.0), 2.0, model=REAR, told=blind)
    assert found[0][1].reason.startswith("rear LiDAR: the LiDAR has not shown that it sees")
    assert watched(lambda t: Twist(0.4, 0.0), 2.0, model=REAR, told=blind) == []


def test_one_scan_that_was_read_late_and_stamped_when_it_was_read_is_no_fault():
    arrival = Arrival(SALLY.lidar)
    for k, stamp in enumerate((0.0, 0.1, 0.277, 0.3, 0.4, 0.58, 0.6, 0.7)):
        scan = Scan(stamp, k, np.full(720, 3.0), 0.0)
        assert arrival.take(stamp, scan) == []


def test_a_quarter_that_goes_blind_stops_the_robot_at_once_and_faults_it():
    found = watched(ahead, AT + 1.0, told=ranges(lambda r, old: front(r, math.inf)))
    assert found[0][0] <= AT + 1.5 * SCAN
    assert found[0][1].share == 0.0
    assert "vanished" in found[0][1].reason
    assert any(one.fault and "empty where things stood" in one.reason for _, one in found)


def test_a_quarter_that_was_blind_from_the_start_is_not_driven_into_but_at_a_crawl():
    def told(t, readings, _):
        blind = front(readings.scan.ranges.copy(), math.inf)
        return readings._replace(scan=readings.scan._replace(ranges=blind))

    found = watched(ahead, 2.0, told=told)
    assert found[0][0] < 0.2
    assert "has not shown that it sees" in found[0][1].reason
    assert all(one.share <= CRAWL / 0.02 for _, one in found)


@pytest.mark.parametrize("wide", [0.3, 0.58, 1.5])
def test_the_width_of_the_robot_has_to_have_been_seen_ahead(wide):
    """Blind from the start as far to either side as the robot is wide half a metre before it, 30
    deg at most; beside that it sees."""
    half = 0.5 * wide
    model = SALLY.model_copy(
        update={"footprint_m": [[0.36, half], [-0.36, half], [-0.36, -half], [0.36, -half]]}
    )
    lidar = model.lidar.lidar()
    dead = min(math.atan2(half, 0.5), math.radians(30.0)) + math.radians(6.0)
    bearings = np.abs(lidar.first + lidar.step * np.arange(len(lidar.beams)))

    def told(t, readings, _):
        blind = np.where(bearings < dead, math.inf, readings.scan.ranges)
        return readings._replace(scan=readings.scan._replace(ranges=blind))

    found = watched(ahead, 1.0, told=told, model=model)
    assert "has not shown that it sees" in found[0][1].reason
    assert watched(ahead, 1.0, model=model) == []


WORSE = {
    "noisy": ranges(lambda r, old: np.clip(r + 0.2 * np.sin(1e5 * r), 0.1, 11.0)),
    "not a number": ranges(lambda r, old: np.where(np.arange(len(r)) % 5 < 2, math.nan, r)),
    "see nothing": ranges(lambda r, old: np.where(np.arange(len(r)) % 3 == 0, math.inf, r)),
    "ms late": of_scan(lambda scan, old: scan._replace(stamp=scan.stamp - 0.15)),
}


@pytest.mark.parametrize("said", list(WORSE))
def test_a_scan_that_is_worse_than_it_should_be_slows_the_robot(said):
    found = watched(lambda t: Twist(0.4, 0.0), AT + 1.5, told=WORSE[said])
    if said != "ms late":
        assert found[0][0] <= AT + 4.0 * SCAN
    slows = [one for _, one in found if said in one.reason]
    assert slows
    assert slows[-1].share == pytest.approx(CAREFUL / 0.4, rel=0.2)


def of_odometry(change):
    held: list = []

    def told(t, readings, _):
        if t < AT:
            held[:] = [readings.odometry]
            return None
        return readings._replace(odometry=change(readings.odometry, held[0]))

    return told


WHEELS = {
    "odometry jumped by": of_odometry(
        lambda o, held: o._replace(pose=Pose(o.pose.x + 0.08, o.pose.y, o.pose.psi))
    ),
    "pose and speed": of_odometry(lambda o, held: o._replace(pose=held.pose)),
    "where 0.40 m/s is commanded": of_odometry(
        lambda o, held: o._replace(
            pose=Pose(held.pose.x, held.pose.y, o.pose.psi), twist=Twist(0.0, 0.0)
        )
    ),
    "pose and yaw rate": of_odometry(
        lambda o, held: o._replace(twist=Twist(o.twist.v, o.twist.omega + 0.2))
    ),
}


@pytest.mark.parametrize("said", list(WHEELS))
def test_odometry_against_itself_and_the_command_is_a_fault_within_half_a_second(said):
    blind = SALLY.model_copy(update={"lidar": None})
    found = watched(ahead, AT + 1.0, told=WHEELS[said], model=blind)
    faults = [(t, one.reason) for t, one in found if one.fault]
    assert faults
    assert faults[0][0] <= AT + 0.56
    assert said in faults[0][1]


def test_an_idle_robot_may_be_pushed():
    blind = SALLY.model_copy(update={"lidar": None})

    def told(t, readings, _):
        if AT < t < AT + 1.0:
            o = readings.odometry
            x = 0.4 * (t - AT)
            return readings._replace(odometry=Odometry(o.stamp, Pose(x, 0.0, 0.0), Twist(0.4, 0.0)))
        if t >= AT + 1.0:
            o = readings.odometry
            return readings._replace(odometry=o._replace(pose=Pose(0.4, 0.0, 0.0)))
        return None

    found = watched(lambda t: Twist(0.0, 0.0), AT + 3.0, told=told, model=blind)
    assert found
    assert not any(one.fault for _, one in found)
    assert found[-1][0] < AT + 1.8


MOTION = {
    "frozen, with new noise": (
        ahead, ranges(lambda r, old: old + 0.02 * np.random.default_rng(int(1e6 * r[3])).normal(
            size=len(r)))
    ),
    "turned by a quarter": (ahead, ranges(lambda r, old: np.roll(r, 240))),
    "mirrored": (turning, ranges(lambda r, old: r[::-1].copy())),
}  # fmt: skip


@pytest.mark.parametrize("lie", list(MOTION))
def test_scans_that_show_another_motion_than_odometry_stop_the_robot(lie):
    drive, told = MOTION[lie]
    found = watched(drive, AT + 1.0, told=told)
    assert found
    assert found[0][0] <= AT + 0.4
    assert found[0][1].share == 0.0


@pytest.mark.parametrize(
    ("exchanged", "told"),
    [
        (True, lambda t, readings, _: readings._replace(
            scan=readings.scan and readings.scan._replace(ranges=readings.scan.ranges[::-1].copy())
        )),
        (True, lambda t, readings, _: readings._replace(odometry=readings.odometry._replace(
            pose=readings.odometry.pose._replace(psi=-readings.odometry.pose.psi),
            twist=Twist(readings.odometry.twist.v, -readings.odometry.twist.omega),
        ))),
        (False, MOTION["turned by a quarter"][1]),
        (False, MOTION["frozen, with new noise"][1]),
    ],
)  # fmt: skip
def test_a_sensor_that_takes_left_for_right_is_told_from_other_disagreements(exchanged, told):
    found = watched(lambda t: Twist(0.1, 0.2), AT + 1.0, told=told)
    said = [one.reason for _, one in found if "disagree: in" in one.reason]
    assert any(": one of them takes left for right" in one for one in said) == exchanged
    assert all(len(one) <= 128 for one in said)  # as the link has room for


@pytest.mark.parametrize("back", [1.5, 3600.0])
@pytest.mark.parametrize("lie", list(MOTION))
def test_after_the_robots_clock_was_set_back_a_lie_is_noticed_as_soon(lie, back):
    """The gate faults for it; after the reset all has to be looked at as before."""
    drive, told = MOTION[lie]
    at = AT - 1.2
    found = watched(drive, AT + 1.0, told=told, clock=lambda t: t if t < at else t - back)
    assert found
    assert AT <= found[0][0] <= AT + 0.4
    assert found[0][1].share == 0.0


def test_a_limit_ends_after_its_cause_though_the_clock_was_set_back_meanwhile():
    def told(t, readings, _):
        if t > AT:
            return None
        worse = readings.scan.ranges + np.random.default_rng(int(1e4 * t)).normal(0, 0.1, 720)
        return readings._replace(scan=readings.scan._replace(ranges=worse))

    def last(clock):
        found = watched(ahead, AT + 4.0, told=told, clock=clock)
        assert any("noisy" in one.reason for t, one in found if t < AT)
        return found[-1][0]

    assert last(lambda t: t if t < AT else t - 3600.0) <= last(lambda t: t) + 0.1


def test_a_mount_that_is_five_degrees_off_slows_the_robot_within_metres():
    def told(t, readings, _):
        turned = np.roll(readings.scan.ranges, round(5.0 * 719 / 270))
        return readings._replace(scan=readings.scan._replace(ranges=turned))

    found = watched(lambda t: Twist(0.4, 0.0), 9.0, told=told)
    reasons = [one.reason for _, one in found]
    assert any("beside that of the wheels" in reason for reason in reasons)
    assert not any(one.fault for _, one in found)


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_odometry_with_a_wrong_scale_is_detected_within_metres(share):
    def told(t, readings, _):
        o = readings.odometry
        pose = Pose(share * o.pose.x, share * o.pose.y, o.pose.psi)
        return readings._replace(
            odometry=o._replace(pose=pose, twist=Twist(share * o.twist.v, o.twist.omega))
        )

    found = watched(lambda t: Twist(0.4, 0.0), 9.0, told=told)
    assert found
    assert "scans" in found[0][1].reason


def test_a_circle_of_returns_that_moves_with_the_robot_is_no_agreement():
    """As slow as it may be after its scans have changed; the circle's points are so far apart that
    few fall on half a metre of it."""
    noise = np.random.default_rng(4)
    found = watched(
        lambda t: Twist(0.4 if t < AT else 0.07, 0.0), AT + 7.0,
        told=ranges(lambda r, _: noise.normal(9.99, 0.02, len(r))),
    )  # fmt: skip
    assert found[0][0] <= AT + 1.5 * SCAN
    assert found[0][1].share == 0.0
    assert any(one.fault and "disagree" in one.reason for _, one in found)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ranges_that_are_all_half_a_metre_too_long_slow_the_robot_to_a_crawl(seed):
    """From the very first scan on, so that nothing ever changes."""

    def told(t, readings, _):
        longer = np.minimum(readings.scan.ranges + 0.5, SALLY.lidar.range_max_m)
        return readings._replace(scan=readings.scan._replace(ranges=longer))

    found = watched(ahead, 4.0, told=told, seed=seed)
    assert found
    first, _ = found[0]
    assert first <= 3.75  # after ten places 15 cm apart, at 0.4 m/s
    assert all(one.share <= CRAWL / 0.4 * 1.1 for t, one in found if t > first + 0.5)
    said = [re.search(r"seem (\d\.\d\d) m too long", one.reason) for _, one in found]
    assert all(one and abs(float(one[1]) - 0.5) < 0.15 for one in said)


def test_ranges_that_all_grow_by_0_2_m_at_once_are_noticed_and_crawled_after():
    longer = ranges(lambda r, _: np.minimum(r + 0.2, SALLY.lidar.range_max_m))
    found = watched(ahead, AT + 3.0, told=longer)
    assert found[0][0] <= AT + 1.5 * SCAN
    assert "all walls are 0.20 m farther than" in found[0][1].reason
    assert not any(one.fault for _, one in found)
    after = [one for t, one in found if t > AT + 1.0]
    assert len(after) >= 1.9 / PERIOD  # for as long as it did not go two metres
    assert all(one.share <= CRAWL / 0.4 + 0.01 for one in after)


@pytest.mark.parametrize("rate", [0.04, 0.05, 0.1])
def test_ranges_that_grow_little_by_little_are_noticed_when_they_are_12_cm_longer(rate):
    def growing(t, readings, _):
        longer = readings.scan.ranges + rate * max(readings.scan.stamp - AT, 0.0)
        return readings._replace(scan=readings.scan._replace(ranges=longer))

    found = watched(ahead, AT + 4.0, told=growing)
    first, one = found[0]
    assert first <= AT + 0.12 / rate + 0.75
    assert "farther than" in one.reason


@pytest.mark.parametrize("way", [-0.2, -0.1, 0.1, 0.2])
def test_a_push_is_not_taken_for_ranges_that_grow(way):
    def pushed(t, readings, _):
        odometry = readings.odometry
        x = odometry.pose.x + (way if t >= AT else 0.0)  # the wheels went, the robot did not
        return readings._replace(odometry=odometry._replace(pose=odometry.pose._replace(x=x)))

    assert not any("farther than" in one.reason for _, one in watched(ahead, 5.0, told=pushed))


def test_a_wall_says_how_much_too_long_all_ranges_are():
    lidar, trail = SALLY.lidar.lidar(), Trail(5)
    trail.add(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    walls, nobody = np.array([[-3.0, -1.5, 5.0, -1.5], [5.0, -1.5, 5.0, 2.0]]), np.empty((0, 6))
    ranges = np.empty(len(lidar.beams))
    scan(Pose(0.0, 0.0, 0.1), lidar, nobody, walls, NO_GRID, 3, 7, ranges)
    for bias in (0.0, 0.2, 0.5, 1.0):
        found = bows(sighted(lidar, ranges + bias, 0.0, 0.0, trail), lidar)
        best = min(found, key=lambda bow: bow.sigma)
        assert best.sigma < 0.3
        assert abs(best.bias - bias) < 0.1


def test_one_bowed_wall_shows_no_range_bias_however_often_it_is_seen():
    """A bay of 4 m radius, on the way to it and turning before it; two walls are believed."""
    lidar, nobody = SALLY.lidar.lidar(), np.empty((0, 6))
    angles = np.linspace(-0.35, 0.35, 30)
    bay = np.column_stack((4.0 * np.cos(angles), 4.0 * np.sin(angles)))
    walls = np.column_stack((bay[:-1], bay[1:]))
    corner = np.array([[-3.0, -1.5, 4.0, -1.5], [4.0, -1.5, 4.0, 2.0]])
    poses = [Pose(0.15 * k, 0.0, 0.0) for k in range(12)]
    poses += [Pose(1.65, 0.0, 0.35 * k) for k in (-2, -1, 1, 2)]

    def told(seen, bias):
        judged, ranges, said = RangeBias(lidar), np.empty(len(lidar.beams)), []
        for number, pose in enumerate(poses):
            trail = Trail(5)
            trail.add(float(number), *pose, 0.0, 0.0)
            scan(pose, lidar, nobody, seen, NO_GRID, 3, number, ranges)
            judged.take(sighted(lidar, ranges + bias, float(number), 0.0, trail), doubted=False)
            said.append(judged.bias)
        return said

    assert max(told(walls, 0.0)) == 0.0
    assert max(told(walls, 0.5)) == 0.0
    assert max(told(corner, 0.5)) == pytest.approx(0.5, abs=0.1)


def test_it_raises_nothing_whatever_it_reads():
    monitor = PlausibilityMonitor(SALLY)
    nan = math.nan
    good = np.full(720, 3.0)
    for k, (t, o, s) in enumerate(
        [
            (0.0, None, None),
            (0.02, Odometry(nan, Pose(0, 0, 0), Twist(0, 0)), Scan(nan, 0, good, 0.0)),
            (0.04, Odometry(0.04, Pose(nan, 0, 0), Twist(0, 0)), Scan(0.0, 1, good * nan, 0.0)),
            (0.06, Odometry(0.06, Pose(0, 0, 0), Twist(0, 0)), Scan(0.05, 2, good[:0], 0.0)),
            (0.08, Odometry(0.08, Pose(0, 0, 0), Twist(0, 0)), Scan(0.07, 3, good * math.inf, 0.0)),
            (0.2, Odometry(0.2, Pose(0, 0, 0), Twist(0, 0)), Scan(0.2, 4, -good * math.inf, 0.0)),
            (nan, Odometry(0.3, Pose(0, 0, 0), Twist(0, 0)), Scan(0.3, 5, good, nan)),
            (-5.0, Odometry(-5.0, Pose(0, 0, 0), Twist(0, 0)), Scan(-5.0, 6, good, 0.5)),
            (9.0, Odometry(9.0, Pose(0, 0, 9e9), Twist(9e9, 9e9)), Scan(8.9, 7, good * 9e9, 0.1)),
        ]
    ):
        assert 0.0 <= monitor.observe(t, Readings(o, s, None, None), Twist(0, 0)).share <= 1.0, k
        assert 0.0 <= monitor.restrict(t, Twist(0.5, -1.0)).share <= 1.0
