"""Out of tight spots, in both driving directions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from shapely import MultiPoint, Polygon
from shapely.affinity import rotate, translate

from cohelm.core.scalars import wrap
from cohelm.core.types import Pose, Twist
from cohelm.plan.distance_field import swept_clearances
from cohelm.plan.recovery import (
    BACKWARDS,
    FORWARDS,
    LEFT,
    RIGHT,
    RecoveryMove,
    RecoveryParams,
    back_off,
    kind,
    recovery_move,
    recovery_twist,
    rest,
)
from cohelm.plan.recovery_search import search_recovery
from cohelm.robot.kinematics import arc
from cohelm.scenario.load import robot as load_robot
from tests.perceive.scenes import JACKAL, LONG, NOTHING, circle, room, wall

AT = Pose(0.0, 0.0, 0.0)
DT = 0.02
POCKET = np.vstack((wall(-0.3, 0.26, 0.4, 0.26), wall(0.4, 0.26, 0.4, -0.26),
                    wall(0.4, -0.26, -0.3, -0.26)))  # fmt: skip


def drive(pose, move, outline, points):
    """The whole move step by step; where it ends, and the least gap on the way (shapely)."""
    seen, least, left = MultiPoint(points), math.inf, move
    for _ in range(5000):
        twist = recovery_twist(left, 0.4, 1.5, DT)
        assert abs(twist.v) <= 0.4 + 1e-12
        assert abs(twist.omega) <= 1.5 + 1e-12
        if twist == (0.0, 0.0):
            return pose, least
        pose, left = arc(pose, twist, DT), rest(left, twist, DT)
        body = rotate(Polygon(outline), pose.psi, origin=(0, 0), use_radians=True)
        if len(points):
            least = min(least, translate(body, pose.x, pose.y).distance(seen))
    raise AssertionError("the move never ended")


@given(st.floats(-7.0, 7.0), st.floats(-3.0, 3.0))
def test_in_the_open_it_turns_on_the_spot_the_short_way(psi, heading):
    move = recovery_move(Pose(0.0, 0.0, psi), heading, NOTHING, JACKAL)
    assert move.distance == 0.0
    assert abs(move.turn) <= math.pi + 1e-9
    assert wrap(psi + move.turn - heading) == pytest.approx(0.0, abs=1e-9)


def test_it_turns_the_long_way_where_something_stands_in_the_short_one():
    points = circle(0.0, 0.27, 0.02)
    move = recovery_move(AT, math.radians(100.0), points, JACKAL)
    short = recovery_move(AT, math.radians(-100.0), points, JACKAL)
    assert move is None or move.turn == pytest.approx(math.radians(-260.0)) or move.distance
    assert short is not None


def test_from_a_pocket_ahead_it_backs_out_and_turns():
    move = recovery_move(AT, math.pi, POCKET, JACKAL)
    assert move.distance < -0.2
    assert abs(move.turn) == pytest.approx(math.pi, abs=0.8)
    pose, least = drive(AT, move, JACKAL, POCKET)
    assert least >= 0.025
    assert wrap(pose.psi - math.pi) == pytest.approx(0.0, abs=0.05)


def test_from_a_pocket_behind_it_drives_out_and_turns():
    behind = Pose(0.0, 0.0, math.pi)
    move = recovery_move(behind, 0.0, POCKET, JACKAL, RecoveryParams(forward=1.0))
    assert move.distance > 0.2
    pose, least = drive(behind, move, JACKAL, POCKET)
    assert least >= 0.025
    assert wrap(pose.psi) == pytest.approx(0.0, abs=0.05)


def test_it_backs_no_farther_than_allowed():
    assert recovery_move(AT, math.pi, POCKET, JACKAL, RecoveryParams(back=0.1, forward=0.1)) is None


@pytest.mark.parametrize("outline", [JACKAL, LONG])
def test_a_box_that_is_too_small_to_turn_in_has_no_escape(outline):
    x, y = outline.max(axis=0) + 0.05
    assert recovery_move(AT, 1.5, room(-x, -y, x, y), outline) is None


def test_a_robot_nearer_than_the_clearance_already_may_still_leave():
    points = wall(-0.3, 0.175, 0.3, 0.175)  # 1 cm beside it
    move = recovery_move(AT, -0.1, points, JACKAL)
    assert move is not None
    _, least = drive(AT, move, JACKAL, points)
    assert least > 0.0


@pytest.mark.parametrize("gap", [0.03, 0.023])
@pytest.mark.parametrize("outline", [JACKAL, load_robot("sally").outline])
def test_flush_along_a_wall_a_gentle_arc_leads_off(outline, gap):
    """Neither on the spot nor sharply can it turn away: a corner would come nearer."""
    side, front = gap - outline[:, 1].min(), outline[:, 0].max()
    points = np.vstack((wall(-6.0, -side, front + 0.2, -side),
                        wall(front + 0.2, -side, front + 0.2, 2.0)))  # fmt: skip
    pose = AT
    for _ in range(8):  # a little back, a little aside, and again
        move = recovery_move(pose, 2.0, points, outline)
        assert move is not None
        pose, least = drive(pose, move, outline, points)
        assert least > 0.015
        if move.turn:
            break
    assert wrap(pose.psi - 2.0) == pytest.approx(0.0, abs=0.05)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.02, 0.2)), max_size=12),
    st.floats(-3.0, 3.0),
)
def test_no_escape_touches_anything_that_was_seen(things, heading):
    free = [thing for thing in things if math.hypot(*thing[:2]) - thing[2] > 0.32]
    points = np.vstack([NOTHING, *(circle(*thing) for thing in free)])
    move = recovery_move(AT, heading, points, JACKAL)
    if move is not None:
        pose, least = drive(AT, move, JACKAL, points)
        assert least > 0.015
        assert wrap(pose.psi - heading) == pytest.approx(0.0, abs=0.05)


@given(st.floats(-1, 1), st.floats(-2, 2), st.floats(-6, 6))
def test_a_move_ends_where_it_was_meant_to(distance, curvature, turn):
    pose, _ = drive(AT, RecoveryMove(distance, curvature, turn), JACKAL, NOTHING)
    corner = arc(AT, Twist(distance, distance * curvature), 1.0)
    assert math.hypot(pose.x - corner.x, pose.y - corner.y) < 0.011
    assert pose.psi == pytest.approx(corner.psi + turn, abs=0.01 + 0.01 * (1 + abs(curvature)))


def test_a_delayed_manoeuvre_continues_where_it_was():
    left = RecoveryMove(-0.5, 0.0, 1.0)
    assert rest(left, Twist(0.0, 0.0), DT) == left
    assert rest(left, Twist(-0.4, 0.0), DT).distance == pytest.approx(-0.492)


@pytest.mark.parametrize("heading", [1.5, -1.5])
def test_a_kind_of_move_that_led_nowhere_is_not_begun_with_again(heading):
    first = recovery_move(AT, heading, NOTHING, JACKAL)
    assert first is not None
    other = recovery_move(AT, heading, NOTHING, JACKAL, refused=kind(first))
    assert other is not None
    assert other.distance == 0.0
    assert other.turn == pytest.approx(first.turn - math.copysign(2 * math.pi, first.turn))
    away = recovery_move(AT, heading, NOTHING, JACKAL, refused=LEFT | RIGHT | FORWARDS)
    assert away is not None
    assert away.distance < 0.0
    assert recovery_move(AT, heading, NOTHING, JACKAL, refused=15) is None


def test_it_backs_off_as_it_came_where_nothing_known_holds_it():
    assert back_off(AT, NOTHING, JACKAL) == RecoveryMove(-0.3, 0.0, 0.0)
    assert back_off(AT, NOTHING, JACKAL, refused=BACKWARDS) == RecoveryMove(0.3, 0.0, 0.0)
    assert back_off(AT, NOTHING, JACKAL, refused=BACKWARDS | FORWARDS) is None


def test_it_backs_off_no_farther_than_there_is_room():
    back = JACKAL[:, 0].min()
    post = circle(back - 0.15, 0.0, 0.02)
    move = back_off(AT, post, JACKAL)
    assert move is not None
    pose, least = drive(AT, move, JACKAL, post)
    assert math.hypot(pose.x, pose.y) > 0.05
    assert least > 0.017
    shut_in = room(back - 0.03, -0.6, 0.6, 0.6)
    move = back_off(AT, shut_in, JACKAL)
    assert move is not None
    assert move.distance > 0.0


def test_a_few_small_moves_lead_out_of_a_corner():
    """Aslant in it, three of its own corners 3 cm or so off the walls."""
    sally = load_robot("sally").outline
    corner = np.vstack((wall(0.0, 0.0, 4.0, 0.0), wall(0.0, 0.0, 0.0, 4.0)))
    pose, left = Pose(0.49005, 0.46987, 2.56157), 12
    clearances = [float(swept_clearances(corner, sally, np.array([pose]))[0])]
    while abs(wrap(pose.psi - 0.8)) > 0.01:
        move = search_recovery(pose, 0.8, corner, sally)
        assert move is not None
        for share in np.linspace(0.05, 1.0, 20):
            there = arc(
                pose, Twist(share * move.distance, share * move.distance * move.curvature), 1.0
            )
            clearances.append(float(swept_clearances(corner, sally, np.array([there]))[0]))
        for share in np.linspace(0.05, 1.0, 20):
            turned = Pose(there.x, there.y, there.psi + share * move.turn)
            clearances.append(float(swept_clearances(corner, sally, np.array([turned]))[0]))
        pose, left = turned, left - 1
        assert left > 0
    assert min(clearances) > 0.017


def test_between_two_obstacles_smaller_steps_lead_out():
    """3 cm before a disc and behind a wall no step of the first size is possible."""
    sally = load_robot("sally").outline
    points = np.vstack((wall(0.0, -1.0, 0.0, 4.0), circle(0.9, 0.9, 0.1)))
    move = search_recovery(Pose(0.40611, 1.16246, 0.05764), 0.6, points, sally)
    assert move is not None


def test_it_does_not_take_the_end_of_what_it_looks_at_for_free_ground():
    """Between two long walls with 2 cm beside it nothing leads out, however far it drives."""
    sally = load_robot("sally").outline
    passage = np.vstack((wall(-6.0, 0.31, 6.0, 0.31), wall(-6.0, -0.31, 6.0, -0.31)))
    assert search_recovery(AT, 1.5, passage, sally) is None


def test_where_nothing_leads_out_none_is_found():
    sally = load_robot("sally").outline
    cage = room(-0.375, -0.305, 0.375, 0.305)
    assert search_recovery(AT, 1.5, cage, sally) is None


def test_where_no_kind_of_move_may_begin_none_is_found():
    assert (
        search_recovery(
            AT, 1.5, room(-0.6, -0.6, 0.6, 0.6), load_robot("sally").outline, refused=15
        )
        is None
    )
