"""The robot evades movers that come towards it, cross or overtake it, and does not wait."""

import math

import numpy as np
import pytest

from cohelm.core.types import CENTRED, Pose, Twist, disc
from cohelm.law.govern import CourseClock
from cohelm.law.guard.step import guard
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.behavior import EVADING, LED
from cohelm.pilot.pilot import Pilot
from cohelm.plan.course import course
from cohelm.plan.evasion.context import context_at
from cohelm.plan.evasion.movers import (
    AX,
    AY,
    GROWTH,
    LEAVING,
    M_RADIUS,
    MAX_ACCELERATION,
    MVX,
    MVY,
    MX,
    MY,
    TOP_SPEED,
    TURNING,
    VELOCITY_ERROR,
    acceleration,
    empty_mover_history,
    relevant_movers,
    updated_history,
)
from cohelm.plan.evasion.params import LONG, EvasionParams, adapted, horizon
from cohelm.plan.evasion.predicted_motion import PredictedMotion, roll_out_piece, waiting_cost
from cohelm.plan.evasion.risk import FAR, PX, PY, risk_at, trajectories
from cohelm.robot.achievable import achievable
from cohelm.robot.clearance import circumscribed_radius, disc_clearance
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from cohelm.robot.model import SHIPPED
from cohelm.scenario.law import EvasionModel
from cohelm.scenario.load import robot
from cohelm.sim.run import run
from cohelm.sim.setup import with_pilot
from cohelm.sim.world import Body, outline_clearance
from cohelm.study.campaign import rooms
from cohelm.study.campaign.episode import under
from cohelm.study.campaign.scoring import run_episode
from tests.few import first
from tests.pilot.drives import DT, SALLY, SETTINGS, drive
from tests.sim.test_closed_loop_lidar import crossing

WAY = [(0.0, 0.0), (3.0, 0.0), (6.0, 0.0)]
ON = SETTINGS
OFF = SETTINGS._replace(evasion=EvasionParams(horizon=0.0))


def coming(x, y, vx, vy, radius=0.25):
    """A disc that drifts, whatever the robot does."""
    return (x, y, radius, radius + 0.5, vx, vy)  # as `disc` takes it


ENCOUNTERS = {
    "head-on": coming(6.0, 0.0, -0.8, 0.0),
    "crossing from the left": coming(3.0, 3.0, 0.0, -0.6),
    "crossing from the right, fast": coming(3.0, -6.0, 0.0, 1.2),
    "overtaking": coming(-2.5, 0.1, 0.9, 0.0),
    "head-on, a little aside": coming(6.0, 0.3, -0.8, 0.0),
    "slower ahead": coming(1.5, 0.0, 0.2, 0.0),
}


@pytest.mark.parametrize("name", first(ENCOUNTERS, 4))
def test_no_mover_on_a_straight_course_touches_a_robot_that_has_room(name):
    done = drive(WAY, [ENCOUNTERS[name]], seconds=40.0, settings=ON)
    assert done.clearances.min() > 0.05
    assert done.arrived


def test_without_evasion_the_same_encounters_end_in_a_touch():
    """The tests above can fail."""
    gaps = [
        drive(WAY, [ENCOUNTERS[name]], seconds=20.0, settings=OFF).clearances.min()
        for name in ("head-on", "overtaking")
    ]
    assert max(gaps) < 0.0


def test_a_slow_robot_looks_far_enough_ahead_to_leave_the_way_of_a_wide_mover():
    """At 0.26 m/s; a robot that looks 3 s ahead stays where it is overtaken, and is touched."""
    waffle = robot("turtlebot3_waffle")
    limits = waffle.bounds()
    e = adapted(EvasionParams(speed=limits.speed), waffle.outline, limits)
    slow = SETTINGS._replace(
        outline=waffle.outline, limits=limits, gains=SETTINGS.gains._replace(u_d=0.8 * limits.speed)
    )

    def least(seconds):
        settings = slow._replace(evasion=e._replace(horizon=seconds))
        overtaking = [coming(-2.5, 0.0, 0.7, 0.0, radius=0.4)]
        return drive(WAY, overtaking, seconds=20.0, settings=settings).clearances.min()

    assert least(e.horizon) > 0.05
    assert least(3.0) < 0.0


@pytest.mark.parametrize("name", SHIPPED)
def test_within_the_horizon_a_robot_turns_and_gets_out_of_the_way(name):
    """Driven step by step within its limits; only the slowest have not quite left when it ends."""
    model = robot(name)
    limits, e = model.bounds(), EvasionParams()
    seconds = horizon(model.outline, limits, e)
    assert 3.0 <= seconds <= 6.0
    turned, left, twist = 0.0, 0.0, Twist(0.0, 0.0)
    for _ in range(round(seconds / 0.01)):
        turning = turned < 0.5 * math.pi
        wanted = Twist(0.0, e.yaw_rate) if turning else Twist(e.speed, 0.0)
        twist = achievable(wanted, twist, limits, 0.01)
        turned, left = turned + 0.01 * twist.omega, left + 0.01 * twist.v
    assert left > 0.8 * (model.reach + 0.5 + e.clearance)


def test_the_horizon_grows_as_a_robot_is_slower_and_has_bounds():
    square = np.array([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])
    e = EvasionParams(speed=2.0)
    limits = [Limits(v, 2.0, 2.0, 6.0) for v in (2.0, 0.5, 0.4, 0.3, 0.2, 0.05, 0.0)]
    found = [horizon(square, one, e) for one in limits]
    assert found == sorted(found)
    assert (found[0], found[-1]) == (3.0, 6.0)


SLOW = {"turtlebot3_burger", "turtlebot3_waffle", "turtlebot4"}
"""Shipped robots slower than walkers."""


def test_the_slower_a_robot_leaves_the_less_movers_that_may_set_off_count():
    full = EvasionParams().sets_off_weight
    weights = {}
    for name in SHIPPED:
        model = robot(name)
        e = adapted(EvasionParams(), model.outline, model.bounds())
        assert e.horizon == horizon(model.outline, model.bounds(), EvasionParams())
        weights[name] = e.sets_off_weight
    assert weights["sally"] == weights["jackal"] == full  # as it was tuned for Sally
    assert all(weights[name] < 0.1 * full for name in SLOW)
    assert 0.1 * full < weights["husky"] < weights["mir100"] < full
    square = np.array([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])
    limits = [Limits(1.2, a, 2.0, 6.0) for a in (4.0, 1.0, 0.7, 0.4, 0.0)]
    found = [adapted(EvasionParams(), square, one).sets_off_weight for one in limits]
    assert found == sorted(found, reverse=True)
    assert (found[0], found[-1]) == (full, 0.0)


def test_scenarios_and_campaigns_adapt_evasion_to_the_robot_alike():
    burger = robot("turtlebot3_burger")
    pilot = under(rooms.case(8577, 9, burger).setup, "guard").pilot
    assert pilot is not None
    params = EvasionModel().params(burger.outline, burger.bounds(), 0.1)
    chosen = EvasionModel(horizon_s=2.0).params(burger.outline, burger.bounds(), 0.1)
    assert params.sets_off_weight == chosen.sets_off_weight < EvasionParams().sets_off_weight
    assert pilot.settings.evasion.sets_off_weight == params.sets_off_weight
    assert chosen.horizon == 2.0


@pytest.mark.parametrize("number", first([9, 22]))
def test_a_slow_robot_is_not_walked_into_where_a_predicted_contact_can_be_avoided(number):
    """In these rooms it was, when it kept off all that might set off at it."""
    one = run_episode(rooms.case(8577, number, robot("turtlebot3_burger")), "guard")
    assert one.arrived
    assert one.contacts_moving + one.contacts_standing == 0


def test_without_movers_nothing_is_changed():
    still = [(2.0, 0.6, 0.2, 0.7, 0.0, 0.0)]
    with_it, without = (
        drive(WAY, still, settings=ON, max_acceleration=0.0),
        drive(WAY, still, settings=OFF, max_acceleration=0.0),
    )
    np.testing.assert_array_equal(with_it.poses, without.poses)


def test_a_mover_far_away_is_not_evaded():
    done = drive(WAY, [coming(3.0, 4.0, 0.5, 0.0)], seconds=30.0, settings=ON)
    assert EVADING not in {d.behavior for d in done.decisions}


def test_it_comes_back_to_its_path():
    done = drive(WAY, [ENCOUNTERS["head-on"]], seconds=40.0, settings=ON)
    assert abs(done.poses[:, 1]).max() > 0.3  # it went round
    assert abs(done.poses[-1, 1]) < 0.1


WALKERS = {
    "from the right": Body((3.0, -2.5, 0.0, 0.5, 0.25, 0.6)),
    "from the left": Body((3.0, 2.5, 0.0, -0.5, 0.25, 0.6)),
    "from the right, slower": Body((3.5, -2.5, 0.0, 0.4, 0.25, 0.6)),
}


@pytest.mark.parametrize("name", first(WALKERS))
def test_a_walker_seen_by_lidar_is_kept_off(name):
    """What a LiDAR tells of a velocity is never twice the same: a motion that the filter could only
    just stop from was begun in front of it, and then could not be continued."""
    setup = with_pilot(crossing(WALKERS[name]), lidars=SALLY.lidars)
    rows = run(setup).rows
    assert rows["arrived"][-1]
    assert rows["clearance"].min() > 0.05


def _least_gap(pilot, seen, steps):
    """Between the robot and the discs that it sees at each step [m]."""
    pose, twist, gaps = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), []
    for k in range(steps):
        obstacles = seen(k)
        if k % 10 == 0:
            pilot.take(pilot.plan(pose, twist, obstacles), pose, twist)
        d = pilot.step(k * DT, pose, twist, CENTRED, obstacles)
        gaps.append(
            outline_clearance(pose, SALLY.outline, 0.5, obstacles.discs, np.empty((0, 4)), 9.0)
        )
        twist = achievable(d.safe, twist, ON.limits, DT)
        pose = arc(pose, twist, DT)
    return min(gaps)


def test_a_mover_that_turns_towards_the_robot_is_predicted_to_turn():
    """A walker on a circle that passes through where the robot stands."""

    def seen(k):
        a = 0.35 * k * DT
        x, y = 1.6 * math.sin(a) - 1.6, 1.6 * math.cos(a)
        vx, vy = 0.56 * math.cos(a), -0.56 * math.sin(a)
        return surroundings([disc(x, y, 0.25, 0.75, vx, vy)], [0.5])

    pilot = Pilot(through([(0.0, 0.0), (0.01, 0.0)], 0.5), ON)
    assert _least_gap(pilot, seen, 600) > 0.05


def test_an_operator_who_leads_is_not_overruled():
    """Whole deflection straight on: the command asked for is the person's alone."""

    def hand(_time, _pose):
        return 1.0, 0.0

    done = drive(WAY, [ENCOUNTERS["head-on"]], seconds=5.0, hand=hand, settings=ON)
    led = [d for d in done.decisions if d.behavior == LED]
    assert led
    assert EVADING not in {d.behavior for d in done.decisions[50:]}
    for d in led[50:]:
        assert d.nominal.v == pytest.approx(d.operator.v, abs=0.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize("column", range(6))
def test_the_requested_twist_is_finite_whatever_the_input(bad, column):
    pilot = Pilot(through(WAY, 0.5), ON)
    rows = np.array([disc(*coming(3.0, 0.1, -0.5, 0.0)), disc(*coming(2.0, 0.2, -0.5, 0.0))])
    rows[1, column] = bad
    obstacles = surroundings(rows, np.array([0.5, 0.5]))
    for k in range(12):
        d = pilot.step(k * DT, Pose(0.0, 0.0, 0.0), Twist(0.2, 0.0), CENTRED, obstacles)
        requested = (*d.safe, *d.nominal, *d.tracking)
        assert np.isfinite(requested).all()


def test_a_mover_that_slows_down_is_predicted_to_stop_and_not_to_come_back():
    """It walks away ahead of the robot, and stops: had it been predicted back, the robot would
    flee. It may set off again; what the robot does about that is another matter."""
    settings = ON._replace(evasion=EvasionParams(sets_off_weight=0.0))
    pilot = Pilot(through([(0.0, 0.0), (0.01, 0.0)], 0.5), settings)
    pose, twist, went = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), 0.0
    x, v = 1.1, 0.7
    for k in range(150):
        seen = surroundings([disc(x, 0.0, 0.25, 0.75, v, 0.0)], [1.0])
        if k % 10 == 0:
            pilot.take(pilot.plan(pose, twist, seen), pose, twist)
        d = pilot.step(k * DT, pose, twist, CENTRED, seen)
        twist = achievable(d.safe, twist, ON.limits, DT)
        pose = arc(pose, twist, DT)
        went = max(went, math.hypot(pose.x, pose.y))
        x, v = x + v * DT, max(v - 0.7 * DT, 0.0)
    assert went < 0.2


def _relevant(x, y, vx, vy, ax, ay, top_speed):
    """One relevant mover, known exactly."""
    mover = np.zeros((1, VELOCITY_ERROR + 1))
    mover[0, [MX, MY, MVX, MVY, AX, AY, TOP_SPEED]] = x, y, vx, vy, ax, ay, top_speed
    mover[0, [M_RADIUS, MAX_ACCELERATION, GROWTH, TURNING, LEAVING]] = 0.4, 1.0, 0.1, 0.8, 1.5
    return mover


def _foretold_and_driven(rng):
    """How far apart the robot is after 0.8 s beside a mover that sets off at it or speeds up, as
    the planner foretells it and as the filter lets it go [m]."""
    bearing, away = rng.uniform(-math.pi, math.pi), rng.uniform(1.0, 2.2)
    x, y = away * math.cos(bearing), away * math.sin(bearing)
    heads = bearing + math.pi + rng.uniform(-0.8, 0.8)
    ax, ay, u = math.cos(heads), math.sin(heads), rng.uniform(0.0, 0.8)
    start, before = Pose(0.0, 0.0, 0.0), Twist(float(rng.choice([0.0, 0.5, 1.0])), 0.0)
    requested = Twist(float(rng.choice([-1.0, 0.5, 1.0])), rng.uniform(-1.0, 1.0))
    movers = _relevant(x, y, u * ax, u * ay, ax, ay, 2.0)
    obstacles, reach = surroundings(np.empty((0, 6))), circumscribed_radius(ON.outline)
    e, way = EvasionParams(speed=1.0), course(through(WAY, 0.8), 0, True, ON.pace)
    context = context_at(
        trajectories(movers, reach, e), movers, obstacles, start, way, CourseClock(),
        ON.outline, reach, ON.limits, e,
    )  # fmt: skip
    went = roll_out_piece(
        context, PredictedMotion(start, before, 0.0, 0.0, -1.0), requested, 0.8, ON.limits, e, 1e9
    )
    pose, twist = start, before
    for k in range(40):
        t = k * DT
        at, v = u * t + 0.5 * t * t, u + t
        mover = disc(x + ax * at, y + ay * at, 0.4, 0.9, ax * v, ay * v)
        passed = guard(
            pose, twist, requested, surroundings([mover], [1.0]), ON.outline, ON.limits, ON.rules,
            True,
        )  # fmt: skip
        twist = passed.twist
        pose = arc(pose, twist, DT)
    return math.hypot(went.pose.x - pose.x, went.pose.y - pose.y)


def test_the_filter_is_predicted_as_it_acts():
    """A planner that thinks that it will be stopped where it will not be gives up a way out."""
    rng = np.random.default_rng(5)
    apart = [_foretold_and_driven(rng) for _ in range(200)]
    assert np.median(apart) < 0.05
    assert np.quantile(apart, 0.9) < 0.1


def test_a_mover_at_rest_for_a_moment_is_still_evaded():
    """Between two key frames a disc is as slow as noise for a tenth of a second. For so long the
    robot forgot it, followed its course again, and had turned when the disc set off at it."""
    history, minded = empty_mover_history(), []
    for k in range(30):
        v = max(0.5 - 0.1 * max(k - 5, 0), 0.01)  # then it rests, and sways a little
        obstacles = surroundings([disc(1.5, 0.0, 0.3, 0.8, v, 0.0)], [1.0])
        seen = updated_history(history, obstacles.discs, obstacles.velocity_error, 0.1)
        history[: len(seen)] = seen
        minded.append(
            relevant_movers(
                obstacles, seen, Pose(0.0, 0.0, 0.0), 0.46, ON.limits, EvasionParams(), 1.0
            )[1]
        )
    assert set(minded[:15]) == {1}
    assert set(minded[20:]) == {0}


def test_a_mover_that_sets_off_to_another_side_is_soon_predicted_so():
    """It walked east, came to rest, and sets off to the north. Three scans later only half of that
    was used, and for 0.8 s: the robot drove on in front of it."""
    history, e, x, y = empty_mover_history(), EvasionParams(), 0.0, 0.0
    for k in range(24):
        t = 0.1 * k + 0.05
        vx, vy = min(max(2.0 - t, 0.0), 1.0), max(t - 2.0, 0.0)
        obstacles = surroundings([disc(x, y, 0.3, 0.8, vx, vy)], [1.0])
        seen = updated_history(history, obstacles.discs, obstacles.velocity_error, 0.1)
        history[: len(seen)], history[len(seen) :] = seen, math.nan
        x, y = x + 0.1 * vx, y + 0.1 * vy
    movers, _ = relevant_movers(obstacles, seen, Pose(1.0, 3.0, 0.0), 0.46, ON.limits, e, 1.0)
    ahead = trajectories(movers, 0.46, e)[:, 0, [PX, PY]]
    dx, dy = ahead[15] - ahead[0]
    assert dx == pytest.approx(0.0, abs=0.1)
    assert dy == pytest.approx(0.35 * 1.5 + 0.5 * 1.5 * 1.5, abs=0.2)


def _accelerations(velocities, error):
    """What is estimated after each of these velocities, (n, 2), a tenth of a second apart."""
    history, out = empty_mover_history(), []
    for vx, vy in velocities:
        obstacles = surroundings([disc(0.0, 0.0, 0.3, 0.8, vx, vy)], [1.0], velocity_error=[error])
        seen = updated_history(history, obstacles.discs, obstacles.velocity_error, 0.1)
        history[: len(seen)], history[len(seen) :] = seen, math.nan
        out.append(acceleration(seen[0], 1.0))
    return np.array(out)


def test_a_mover_known_exactly_has_the_acceleration_of_its_last_two_velocities():
    times = 0.1 * np.arange(12)
    curve = np.column_stack((np.cos(times), np.sin(times)))
    estimated = _accelerations(curve, 0.0)[1:]
    assert estimated == pytest.approx(np.diff(curve, axis=0) / 0.1, abs=1e-4)


def test_noise_of_a_velocity_is_no_acceleration():
    """Predicted from differences of velocities that are 3 cm/s wrong, a mover at constant velocity
    was to stop or to turn, another way each time, and so did the robot before it."""
    rng = np.random.default_rng(7)
    noisy = np.array([0.8, 0.0]) + rng.normal(0.0, 0.03, (400, 2))
    estimated = _accelerations(noisy, 0.09)[6:]
    differences = np.diff(noisy, axis=0)[5:] / 0.1
    assert np.sqrt(np.mean(estimated**2)) < 0.3 * np.sqrt(np.mean(differences**2))


def test_a_mover_that_sets_off_stands_out_of_the_noise_after_three_scans():
    rng = np.random.default_rng(8)
    found = []
    for _ in range(100):
        speed = np.maximum(0.1 * (np.arange(12) - 8), 0.0) + 0.01
        velocities = np.column_stack((speed, np.zeros(12))) + rng.normal(0.0, 0.03, (12, 2))
        found.append(_accelerations(velocities, 0.09)[-1])
    assert np.mean(found, axis=0) == pytest.approx([0.8, 0.0], abs=0.2)
    assert np.quantile(np.array(found)[:, 0], 0.1) > 0.4


def test_an_object_that_seems_to_walk_for_a_moment_is_soon_forgotten():
    """A static object that moves by noise is tracked as a walker for a scan or two."""
    history, minded = empty_mover_history(), []
    for k in range(10):
        obstacles = surroundings(
            [disc(1.5, 0.0, 0.3, 0.8, 0.5 if 3 <= k < 6 else 0.01, 0.0)], [1.0]
        )
        seen = updated_history(history, obstacles.discs, obstacles.velocity_error, 0.1)
        history[: len(seen)] = seen
        minded.append(
            relevant_movers(
                obstacles, seen, Pose(0.0, 0.0, 0.0), 0.46, ON.limits, EvasionParams(), 1.0
            )[1]
        )
    assert minded == [0] * 3 + [1] * 3 + [0] * 4


def _passes(weight):
    """How near the robot comes to a mover that comes to rest 0.8 m beside its path [m]."""
    settings = ON._replace(evasion=EvasionParams(speed=0.8, sets_off_weight=weight))

    def seen(k):
        t = max(3.0 - k * DT, -1.0)  # it rests after 3 s, and sways a little
        y, v = 0.8 + 0.15 * t * abs(t), -0.3 * abs(t) if t > 0.0 else 0.01
        return surroundings([disc(2.5, y, 0.3, 0.8, 0.0, v)], [1.0])

    return _least_gap(Pilot(through([(0.0, 0.0), (5.0, 0.0)], 0.5), settings), seen, 400)


def test_the_robot_keeps_farther_from_a_stopped_mover_that_may_turn_on_it():
    assert _passes(EvasionParams().sets_off_weight) > _passes(0.0) + 0.1


def test_a_mover_of_uncertain_velocity_is_not_taken_to_run():
    """A velocity error was once reported as acceleration. Taken to last, it doubled the distance
    that the robot kept from a stopped mover: it waited four times as long."""
    e = EvasionParams()

    def far(most, off=0.0):
        history = empty_mover_history()
        for v in [0.6] * 10 + [0.4] * 6:
            slow = [disc(2.0, 0.0, 0.3, 0.8, v, 0.0)]
            obstacles = surroundings(slow, [most], velocity_error=[off])
            seen = updated_history(history, obstacles.discs, obstacles.velocity_error, 0.1)
            history[: len(seen)] = seen
        movers, _ = relevant_movers(obstacles, seen, Pose(0.0, 0.0, 0.0), 0.46, ON.limits, e, 1.0)
        return trajectories(movers, 0.46, e)[0, 0, FAR]

    assert far(3.5) == far(1.0) == far(1.0, 0.5)
    assert far(0.5) < far(1.0)


def _risk_distance(speeds, off, wary=1.0):
    """Distance below which a mover that had these speeds, a tenth of a second each, causes risk;
    its velocity is known to `off` [m/s, m]."""
    history, e, x = empty_mover_history(), EvasionParams(), 2.0
    for v in speeds:
        obstacles = surroundings([disc(x, 0.0, 0.3, 0.8, v, 0.0)], [1.0], velocity_error=[off])
        seen = updated_history(history, obstacles.discs, obstacles.velocity_error, 0.1)
        history[: len(seen)], x = seen, x + 0.1 * v
    movers, _ = relevant_movers(obstacles, seen, Pose(x, 1.0, 0.0), 0.46, ON.limits, e, wary)
    return trajectories(movers, 0.46, e)[0, 0, FAR]


REST = [0.6] * 20 + [0.3, 0.05, 0.05]


def test_who_stops_is_given_more_room_if_the_velocity_is_uncertain():
    """That it sets off is then noticed later."""
    distances = [_risk_distance(REST, off) for off in (0.0, 0.1, 0.2)]
    assert distances[0] + 0.2 < distances[1] < distances[2]


def test_who_walks_on_without_a_rest_is_given_no_more_room_for_it():
    """Nor is one that last rested more than ten seconds ago."""
    for speeds in ([0.6] * 20 + [0.3, 0.12], REST + [0.6] * 120):
        assert _risk_distance(speeds, 0.2) == _risk_distance(speeds, 0.0)
    assert _risk_distance(REST + [0.6] * 5, 0.2) > _risk_distance(REST + [0.6] * 5, 0.0) + 0.2


def test_a_robot_that_evades_for_long_is_less_wary():
    """Held up for 10 s by who may set off, it comes nearer; after 20 s it keeps no more room for an
    uncertain velocity. Once on its path for as long, it is as wary as ever."""
    held = Pilot(through([(0.0, 0.0), (6.0, 0.0)], 0.5), ON)
    standing = surroundings([disc(0.9, 0.0, 0.4, 0.4, 0.06, 0.0)], [1.0])
    lasted = []
    for k in range(int(30.0 / DT)):
        held.step(k * DT, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), CENTRED, standing)
        lasted.append(held.state.evasion.lasted)
    assert lasted[int(10.0 / DT)] == pytest.approx(10.0, abs=0.3)
    assert max(lasted) == lasted[-1] == LONG
    for k in range(int(25.0 / DT)):
        held.step(30.0 + k * DT, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), CENTRED, surroundings([]))
    assert held.state.evasion.lasted == 0.0
    assert _risk_distance(REST, 0.2) > _risk_distance(REST, 0.2, 0.5) > _risk_distance(REST, 0.0)
    assert _risk_distance(REST, 0.2, 0.0) == _risk_distance(REST, 0.0)


@pytest.mark.parametrize("v", [0.0, 0.01, 0.5, 2.0])
def test_an_overlap_has_a_risk_like_any_other(v):
    movers = _relevant(0.3, 0.0, v, 0.0, 0.0, 0.0, 2.0 * v)
    here, course_ = Pose(0.0, 0.0, 0.0), course(through(WAY, 0.8), 0, True, ON.pace)
    obstacles, reach, e = (
        surroundings(np.empty((0, 6))),
        circumscribed_radius(ON.outline),
        EvasionParams(),
    )
    context = context_at(
        trajectories(movers, reach, e), movers, obstacles, here, course_, CourseClock(),
        ON.outline, reach, ON.limits, e,
    )  # fmt: skip
    risk, gap = risk_at(context, here, 0, e)
    assert gap < 0.0 < risk < math.inf


def _cost_of_standing(aside: float) -> float:
    """In the way of a mover that passes so far to the left, and overlaps from a second on [m]."""
    here, way, e = Pose(0.0, 0.0, 0.0), course(through(WAY, 0.8), 0, True, ON.pace), EvasionParams()
    obstacles, reach = surroundings(np.empty((0, 6))), circumscribed_radius(ON.outline)
    for start in np.arange(1.0, 3.0, 0.02):
        movers = _relevant(start, aside, -0.8, 0.0, 0.0, 0.0, 1.6)
        ahead = trajectories(movers, reach, e)
        at = [disc_clearance(here, ON.outline, x, y, 0.4) for x, y in ahead[:, 0, [PX, PY]]]
        if np.argmax(np.array(at) <= 0.0) == 10:
            context = context_at(
                ahead, movers, obstacles, here, way, CourseClock(), ON.outline, reach, ON.limits, e
            )
            return waiting_cost(context, here, 0.0, 0.0, e)
    raise AssertionError("never a second before")


def test_of_contacts_at_the_same_time_the_shallower_costs_less():
    """Else a robot does not leave the way of a mover that it can only just not leave in time."""
    graze, shallow, deep, deeper = (_cost_of_standing(aside) for aside in (0.68, 0.6, 0.3, 0.0))
    assert graze < shallow - 10.0 < deep - 50.0
    assert deep == pytest.approx(deeper, abs=10.0)
    assert graze > 100.0  # and yet more than any way round
