"""What counts of what was seen."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.odometry import PoseHistory, placed
from cohelm.robot.collision_monitor.returns import SURE, Returns, Sensor
from cohelm.robot.collision_monitor.surroundings import (
    BESIDE,
    GRAIN,
    NOTHING,
    REMEMBERED,
    MonitorSurroundings,
    ScanWithPoses,
    all_round,
    joined,
    looked_past,
    of_scan,
    out_of_sight,
)
from cohelm.robot.port import Scan


def sensor(view_deg, beams=720, mount=Pose(0.3, 0.0, 0.0)):  # noqa: B008, a value
    view = math.radians(view_deg)
    step = view / (beams if view_deg == 360.0 else beams - 1)
    bearings = -0.5 * step * (beams - 1) + step * np.arange(beams)
    return Sensor(mount, bearings, step, 0.06, 0.02, 10.0, 0.0, 0.0)


def things(*points, seen=0.0):
    n = len(points)
    return MonitorSurroundings(
        np.array(points, dtype=float).reshape(-1, 2), np.full(n, 0.01), np.full(n, 0.03),
        np.full(n, seen),
    )  # fmt: skip


HERE = Pose(0.0, 0.0, 0.0)


def test_each_beam_is_placed_from_where_the_robot_was_then():
    poses = PoseHistory()
    for k in range(11):
        poses.add(1.0 + 0.01 * k, Pose(0.01 * k, 0.0, 0.02 * k), Twist(1.0, 2.0))
    found = Returns(
        np.array([[1.0, 0.0], [1.0, 0.5], [0.0, 1.0]]), np.array([0.01, 0.02, 0.03]),
        np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.5, 1.0]),
    )  # fmt: skip
    placed_there = of_scan(found, Scan(1.02, 0, np.zeros(3), 0.06), poses)
    assert placed_there.seen == pytest.approx([1.02, 1.05, 1.08])
    for i in range(3):
        then = np.array([poses.at(placed_there.seen[i])]).T
        assert placed_there.points[i] == pytest.approx(placed(found.points[i : i + 1], *then)[0])
    assert placed_there.errors.tolist() == [0.01, 0.02, 0.03]
    assert placed_there.margins.tolist() == [0.1, 0.2, 0.3]


def test_a_scan_of_nothing_is_nothing():
    none = Returns(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0))
    assert len(of_scan(none, Scan(1.0, 0, np.zeros(3), 0.0), PoseHistory()).points) == 0


def test_obstacles_out_of_view_are_remembered_and_those_in_view_are_not():
    old = things((-0.8, 0.0), (-0.8, 0.5), (1.0, 0.0), (0.3, 1.0), (0.2, -0.05))
    kept = out_of_sight(old, 1.0, HERE, HERE, sensor(270.0), 0.46)
    assert sorted(kept.points.tolist()) == [[-0.8, 0.0], [-0.8, 0.5], [0.2, -0.05]]
    assert kept.seen.tolist() == [0.0] * 3
    assert kept.errors.tolist() == [0.01] * 3
    round_ = Pose(0.0, 0.0, math.pi)
    turned = out_of_sight(old, 1.0, round_, round_, sensor(270.0), 0.46)
    assert sorted(turned.points.tolist()) == [[0.2, -0.05], [1.0, 0.0]]


def at(bearing, distance=1.0):
    return things((distance * math.cos(bearing), distance * math.sin(bearing)))


@pytest.mark.parametrize("turned_mount", [0.0, 2.5])
def test_the_view_ends_half_a_beam_beyond_its_outer_beams(turned_mount):
    """Who walks out of the view of a robot that stands was seen last at its end, and is not there
    any more when the beam at the end does not see him."""
    s = sensor(180.0, mount=Pose(0.0, 0.0, turned_mount))
    for sign in (1.0, -1.0):
        end = turned_mount + sign * (math.radians(90.0) + 0.5 * s.step)
        inside, beyond = at(end - sign * 1e-4), at(end + sign * 1e-4)
        assert len(out_of_sight(inside, 1.0, HERE, HERE, s, 0.46).points) == 0
        assert len(out_of_sight(beyond, 1.0, HERE, HERE, s, 0.46).points) == 1


def test_a_view_that_is_not_even_about_its_middle_ends_at_its_own_beams():
    s = sensor(180.0, mount=Pose(0.0, 0.0, 0.0))
    s = s._replace(bearings=s.bearings + 0.5)
    for bearing, hidden in ((2.06, 0), (2.08, 1), (-1.06, 0), (-1.08, 1)):
        assert len(out_of_sight(at(bearing), 1.0, HERE, HERE, s, 0.46).points) == hidden


@pytest.mark.parametrize("turn", [0.2, -0.2])
def test_each_end_of_the_view_is_where_the_robot_was_at_its_beam(turn):
    """It turns while it looks: its first beam, on the right, before, and its last one after."""
    s = sensor(180.0, mount=Pose(0.0, 0.0, 0.0))
    last = Pose(0.0, 0.0, turn)
    quarter = 0.5 * math.pi

    def remembered(bearing):
        return len(out_of_sight(at(bearing), 1.0, HERE, last, s, 0.46).points)

    assert remembered(-quarter + 0.01) == 0
    assert remembered(-quarter - 0.01) == 1
    assert remembered(quarter + turn - 0.01) == 0
    assert remembered(quarter + turn + 0.01) == 1
    assert remembered(math.pi - 0.05) == remembered(-math.pi + 0.05) == 1


@pytest.mark.parametrize("bearing", [math.pi, 2.8, -2.6])
def test_it_is_forgotten_when_it_is_far(bearing):
    s, near = sensor(270.0), 0.46 + BESIDE
    assert len(out_of_sight(at(bearing, near - 0.01), 1.0, HERE, HERE, s, 0.46).points) == 1
    assert len(out_of_sight(at(bearing, near + 0.01), 1.0, HERE, HERE, s, 0.46).points) == 0


def test_after_a_minute_a_remembered_obstacle_may_be_gone():
    old, s = things((-1.0, 0.0), seen=5.0), sensor(270.0)
    assert out_of_sight(old, 5.0 + REMEMBERED - 0.1, HERE, HERE, s, 0.46).errors == 0.01
    assert out_of_sight(old, 5.0 + REMEMBERED, HERE, HERE, s, 0.46).errors == -math.inf
    assert old.errors == 0.01


def test_an_all_round_sensor_needs_no_memory():
    old = things((-1.0, 0.0), (-1.0, 0.001), (1.0, 0.0))
    assert out_of_sight(old, 1.0, HERE, HERE, sensor(360.0), 0.46) is NOTHING
    assert len(out_of_sight(old, 1.0, HERE, HERE, sensor(358.0), 0.46).points) >= 1
    assert out_of_sight(NOTHING, 1.0, HERE, HERE, sensor(270.0), 0.46) is NOTHING


@pytest.mark.parametrize(("gap", "round_"), [(1.0, True), (1.4, True), (1.6, False), (2.4, False)])
def test_a_scan_with_a_gap_below_one_and_a_half_beams_is_all_round(gap, round_):
    step = 2.0 * math.pi / (719 + gap)
    s = sensor(360.0)._replace(bearings=step * np.arange(720), step=step)
    assert all_round(s) == round_


def test_one_remembered_point_represents_its_neighbours():
    row = [(-1.0 - 0.001 * k, 0.2) for k in range(200)]
    kept = out_of_sight(things(*row), 1.0, HERE, HERE, sensor(270.0), 0.46)
    assert 0.2 / GRAIN <= len(kept.points) <= 0.2 / GRAIN + 2
    for point in row:
        assert np.hypot(*(kept.points - point).T).min() <= GRAIN
    apart = things((-1.0, 0.2), (-1.0, 0.3), (-1.1, 0.2), (-1.0, -0.2))
    assert len(out_of_sight(apart, 1.0, HERE, HERE, sensor(270.0), 0.46).points) == 4


def test_both_are_joined_in_order():
    one = things((1.0, 0.0))
    assert joined(one, NOTHING) is one
    assert len(joined(NOTHING, one).points) == 1
    both = joined(things((1.0, 0.0), seen=2.0), things((2.0, 0.0), (3.0, 0.0), seen=1.0))
    assert both.points[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert both.seen.tolist() == [2.0, 1.0, 1.0]


WIDE = 0.03 + math.sqrt(2.0) * GRAIN
"""So far from a thing it may be, with all for which it stands."""
CENTRE = sensor(180.0, mount=Pose(0.0, 0.0, 0.0))._replace(range_max=12.0)


def past(thing, ranges, s=CENTRE, stamp=1.0, first=HERE, last=HERE):
    """Whether a scan shows that one thing is not there any more."""
    found = looked_past(thing, ScanWithPoses(s, Scan(stamp, 0, ranges, 0.1), first, last))
    assert found.shape == (1,)
    return bool(found[0])


def ranges_but(value=math.inf, beams=slice(0, 0), there=0.0):
    out = np.full(720, value)
    out[beams] = there
    return out


def test_what_all_beams_go_past_is_not_there_any_more():
    assert past(at(0.3), ranges_but())
    assert past(at(0.3), ranges_but(5.0))
    assert (
        looked_past(
            NOTHING, ScanWithPoses(CENTRE, Scan(1.0, 0, ranges_but(), 0.0), HERE, HERE)
        ).size
        == 0
    )
    both = looked_past(
        joined(at(0.3), at(2.0)), ScanWithPoses(CENTRE, Scan(1.0, 0, ranges_but(), 0.0), HERE, HERE)
    )
    assert both.tolist() == [True, False]


def test_they_have_to_go_past_it_by_its_error_and_their_own():
    beyond = 1.0 + WIDE + SURE * CENTRE.noise
    assert past(at(0.3), ranges_but(beyond + 1e-6))
    assert not past(at(0.3), ranges_but(beyond - 1e-6))


@pytest.mark.parametrize("there", [0.5, math.nan, -math.inf])
def test_an_obstacle_accounts_for_every_beam_that_can_meet_it(there):
    """Any one of them, and none of the others matters."""
    bearing, half = 0.3, math.asin(WIDE)
    for k, along in enumerate(CENTRE.bearings.tolist()):
        ends = ranges_but(math.inf, k, there)
        if abs(along - bearing) < half:
            assert not past(at(bearing), ends), k
        elif abs(along - bearing) > half + CENTRE.step:
            assert past(at(bearing), ends), k


def test_it_was_seen_before_the_scan():
    seen_at = things((1.0, 0.0), seen=1.0)
    assert past(seen_at, ranges_but(), stamp=1.01)
    assert not past(seen_at, ranges_but(), stamp=1.0)
    assert not past(seen_at, ranges_but(), stamp=0.9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_may_be_at_the_end_of_the_view_stays(side):
    end = CENTRE.bearings[-1] - math.asin(WIDE)
    assert past(at(side * (end - 1e-6)), ranges_but())
    outer = 719 if side > 0.0 else 0
    assert not past(at(side * (end - 1e-6)), ranges_but(math.inf, outer, 0.5))
    assert not past(at(side * (end + 1e-6)), ranges_but())
    assert not past(at(side * 3.0), ranges_but())
    assert not past(at(math.pi), ranges_but())


def test_what_may_be_beyond_the_range_stays():
    near = 1.0 + WIDE + SURE * CENTRE.noise
    assert past(at(0.3), ranges_but(), CENTRE._replace(range_max=near + 1e-6))
    assert not past(at(0.3), ranges_but(), CENTRE._replace(range_max=near - 1e-6))


def test_what_may_stand_between_two_beams_stays():
    coarse = sensor(180.0, beams=20, mount=Pose(0.0, 0.0, 0.0))._replace(range_max=12.0)
    open_ = np.full(20, math.inf)
    far = WIDE / coarse.step
    assert past(at(0.0, far - 1e-6), open_, coarse)
    assert not past(at(0.0, far + 1e-6), open_, coarse)


def test_what_may_be_where_the_sensor_is_stays():
    s = sensor(350.0, mount=HERE)._replace(range_max=12.0)
    assert past(at(0.3, WIDE + 1e-6), ranges_but(), s)
    assert not past(at(0.3, WIDE - 1e-6), ranges_but(), s)
    assert not past(at(0.3, 0.0), ranges_but(), s)


@pytest.mark.parametrize("turn", [0.2, -0.2])
def test_wherever_the_robot_was_during_the_scan_its_beams_have_to_go_past(turn):
    """It turned: the beam that met the thing was one of those from either end of the turn."""
    last, half = Pose(0.0, 0.0, turn), math.asin(WIDE)
    for bearing in (0.3, 0.3 - 0.5 * turn, 0.3 - turn):
        k = round((bearing - CENTRE.bearings[0]) / CENTRE.step)
        assert not past(at(0.3), ranges_but(math.inf, k, 0.5), last=last)
    ends = sorted((0.3, 0.3 - turn))
    for clear in (ends[0] - half - 0.01, ends[1] + half + 0.01):
        k = round((clear - CENTRE.bearings[0]) / CENTRE.step)
        assert past(at(0.3), ranges_but(math.inf, k, 0.5), last=last)


def test_the_nearest_and_the_farthest_that_it_was_count():
    """The robot drove on during the scan: from 1 m to 0.5 m before the thing."""
    on = Pose(0.5, 0.0, 0.0)
    beyond = 1.0 + WIDE + SURE * CENTRE.noise
    assert past(at(0.0), ranges_but(beyond + 1e-6), last=on)
    assert not past(at(0.0), ranges_but(beyond - 1e-6), last=on)
    assert not past(at(0.0), ranges_but(beyond - 1e-6), first=on)
    edge = round((math.asin(WIDE / 0.5) - 0.002 - CENTRE.bearings[0]) / CENTRE.step)
    assert not past(at(0.0), ranges_but(math.inf, edge, 0.3), last=on)


def test_a_rotated_mount_is_applied():
    back = sensor(180.0, mount=Pose(-0.3, 0.1, math.pi))._replace(range_max=12.0)
    thing = things((-1.3, 0.1))
    assert past(thing, ranges_but(), back)
    assert not past(thing, ranges_but(math.inf, 360, 0.5), back)
    assert not past(things((0.7, 0.1)), ranges_but(), back)
