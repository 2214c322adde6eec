"""The robot's own picture while it drives through the lab with imperfect sensors."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.frames import compose
from cohelm.core.scalars import wrap
from cohelm.core.types import VX, VY, Pose, Twist
from cohelm.perceive.localize import global_search as search, localization_map as known_
from cohelm.perceive.localize.localization_map import map_from_occupancy
from cohelm.perceive.match import scan_matching as match
from cohelm.perceive.pipeline import Perception, warm_up
from cohelm.perceive.scan import deskew as deskewing
from cohelm.perceive.track import potentially_dynamic, tracker as movers
from cohelm.robot.kinematics import arc
from cohelm.robot.port import Readings
from cohelm.scenario import load
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import world
from tests.few import first
from tests.perceive.drives import DT, LIDAR, START, TOUR, along, drive, lab_map
from tests.robot.plausibility.watched import ROOM, person, stamped_by

SALLY = load.robot("sally").model_copy(update={"lidar": LIDAR})


@pytest.fixture(scope="module")
def lab():
    return map_from_occupancy(*lab_map())


@pytest.fixture(scope="module")
def tour():
    return along(TOUR)


def errors(seen, truth):
    return (
        math.hypot(seen.pose.x - truth.x, seen.pose.y - truth.y),
        abs(wrap(seen.pose.psi - truth.psi)),
    )


@pytest.mark.parametrize("seed", first([0, 1, 2]))
def test_the_lab_is_driven_through_within_the_stated_errors(lab, tour, seed):
    perception = Perception(SALLY, lab, START)
    found, sure, squares = [], [], []
    for moment in drive(*tour, seed):
        seen = perception.take(moment.now, moment.readings)
        if moment.readings.scan is not None:
            found.append(errors(seen, moment.truth))
            sure.append(not seen.lost)
            e = np.array([seen.pose.x - moment.truth.x, seen.pose.y - moment.truth.y])
            squares.append(e @ np.linalg.solve(seen.covariance[:2, :2], e))
    place, heading = np.array(found).T
    assert all(sure)
    assert np.sqrt((place**2).mean()) < 0.02
    assert np.quantile(place, 0.99) < 0.05
    assert heading.max() < math.radians(0.5)
    # and it knows them: three sigma in the plane are 99.7 %
    assert np.mean(np.array(squares) < 11.8) > 0.95


def test_standing_points_lie_on_walls_and_cones_in_the_odometry_frame(lab, tour):
    perception = Perception(SALLY, None)
    for moment in drive(tour[0][:400], tour[1][:400], 3):
        seen = perception.take(moment.now, moment.readings)
    walls = lab.surfaces.points
    c, s = math.cos(moment.truth.psi), math.sin(moment.truth.psi)
    own = seen.odometry
    co, so = math.cos(own.psi), math.sin(own.psi)
    body = (seen.obstacles.points - (own.x, own.y)) @ np.array([[co, -so], [so, co]])
    world = body @ np.array([[c, s], [-s, c]]) + (moment.truth.x, moment.truth.y)
    gaps = np.hypot(*(world[:, None] - walls[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(world) > 200
    assert np.quantile(gaps, 0.95) < 0.08
    assert not seen.lost


def test_pose_and_obstacles_on_the_map_are_those_of_the_odometry_frame(lab, tour):
    perception = Perception(SALLY, lab, START)
    for moment in drive(tour[0][:60], tour[1][:60], 0):
        seen = perception.take(moment.now, moment.readings)
    assert compose(seen.map_odom, seen.odometry) == pytest.approx(seen.pose)
    assert math.hypot(*seen.map_odom[:2]) > 0.3  # another frame
    standing = seen.obstacles.points[: seen.unobserved.start]
    apart = standing[:, None] - lab.surfaces.points[None]
    assert np.quantile(np.hypot(*apart.transpose(2, 0, 1)).min(axis=1), 0.95) < 0.08


@pytest.mark.parametrize("back", [0.0, 1.5, 3600.0])
def test_after_the_robots_clock_was_set_back_who_walks_is_tracked_as_before(back):
    walker = person(1.2, -2.0, 0.0, 0.5)
    robot = Kinematic(SALLY, Pose(0.0, 0.0, 0.0), world(([walker], ROOM)), seed=2)
    perception = Perception(SALLY, None)
    for k in range(1, 300):
        t = 0.02 * k
        robot.wait(t)
        clock = t - (back if t > 1.5 else 0.0)
        seen = perception.take(clock, stamped_by(robot.read(), clock - t))
    (disc,) = seen.movers
    assert disc[:2] == pytest.approx((1.2, -2.0 + 0.5 * t), abs=0.15)
    assert disc[[VX, VY]] == pytest.approx((0.0, 0.5), abs=0.15)


def test_without_readings_nothing_is_reported(lab):
    seen = Perception(SALLY, lab, START).take(1.0, Readings(None, None, None, None))
    assert seen.lost
    assert seen.reason
    assert len(seen.obstacles.points) == len(seen.movers) == 0


def test_a_robot_without_a_lidar_is_refused():
    with pytest.raises(CohelmError, match="has no LiDAR"):
        Perception(SALLY.model_copy(update={"lidar": None}))


def test_a_map_without_walls_is_refused():
    nothing = np.zeros((4, 4), bool)
    with pytest.raises(CohelmError, match=r"no occupied cell.*negate and mode"):
        map_from_occupancy(nothing, ~nothing, 0.05, Pose(0.0, 0.0, 0.0))
    with pytest.raises(CohelmError, match=r"no free cell.*negate and mode"):
        map_from_occupancy(~nothing, nothing, 0.05, Pose(0.0, 0.0, 0.0))


@pytest.mark.parametrize("mapped", [True, False])
def test_a_warm_up_leaves_nothing_to_compile(lab, mapped):
    warm_up(SALLY, mapped)
    parts = (
        match.align,
        known_.judge,
        search._score_blocks,
        search._separated,
        movers._updated_tracks,
        deskewing.deskew,
    )
    before = [len(part.signatures) for part in parts]
    assert all(before) or not mapped
    perception = Perception(SALLY, lab if mapped else None)
    for moment in drive([START] * 80, [Twist(0.0, 0.0)] * 79, 0):
        perception.take(moment.now, moment.readings)
    assert [len(part.signatures) for part in parts] == before


@pytest.mark.parametrize("rare", ["is_covered", "potentially_dynamic_points"])
def test_a_warm_up_compiles_what_few_scans_need(monkeypatch, rare):
    calls, compiled = [], getattr(potentially_dynamic, rare)
    monkeypatch.setattr(potentially_dynamic, rare, lambda *of: (calls.append(1), compiled(*of))[1])
    warm_up(SALLY, False)
    assert calls


@pytest.mark.parametrize(("at", "by"), first([(14, -2.0), (16, 2.0), (13, 2.0), (18, -2.0)], 2))
def test_moved_two_metres_along_the_corridor_the_robot_knows_it_within_3_seconds(lab, tour, at, by):
    """Only a cone and two doors tell places in the corridor apart, to a hand's breadth."""
    first, last = round((at - 2) / DT), round((at + 4) / DT)
    poses, twists = tour[0][first : last + 1], tour[1][first:last]
    perception = Perception(SALLY, lab, poses[0])
    astray, at_last = [], False
    for moment in drive(poses, twists, 1, pushes=((2.0, (by, 0.0, 0.0)),)):
        seen = perception.take(moment.now, moment.readings)
        off, _ = errors(seen, moment.truth)
        if 0.5 < moment.now < 2.0:
            assert not seen.lost
        elif moment.now >= 2.0 and off > 0.2 and not seen.lost:
            astray.append(moment.now - 2.0)
        if moment.now > 5.0:
            assert not seen.lost
            assert off < 0.2
            at_last = True
    assert at_last
    assert max(astray) < 1.0  # until then it is wrong, and does not know


@pytest.mark.parametrize(
    ("row", "to", "seed", "within"),
    first(
        [
            (
                1143,
                Pose(5.434, 4.001, 0.137),
                743266,
                3.0,
            ),  # looked for once only, 5 s were not enough
            (511, Pose(0.823, 2.256, -0.357), 490810, 2.0),  # 2.4 s
            (777, Pose(1.708, 4.569, -0.656), 915122, 2.0),  # 2.4 s
        ],
        2,
    ),
)
def test_dragged_on_while_it_is_looked_for_the_robot_is_looked_for_again(
    lab, tour, row, to, seed, within
):
    """What a search finds with a scan from the middle of the drag is wrong, and grows unlikely."""
    start = tour[0][row + 100]
    dragged = [Pose(*p) for p in np.linspace(start, to, 51)[1:].tolist()]
    poses = tour[0][row : row + 100] + dragged
    twists = tour[1][row : row + 100] + [Twist(0.0, 0.0)] * 50
    turning = [Twist(0.0, 0.0)] * 50 + [Twist(0.0, 0.4)] * 150
    for twist in turning:
        poses.append(arc(poses[-1], twist, DT))
    perception, lost = Perception(SALLY, lab, poses[0]), 0.0
    for moment in drive(poses, twists + turning, seed):
        seen = perception.take(moment.now, moment.readings)
        since = moment.now - 150 * DT
        if since > 0.2 and (seen.lost or errors(seen, moment.truth)[0] > 0.1):
            lost = since
    assert lost < within


@pytest.mark.parametrize(
    ("at", "by"), first([(20, 1.2), (24, -2.0), (19, 2.0), (22, -1.2), (31, -2.0)], 2)
)
def test_moved_and_left_standing_the_robot_is_not_lost_for_ever(lab, tour, at, by):
    """No margin grows while nothing new is seen, but a place may lead from scan to scan."""
    first = round((at - 2) / DT)
    poses, twists = tour[0][first : first + 101], tour[1][first : first + 100]
    poses, twists = poses + poses[-1:] * 160, twists + [Twist(0.0, 0.0)] * 160
    perception = Perception(SALLY, lab, poses[0])
    for moment in drive(poses, twists, at, pushes=((2.0, (by, 0.0, 0.0)),)):
        seen = perception.take(moment.now, moment.readings)
    assert moment.now > 5.0
    assert not seen.lost, seen.reason
    assert errors(seen, moment.truth)[0] < 0.1


@pytest.mark.parametrize(("ahead", "aside"), first([(1.5, 0.0), (-1.0, 0.0), (0.3, -1.6)]))
@pytest.mark.parametrize("at", [0.0, 16.0, 27.0])
def test_a_wrong_pose_that_is_set_is_contradicted_by_the_lidar_within_3_seconds(
    lab, tour, at, ahead, aside
):
    """At once, but where the corridor looks alike here and there."""
    first = round(at / DT)
    poses, twists = tour[0][first : first + 250], tour[1][first : first + 249]
    perception = Perception(SALLY, lab, poses[0])
    reported, sure = False, 0.0
    for moment in drive(poses, twists, 5):
        if moment.now >= 1.0 and not reported:
            reported = True
            x, y, psi = moment.truth
            perception.place(Pose(x + ahead, y + aside, psi))
        seen = perception.take(moment.now, moment.readings)
        if moment.now > 1.0 and not seen.lost and errors(seen, moment.truth)[0] > 0.1:
            sure = moment.now - 1.0
    assert sure < 3.0
    assert not seen.lost
    assert errors(seen, moment.truth)[0] < 0.1


def test_a_right_pose_that_is_set_is_kept_and_corrects_a_wrong_one(lab, tour):
    poses, twists = tour[0][650:850], tour[1][650:849]
    x, y, psi = poses[0]
    perception = Perception(SALLY, lab, Pose(x - 3.2, y, psi))
    reported = False
    for moment in drive(poses, twists, 5):
        if moment.now >= 0.5 and not reported:
            reported = True
            perception.place(moment.truth)
        seen = perception.take(moment.now, moment.readings)
        if moment.now > 0.6:
            assert not seen.lost
            assert errors(seen, moment.truth)[0] < 0.15  # the corridor does not tell more


def test_after_switch_on_no_pose_is_accepted_before_more_than_one_view_was_seen(lab, tour):
    poses, twists = tour[0][300:700], tour[1][300:699]
    standing = Perception(SALLY, lab)
    for moment in drive([poses[0]] * 150, [], 4):
        seen = standing.take(moment.now, moment.readings)
    assert seen.lost
    assert errors(seen, moment.truth)[0] < 0.1  # it has its guess
    assert "drive on a little" in seen.reason
    driving = Perception(SALLY, lab)
    believed = []
    for moment in drive(poses, twists, 4):
        seen = driving.take(moment.now, moment.readings)
        if not seen.lost:
            believed.append(errors(seen, moment.truth)[0])
    assert len(believed) > 100
    assert max(believed) < 0.1
