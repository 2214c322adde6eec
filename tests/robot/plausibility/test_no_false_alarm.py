"""What looks odd and is no lie: nothing is stopped for it for good, and mostly nothing at all."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.plausibility.bow import bows
from cohelm.robot.plausibility.content import Content
from cohelm.robot.plausibility.match import Match
from cohelm.robot.plausibility.sight import sighted
from cohelm.robot.plausibility.trail import Trail
from cohelm.robot.port import Scan
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan
from tests.robot.plausibility.watched import (
    NOTHING,
    PERIOD,
    ROOM,
    SALLY,
    person,
    watched,
    without_noise,
)

NOTHING_AHEAD = np.array([[-9, -2, 90, -2], [-9, 2, 90, 2]], dtype=np.float64)


def ahead(t: float) -> Twist:
    return Twist(0.5 if t < 7.0 else 0.0, 0.0)


def winding(t: float) -> Twist:
    return Twist(0.4, 0.8 * math.sin(t)) if t < 8.0 else Twist(-0.3, 0.0)


def standing(_: float) -> Twist:
    return Twist(0.0, 0.0)


def spinning(t: float) -> Twist:
    return Twist(0.0, 1.8 if t % 6.0 < 3.0 else -1.8)


@pytest.mark.parametrize("drive", [ahead, winding, standing, spinning])
@pytest.mark.parametrize("seed", [1, 2])
def test_no_alarm_in_a_room_however_it_is_driven(drive, seed):
    assert watched(drive, 12.0, seed=seed) == []


@pytest.mark.parametrize("drive", [ahead, winding])
def test_after_future_stamps_all_readings_are_accepted_again(drive):
    """Scans without odometry of their time are not compared with where it said the robot was."""

    def told(t, readings, _):
        stamp = readings.odometry.stamp + (86_400.0 if 2.0 < t < 3.0 else 0.0)
        return readings._replace(odometry=readings.odometry._replace(stamp=stamp))

    assert watched(drive, 6.0, told=told) == []


def test_odometry_stamps_that_step_back_count_as_no_distance_driven_backwards():
    """A robot whose scans have become empty drives only so far until it crawls."""
    lidar = SALLY.lidar.model_copy(update={"range_max_m": 3.0})

    def reported(back):
        def told(t, readings, _):
            if t < 1.0:
                return readings
            odometry, scan = readings.odometry, readings.scan
            empty = scan._replace(ranges=np.full_like(scan.ranges, np.inf))
            stepped = odometry._replace(stamp=odometry.stamp - back)
            return readings._replace(scan=empty, odometry=stepped)

        found = watched(
            lambda t: Twist(0.5, 0.0), 10.0, told=told,
            model=SALLY.model_copy(update={"lidar": lidar}), walls=NOTHING_AHEAD,
        )  # fmt: skip
        return [t for t, r in found if "shows nothing at all" in r.reason]

    assert reported(0.0)
    assert reported(3600.0)


def held_up(at: float, longest: float = 0.1):
    """The process is held up between measuring a pose and stamping it."""
    kept = []

    def told(t, readings, _):
        if not at <= t < at + longest + 0.5 * PERIOD:
            kept[1:] = []
            kept[:1] = [readings.odometry]
            return None
        kept.append(readings.odometry)
        late = kept[1]._replace(stamp=t) if t > at + longest - 0.5 * PERIOD else kept[0]
        return readings._replace(odometry=late)

    return told


@pytest.mark.parametrize("drive", [ahead, spinning])
def test_no_alarm_when_a_pose_is_stamped_late_as_its_process_was_held_up(drive):
    blind = SALLY.model_copy(update={"lidar": None})
    assert watched(drive, 3.0, told=held_up(2.0), model=blind) == []


def test_a_jump_right_after_a_pose_that_was_stamped_late_is_still_one():
    late = held_up(2.0)

    def told(t, readings, simulated):
        o = readings.odometry
        if t > 2.11:
            jumped = o.pose._replace(x=o.pose.x + 0.06)
            readings = readings._replace(odometry=o._replace(pose=jumped))
        return late(t, readings, simulated) or readings

    blind = SALLY.model_copy(update={"lidar": None})
    found = watched(ahead, 3.0, told=told, model=blind)
    assert found[0][1].fault
    assert "the odometry jumped by 0.12 m against its speed" in found[0][1].reason
    assert found[0][0] < 2.13


@pytest.mark.parametrize("drive", [standing, winding])
def test_no_alarm_where_neither_lidar_nor_odometry_has_noise(drive):
    assert watched(drive, 8.0, model=without_noise()) == []


def test_no_alarm_along_a_corridor_that_shows_no_motion():
    corridor = np.array([[-50.0, -1.0, 80.0, -1.0], [-50.0, 1.0, 80.0, 1.0]])
    assert watched(ahead, 12.0, walls=corridor) == []


def test_no_alarm_among_people_who_walk():
    people = [person(4.0 + k, -2.0 - 0.8 * k, -0.2 * k, 0.9 + 0.1 * k) for k in range(6)]
    people += [person(-2.0, 0.6, 0.9, 0.0), person(1.2, -0.8, 0.5, 0.0)]
    assert watched(ahead, 10.0, people=people) == []


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_alarm_when_only_people_walking_away_are_in_view(seed):
    rng = np.random.default_rng(seed)
    people = []
    for bearing in rng.uniform(-2.2, 2.2, 12):
        c, s, r = math.cos(bearing), math.sin(bearing), rng.uniform(1.0, 4.0)
        people.append(person(r * c, r * s, 0.3 + 1.5 * c, 1.5 * s))
    found = watched(ahead, 3.0, walls=NOTHING, people=people, seed=seed)
    assert not any("at once" in one.reason for _, one in found)


def test_no_alarm_when_someone_walks_beside_the_robot_in_a_corridor():
    corridor = np.array([[-50.0, -1.5, 80.0, -1.5], [-50.0, 1.5, 80.0, 1.5]])
    group = [person(1.5, 0.7, 0.5, 0.0), person(1.6, -0.7, 0.5, 0.0), person(2.4, 0.0, 0.5, 0.0)]
    assert watched(ahead, 7.0, walls=corridor, people=group) == []


def test_no_alarm_beside_one_oblique_wall_along_which_people_walk():
    """It tells the way aside only by the way ahead, and that is told by people."""
    along = np.array([math.cos(math.radians(40.0)), math.sin(math.radians(40.0))])
    middle = np.array([3.0, 0.0]) + 3.5 * np.array([along[1], -along[0]])
    wall = np.array([[*(middle - 12.0 * along), *(middle + 12.0 * along)]])
    people = [person(1.5 + 1.2 * k, 1.0 + 0.3 * k, *(-0.3 * along)) for k in range(3)]
    assert watched(ahead, 9.0, walls=wall, people=people) == []


def test_an_oblique_wall_tells_neither_the_way_ahead_nor_aside_and_a_corner_both():
    square = np.array([math.cos(0.6), math.sin(0.6), 0.0])
    other = np.array([-math.sin(0.6), math.cos(0.6), 0.0])
    wall = 100.0 * np.outer(square, square)
    corner = wall + 40.0 * np.outer(other, other)
    for x, y in ((1.0, 0.0), (0.0, 1.0)):
        assert Match(np.zeros(3), wall, 0.0, 0.0).seen(x, y) < 3.0
        assert Match(np.zeros(3), corner, 0.0, 0.0).seen(x, y) > 40.0
    assert Match(np.zeros(3), wall, 0.0, 0.0).seen(*square[:2]) > 99.0


def test_an_apparent_motion_of_a_few_people_does_not_count():
    # the last look of crowd 66 of seed 2504: of the way aside one point's worth was seen
    people = np.diag([14.0, 1.0, 27.0])
    match = Match(np.array([0.01, 0.12, -0.03]), people, 0.6, 0.0)
    assert match.way(10.0) == pytest.approx(0.01)
    assert match._replace(correction=np.array([0.12, 0.01, 0.0])).way(10.0) == pytest.approx(0.12)
    walls = np.diag([40.0, 40.0, 200.0])
    assert match._replace(information=walls).way(10.0) == pytest.approx(np.hypot(0.01, 0.12))


@pytest.mark.parametrize("pace", [1.0, 2.0])
def test_no_alarm_when_a_group_walks_abreast_behind_a_corner(pace):
    """Two metres of people in one piece, before nothing else: gone one after the other."""
    corner = np.array([[2.5, 1.0, 2.5, 5.0], [-1.0, -3.0, -1.0, 3.0], [-1.0, -3.0, 1.0, -3.0]])
    group = [person(3.2, -1.5 - 0.5 * k - 2.0 * pace, 0.0, pace) for k in range(4)]
    said = watched(standing, 8.0, walls=corner, people=group)
    assert said == []


@pytest.mark.parametrize("drive", [standing, ahead])
def test_no_alarm_when_a_sliding_door_opens_into_nothing(drive):
    """Two leaves, a metre each, half a metre a second each, as people have to be able to get out
    of their way."""
    lidar, made = SALLY.lidar.lidar(), {}
    room = np.array([[6, -2, -3, -2], [-3, -2, -3, 2], [-3, 2, 6, 2], [6, 2, 6, 1], [6, -1, 6, -2]])

    def told(t, readings, robot):
        shot = readings.scan
        if shot is None:
            return None
        if shot.number not in made:
            apart = min(max(0.5 * (shot.stamp - 2.0), 0.0), 1.0)
            leaves = np.array([[6.0, -1.0 - apart, 6.0, -apart], [6.0, apart, 6.0, 1.0 + apart]])
            seen = np.empty(len(lidar.beams))
            scan(robot.truth().pose, lidar, np.empty((0, 6)), leaves, NO_GRID, 9, shot.number, seen)
            made[shot.number] = np.fmin(seen, shot.ranges)
        return readings._replace(scan=shot._replace(ranges=made[shot.number]))

    assert watched(drive, 6.0, walls=np.asarray(room, dtype=np.float64), told=told) == []


@pytest.mark.parametrize("radius", [2.5, 4.0, 8.0])
def test_no_alarm_in_a_round_room(radius):
    """Its wall is bowed, but it does not go along with the LiDAR."""
    angle = np.linspace(0.0, 2.0 * math.pi, 91)
    ring = np.column_stack((0.3 + radius * np.cos(angle), 0.2 + radius * np.sin(angle)))

    def slowly(t: float) -> Twist:
        return Twist(0.4 if t < 2.0 * radius - 1.5 else 0.0, 0.0)

    assert watched(slowly, 8.0, walls=np.hstack((ring[:-1], ring[1:]))) == []


def test_of_a_straight_wall_no_view_is_sure_that_it_is_bowed():
    """The end of a wall, seen over some 30 degrees: with ranges two metres too long all of it would
    stand at the LiDAR, and fit as well."""
    lidar, trail = SALLY.lidar.lidar(), Trail(5)
    trail.add(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    wall, seen, told = np.array([[-1.5, 2.1, 0.5, 2.1]]), np.empty(len(lidar.beams)), []
    for seed in range(400):
        scan(Pose(0.0, 0.0, 0.0), lidar, np.empty((0, 6)), wall, NO_GRID, seed, 0, seen)
        told += bows(sighted(lidar, seen, 0.0, 0.0, trail), lidar)
    assert all(one.bias < 3.0 * one.sigma for one in told)


def test_no_alarm_when_scans_are_lost():
    last = []

    def told(t, readings, _):
        lost = 2.0 < t < 2.3 or 4.0 < t < 4.2
        if not lost:
            last[:] = [readings.scan]
        return readings._replace(scan=last[0])

    assert watched(ahead, 8.0, told=told) == []


def test_an_open_field_is_driven_slowly_and_nothing_is_stopped():
    said = watched(ahead, 6.0, walls=NOTHING)
    assert said
    assert not any(one.fault or one.share == 0.0 for _, one in said)
    assert "does not confirm free space" in said[-1][1].reason


def test_a_robot_that_leaves_a_hall_is_not_stopped():
    wall = np.array([[-1.0, -3.0, -1.0, 3.0], [-1.0, 3.0, 0.5, 3.0], [-1.0, -3.0, 0.5, -3.0]])
    said = watched(ahead, 5.0, walls=wall)
    assert not any(one.fault or one.share == 0.0 for _, one in said)


@pytest.mark.parametrize("off", [(0.5, 0.3, 0.0), (0.0, 0.0, 0.6), (2.0, 0.5, -1.0)])
def test_a_push_holds_the_robot_for_a_moment_and_is_no_fault(off):
    pushed = []

    def told(t, _, robot):
        if t > 3.0 and not pushed:
            pushed.append(t)
            robot.push(*off)

    said = watched(lambda t: Twist(0.3, 0.0) if t < 11.5 else Twist(0.0, 0.0), 12.5, told=told)
    assert said
    assert not any(one.fault for _, one in said)
    assert 3.0 <= said[0][0] < 3.4
    # It crawls until scans and odometry have agreed again, and, as all that is seen is another,
    # until walls have shown how far they are, or over 2 m.
    assert said[-1][0] < 11.0
    assert sum(one.share == 0.0 for _, one in said) * 0.02 < 1.5


def test_carrying_an_idle_robot_is_no_fault():
    def told(t, _, robot):
        if 2.0 < t < 4.0:
            robot.push(0.01, 0.004, 0.005)

    said = watched(standing, 8.0, told=told)
    assert not any(one.fault for _, one in said)
    assert all(2.0 < t < 5.0 for t, _ in said)


def test_no_alarm_of_a_robot_without_a_lidar():
    blind = SALLY.model_copy(update={"lidar": None})
    assert watched(winding, 4.0, model=blind, walls=ROOM) == []


def test_the_nearest_of_many_pixels_that_are_rounded_is_no_repeat_but_a_frozen_picture_is():
    """Of a wall 1.5 m ahead, 200 rows with 0.7 mm of noise, rounded to the millimetre."""
    model = LidarModel(beams=300, field_of_view_deg=55.0, noise_m=0.02, height_band_m=(0.1, 1.0),
                       depth_image=True)  # fmt: skip
    lidar, rng = model.lidar(), np.random.default_rng(5)
    content = Content(model)
    for k in range(120):
        rows = np.rint(1e3 * rng.normal(1.5, 0.0007, (200, 300))).min(axis=0)
        ranges = 1e-3 * rows / lidar.beams[:, 0]
        assert content.look(Scan(0.1 * k, k, ranges, 0.0)) == []
    (found,) = content.look(Scan(12.0, 120, ranges, 0.0))
    assert "repeats an earlier one" in found.reason
