"""What counts of what was seen."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.odometry import PoseHistory, placed
from cohelm.robot.collision_monitor.returns import Returns, Sensor
from cohelm.robot.collision_monitor.surroundings import (
    BESIDE,
    GRAIN,
    NOTHING,
    REMEMBERED,
    Surroundings,
    all_round,
    joined,
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
    return Surroundings(
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


def test_what_went_out_of_sight_behind_is_remembered_and_what_is_in_view_is_not():
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


def test_after_a_minute_nobody_knows_whether_it_still_stands_there():
    old, s = things((-1.0, 0.0), seen=5.0), sensor(270.0)
    assert out_of_sight(old, 5.0 + REMEMBERED - 0.1, HERE, HERE, s, 0.46).errors == 0.01
    assert out_of_sight(old, 5.0 + REMEMBERED, HERE, HERE, s, 0.46).errors == -math.inf
    assert old.errors == 0.01


def test_a_sensor_that_looks_all_round_remembers_nothing():
    old = things((-1.0, 0.0), (-1.0, 0.001), (1.0, 0.0))
    assert out_of_sight(old, 1.0, HERE, HERE, sensor(360.0), 0.46) is NOTHING
    assert len(out_of_sight(old, 1.0, HERE, HERE, sensor(358.0), 0.46).points) >= 1
    assert out_of_sight(NOTHING, 1.0, HERE, HERE, sensor(270.0), 0.46) is NOTHING


@pytest.mark.parametrize(("gap", "round_"), [(1.0, True), (1.4, True), (1.6, False), (2.4, False)])
def test_who_leaves_less_than_a_beam_and_a_half_out_looks_all_round(gap, round_):
    step = 2.0 * math.pi / (719 + gap)
    s = sensor(360.0)._replace(bearings=step * np.arange(720), step=step)
    assert all_round(s) == round_


def test_of_what_is_remembered_one_stands_for_its_neighbours():
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
