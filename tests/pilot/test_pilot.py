"""The pilot as its callers use it: it arrives, hands over, takes over, and touches nothing."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.flat import flat, made, numbers
from cohelm.core.types import CENTRED, Pose, Stick, Twist, disc
from cohelm.law.govern import CourseClock
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.law.verdict import INVALID
from cohelm.pilot.behavior import ESCAPING, FOLLOWING, LED
from cohelm.pilot.pilot import NOTHING_NEAR, Pilot, taken
from cohelm.pilot.replanning import Plan
from cohelm.pilot.step import NO_MOVE, Settings, limit_speed
from cohelm.plan import path_planner
from cohelm.plan.course import course
from cohelm.plan.recovery import RecoveryMove
from cohelm.robot.kinematics import arc
from cohelm.scenario.law import Law, PlanModel
from tests.pilot.drives import DT, SETTINGS, drive

STRAIGHT = [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [6.0, 0.0]]


def test_it_arrives_at_the_end_and_stands_there():
    d = drive(STRAIGHT)
    assert d.arrived
    assert abs(d.poses[-1][0] - 6.0) < 0.1
    assert abs(d.poses[-1][1]) < 0.05
    assert len(d.decisions) * DT < 6.0 / 0.5 + 4.0


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_it_goes_round_what_stands_on_the_route_and_comes_back_onto_it(delay):
    d = drive(STRAIGHT, [(3.0, 0.0, 0.1)], delay=delay)
    assert d.arrived
    assert d.clearances.min() > 0.0075
    beside = np.abs(d.poses[:, 1])
    assert beside.max() > 0.35
    assert beside[d.poses[:, 0] > 5.5].max() < 0.1


@pytest.mark.parametrize("at", [(3.0, 0.05), (2.0, -0.1), (1.5, 0.1)])
def test_a_detour_leaves_out_no_loop_of_the_route(at):
    corners = [(0, 0), (1.5, 0), (3, 0), (4.5, 0), (4.5, 1.2), (3, 1.2), (3, 0), (3, -1.5), (3, -3)]
    driven = drive(corners, [(*at, 0.0, 0.0, 0.2)], seconds=60.0)
    assert driven.arrived
    assert np.hypot(*(driven.poses[:, :2] - [4.5, 0.6]).T).min() < 0.75


def test_a_robot_that_was_driven_far_from_its_route_plans_on_a_grid_of_the_usual_size(monkeypatch):
    made, field = [], path_planner.distance_field
    monkeypatch.setattr(
        path_planner, "distance_field", lambda *given: made.append(field(*given)) or made[-1]
    )
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    near = surroundings(points=np.array([(-87.0, 87.0 + 0.01 * k) for k in range(-50, 50)]))
    plan = pilot.plan(Pose(-90.0, 90.0, -0.8), Twist(0.0, 0.0), near)
    assert made
    assert all(one.clearance.size < 1_000_000 for one in made)
    assert plan.new
    assert plan.clearance > 0.04
    assert plan.course.poses[0, :2] == pytest.approx([-90.0, 90.0], abs=0.2)
    assert plan.course.poses[-1, :2] == pytest.approx([6.0, 0.0], abs=0.2)


@pytest.mark.parametrize(("pause", "goes_on"), [(0.5, True), (60.0, False)])
def test_a_recovery_move_is_not_finished_elsewhere_after_the_robot_was_on_hold(pause, goes_on):
    pilot, here, still = (
        Pilot(through(STRAIGHT, 0.5), SETTINGS),
        Pose(0.0, 0.0, 0.0),
        Twist(0.0, 0.0),
    )
    pilot.step(0.0, here, still, CENTRED, NOTHING_NEAR)
    move = RecoveryMove(-0.8, 0.0, 1.0)
    clock = pilot.state.clock._replace(waited=2.0)
    pilot.state = pilot.state._replace(left=move, moves=1, clock=clock, refused=4, row=0)
    pilot.step(DT, here, still, CENTRED, NOTHING_NEAR)
    assert pilot.state.left.distance < 0.0
    decision = pilot.step(DT + pause, here, still, CENTRED, NOTHING_NEAR)
    assert (decision.safe.v < 0.0) is goes_on
    assert decision.behavior == (ESCAPING if goes_on else FOLLOWING)
    assert (pilot.state.left == NO_MOVE) is not goes_on
    assert (pilot.state.moves, pilot.state.refused) == ((1, 4) if goes_on else (0, 0))
    assert goes_on or pilot.state.clock.waited < 0.1
    assert pilot.state.k == 3


@pytest.mark.parametrize(("away", "at"), [(1.1, 1.1), (2.0, 2.0), (0.0, 0.0), (-1.0, 0.0)])
def test_a_route_goes_on_from_where_the_robot_was_driven_by_hand(away, at):
    """The first command must not be back to where the route was left; that one waits for no plan.
    Where the robot has not come farther, the reference stays."""
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    moving = Twist(0.4, 0.0)
    pilot.step(0.0, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), CENTRED, NOTHING_NEAR)
    decision = pilot.step(5.0, Pose(away, 0.05, 0.0), moving, CENTRED, NOTHING_NEAR)
    assert decision.desired.x == pytest.approx(at, abs=0.06)
    assert decision.nominal.v > 0.3 or away <= 0.0


def test_a_loop_of_the_route_is_not_left_out_after_a_pause():
    """The robot stands on hold where the route crosses itself."""
    corners = [(0, 0), (1.5, 0), (3, 0), (4.5, 0), (4.5, 1.2), (3, 1.2), (3, 0), (3, -1.5), (3, -3)]
    pilot, still = Pilot(through(np.array(corners, float), 0.5), SETTINGS), Twist(0.0, 0.0)
    here = Pose(3.0, 0.0, 0.0)
    row = int(np.searchsorted(pilot.planner.route.times, 6.0))
    pilot.state = pilot.state._replace(clock=CourseClock(6.0, 0.0, 0.0), row=row)
    pilot.step(0.0, here, still, CENTRED, NOTHING_NEAR)
    before = pilot.state.clock.tau
    pilot.step(60.0, here, still, CENTRED, NOTHING_NEAR)
    assert pilot.state.clock.tau - before < 0.5


@pytest.mark.parametrize("middle", [0.326, 0.366, 0.418])
def test_a_door_hardly_wider_than_the_robot_needs_is_found_wherever_it_is(middle):
    """11 cm wider than Sally, of which 8 cm are clearance: the middle of no usual cell is in it."""
    half = 0.29 + 0.055
    door = np.array([(4, middle + half, 4, 9), (4, middle - half, 4, -9)])
    pilot = Pilot(through([(0, 0), (4, 0), (8, 0)], 0.5), SETTINGS)
    seen = surroundings(segments=door)
    assert not pilot.plan(Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), seen).failed


def test_a_closed_road_is_not_forced():
    d = drive(STRAIGHT, walls=[(3.0, -20.0, 3.0, 20.0)], seconds=15.0)
    assert not d.arrived
    assert d.clearances.min() > 0.0075
    assert d.poses[-1][0] < 2.7
    assert abs(d.twists[-1]).max() < 0.5


@pytest.mark.parametrize(("for_that", "then"), [(False, 1.2), (True, 0.0)])
def test_the_time_held_up_survives_a_new_plan_that_was_not_made_for_that(for_that, then):
    """Another course every 0.6 s kept the robot from ever looking for a way out. But a plan that
    was made because it had waited for long enough gets its time."""
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    held = pilot.state._replace(clock=CourseClock(0.0, 0.0, 1.2))
    other = Plan(course(through(STRAIGHT, 0.5), 1, True, SETTINGS.pace), True, None, False, 9.0)
    now = taken(
        held, other._replace(held=for_that), pilot.planner, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)
    )
    assert now.clock.waited == then


def test_the_reference_waits_while_the_operator_leads_and_takes_over_without_a_jump():
    def hand(t, pose):
        return (1.0, 0.6 if t < 3.0 else -0.6) if 2.0 <= t < 4.5 else (0.0, 0.0)

    d = drive(STRAIGHT, hand=hand)
    doing = np.array([s.behavior for s in d.decisions])
    assert (doing[110:220] == LED).all()
    assert (doing[230:] == FOLLOWING).all()
    ahead = np.array([s.desired.x for s in d.decisions]) - d.poses[:, 0]
    assert np.abs(ahead[110:240]).max() < 0.3
    assert np.abs(np.diff(d.twists, axis=0)).max() < 2.0 * DT / 0.25 + 1e-9  # the wheels' limits
    assert d.arrived


def test_a_stick_that_is_not_a_number_stops_the_robot():
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    pose, twist = Pose(0.0, 0.0, 0.0), Twist(0.3, 0.0)
    d = pilot.step(0.0, pose, twist, Stick(math.nan, 0.0), NOTHING_NEAR)
    assert d.verdict == INVALID
    assert 0.0 <= d.safe.v < 0.3
    assert np.isfinite(numbers(d._replace(h=0.0, clearance_seen=0.0))).all()


def test_a_pose_that_is_not_a_number_stops_it_and_leaves_no_trace():
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    d = pilot.step(0.0, Pose(math.nan, 0.0, 0.0), Twist(0.0, 0.0), CENTRED, NOTHING_NEAR)
    assert d.verdict == INVALID
    assert d.safe == (0.0, 0.0)
    d = pilot.step(DT, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), CENTRED, NOTHING_NEAR)
    assert d.verdict != INVALID
    assert d.safe.v > 0.0


def test_the_step_is_pure_but_for_the_commands_under_way():
    a, b = (Pilot(through(STRAIGHT, 0.5), SETTINGS, delay=0.06) for _ in range(2))
    seen = surroundings([[1.0, 0.3, 0.0, 0.0, 0.1, 0.2]])
    for k in range(20):
        pose, twist = Pose(0.01 * k, 0.0, 0.0), Twist(0.1, 0.0)
        assert a.step(k * DT, pose, twist, CENTRED, seen) == b.step(
            k * DT, pose, twist, CENTRED, seen
        )
    assert a.state == b.state


def refused(pilot, around, seconds, given=None):
    """It asks for something, and is given nothing, or that."""
    for _ in range(round(seconds / DT)):
        pilot.step(pilot.state.k * DT, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), CENTRED, around)
        pilot.applied(given or Twist(0.0, 0.0))


def test_a_robot_whose_commands_are_refused_without_an_obstacle_backs_off():
    pilot, here = Pilot(through(STRAIGHT, 0.5), SETTINGS), (Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0))
    refused(pilot, NOTHING_NEAR, 0.9)
    assert pilot.planner(pilot.task(*here, NOTHING_NEAR)).move is None
    refused(pilot, NOTHING_NEAR, 0.3)
    made = pilot.planner(pilot.task(*here, NOTHING_NEAR))
    assert made.move == RecoveryMove(-0.3, 0.0, 0.0)
    pilot.take(made, *here)
    refused(pilot, NOTHING_NEAR, 0.1, Twist(-0.1, 0.0))
    assert pilot.refused_for == 0.0
    refused(pilot, NOTHING_NEAR, 0.5)
    assert pilot.state.left == NO_MOVE
    refused(pilot, NOTHING_NEAR, 0.7)
    assert pilot.planner(pilot.task(*here, NOTHING_NEAR)).move == RecoveryMove(0.3, 0.0, 0.0)


def test_an_evasion_that_monitors_hold_back_is_not_chosen_for_a_while():
    """In a corridor somebody comes: it backs. What monitors remember behind it no obstacle says."""
    walls = np.array([[-9.0, 0.6, 9.0, 0.6], [-9.0, -0.6, 9.0, -0.6]])
    comes = surroundings(np.array([disc(1.6, 0.0, 0.3, 0.4, -0.5, 0.0)]), np.array([0.5]), walls)
    pilot, at_rest = Pilot(through(STRAIGHT, 0.5), SETTINGS), Twist(0.0, 0.0)
    wanted = []
    for k in range(round(4.0 / DT)):
        wanted.append(pilot.step(k * DT, Pose(0.0, 0.0, 0.0), at_rest, CENTRED, comes).tracking.v)
        pilot.applied(at_rest)
    backs = np.array(wanted) < 0.0
    assert backs[: round(0.4 / DT)].all()
    assert not backs[round(0.55 / DT) : round(3.3 / DT)].any()
    assert backs[round(3.6 / DT)]  # it tries again
    assert pilot.state.barred != 0
    pilot.step(6.0, Pose(0.0, 0.0, 0.0), at_rest, CENTRED, comes)
    pilot.applied(at_rest)
    assert pilot.state.barred == 0  # after a pause it may be elsewhere
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    for k in range(round(2.0 / DT)):
        made = pilot.step(k * DT, Pose(0.0, 0.0, 0.0), at_rest, CENTRED, comes)
        pilot.applied(made.safe)
        assert made.tracking.v < 0.0


def test_a_robot_that_requests_nothing_is_not_refused():
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    for _ in range(100):
        pilot.applied(Twist(0.0, 0.0))
    assert pilot.refused_for == 0.0


def test_a_delay_that_makes_no_sense_is_refused():
    with pytest.raises(CohelmError, match="delay must be from 0"):
        Pilot(through(STRAIGHT, 0.5), SETTINGS, delay=-1.0)


def test_the_nominal_command_is_slowed_down_on_the_same_arc():
    def requested(fastest):
        pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
        d = pilot.step(0.0, Pose(0.0, 0.3, 0.2), Twist(0.0, 0.0), Stick(0.0, 0.0), NOTHING_NEAR,
                       fastest)  # fmt: skip
        return d.nominal

    v, omega = requested(math.inf)
    slow_v, slow_omega = requested(0.02)
    assert abs(v) > 0.02 == pytest.approx(abs(slow_v))
    assert slow_omega / slow_v == pytest.approx(omega / v)
    assert requested(0.0) == (0.0, 0.0)
    assert requested(10.0) == (v, omega)


def test_a_speed_limit_holds_for_evasions_and_never_speeds_up():
    def limited(s, fastest):
        row, arrays = flat(s)
        limit_speed(row, s, fastest)
        return made(Settings, row, arrays=arrays)

    slow = limited(SETTINGS, 0.1)
    assert (slow.fastest, slow.evasion.speed) == (0.1, 0.1)
    assert limited(slow, 0.3) == slow
    assert limited(SETTINGS, math.inf) == SETTINGS
    assert slow._replace(fastest=math.inf, evasion=SETTINGS.evasion) == SETTINGS


def test_a_head_on_mover_is_passed_on_the_right_if_so_configured():
    def beside(right):
        walker = (6.0, -0.05, 0.2, 0.2, -0.4, 0.0)  # a little to the robot's right
        law = Law(plan=PlanModel(pass_right_m=right))
        settings = law.settings(SETTINGS.outline, SETTINGS.limits, 0.5, DT)
        settings = settings._replace(gains=SETTINGS.gains)
        d = drive(
            STRAIGHT, [walker], settings=settings, replan_params=law.replan_params(), seconds=20.0
        )
        assert d.arrived
        assert d.clearances.min() > 0.1
        met = np.abs(6.0 - 0.4 * DT * np.arange(len(d.poses)) - d.poses[:, 0]).argmin()
        return d.poses[met, 1]

    assert beside(0.0) > 0.3  # the shorter way
    assert beside(0.5) < -0.3


def test_flush_along_a_wall_and_nose_first_in_a_corner_it_gets_away():
    """3 cm beside the wall, which is all the guard shapes for, no corner of it may come nearer:
    only a gentle arc backwards, shaped to what is certified, leads off."""
    walls = [(-1, -4, 14, -4), (-1, -4, -1, 3)]
    way = [(-0.68, -3.35), (0.5, -2.6), (3.0, -2.0)]
    done = drive(way, walls=walls, start=(-0.68, -3.35, -math.pi / 2), seconds=40.0)
    assert done.arrived
    assert done.clearances.min() > 0.0075


def test_nose_first_in_a_dead_end_a_robot_with_a_long_tail_backs_out():
    """Its tail has no room to turn at the wall, so no path begins there: only from farther back."""
    tail = np.array([[0.1, 0.25], [-0.9, 0.35], [-0.9, -0.35], [0.1, -0.25]])
    walls = [(2.92, -1.6, 5.76, -2.74), (5.76, -2.74, 7.13, 0.67), (7.13, 0.67, 4.29, 1.81)]
    done = drive(
        [(5, 0), (6, 0), (11, 0)], walls=walls, start=(6.75, 0.18, -0.38), seconds=20.0,
        settings=SETTINGS._replace(outline=tail),
    )  # fmt: skip
    assert done.poses[:, 0].min() < 6.0
    assert done.clearances.min() > 0.0075


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_on_its_path_the_pose_error_is_zero_whatever_the_delay(delay):
    done = drive(STRAIGHT, delay=delay, seconds=8.0)
    assert max(d.e_p for d in done.decisions[200:]) < 0.005


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_ends_where_the_robot_faces_its_path(sign):
    """Though it was planned for where the move began, and would lead half a radian farther."""
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    pilot.state = pilot.state._replace(left=RecoveryMove(0.0, 0.0, sign * 1.5))
    pose, twist = Pose(0.0, 0.0, -sign), Twist(0.0, 0.0)
    for k in range(150):
        twist = pilot.step(k * DT, pose, twist, CENTRED, NOTHING_NEAR).safe
        pose = arc(pose, twist, DT)
        assert sign * pose.psi < 0.15
    assert abs(pose.psi) < 0.1
    assert pilot.behavior == FOLLOWING
