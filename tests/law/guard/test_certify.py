import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.bounds import brake_steps, braked, coasting
from cohelm.law.guard.certify import CLEAR, blocking_obstacle, manoeuvre
from cohelm.law.guard.surroundings import surroundings
from cohelm.robot.clearance import circumscribed_radius
from tests.law.guard.scenes import (
    SALLY,
    SALLY_LIMITS,
    angles,
    beyond,
    braking,
    clearances,
    inside_limits,
    lengths,
    limits,
    moved,
    outlines,
    still_things,
    twists,
)  # fmt: skip

DT = 0.02
FINE = 20
"""Looks in one control step; the robot goes less than 2 mm between two."""


@st.composite
def commands(draw):
    lim = draw(limits())
    return lim, draw(twists(lim))


def stopped_after(twist, lim):
    """The held twist and then the braking, as poses every DT / FINE, from the origin."""
    pose = Pose(0.0, 0.0, 0.0)
    yield pose
    for step in [twist, *braking(twist, lim, DT)]:
        for k in range(1, FINE + 1):
            yield moved(pose, step, DT * k / FINE)
        pose = moved(pose, step, DT)


def certificate(outline, twist, lim, around, clear=0.015):
    reach = circumscribed_radius(outline)
    m = manoeuvre(Pose(0.0, 0.0, 0.0), twist, lim, DT, reach)
    return blocking_obstacle(m, outline, reach, around, clear)


@given(outlines(), commands(), still_things())
def test_a_certified_command_stays_clear_of_all_static_obstacles(outline, command, around):
    lim, twist = command
    around = beyond(outline, around, 0.015)
    if certificate(outline, twist, lim, around) == CLEAR:
        for pose in stopped_after(twist, lim):
            assert (clearances(outline, pose, around) >= 0.0075 - 1e-9).all()


@given(outlines(), commands(), still_things())
def test_a_refused_path_comes_near_the_named_obstacle(outline, command, around):
    """No needless refusal: within `clear` and what lies between two looks of this test."""
    lim, twist = command
    around = beyond(outline, around, 0.015)
    thing = certificate(outline, twist, lim, around)
    if thing != CLEAR:
        nearest = min(
            clearances(outline, pose, around)[thing] for pose in stopped_after(twist, lim)
        )
        pace = abs(twist.v) + abs(twist.omega) * circumscribed_radius(outline)
        assert nearest <= 0.015 + pace * DT / FINE


@st.composite
def walkers(draw):
    """A disc that may accelerate by up to its largest acceleration, and does so: always one way,
    or weaving."""
    max_acceleration = draw(st.sampled_from([0.0, 0.5, 2.0]))
    x, y, radius = draw(lengths), draw(lengths), draw(st.floats(0.05, 0.4))
    speed, course = draw(st.floats(0.0, 1.5)), draw(angles)
    start = np.array([x, y, speed * math.cos(course), speed * math.sin(course)])
    push = draw(st.sampled_from(["at", "side", "weave"]))
    return radius, max_acceleration, start, push


def one_disc(radius, max_acceleration, state, velocity_error=0.0):
    """One disc as the guard gets it."""
    row = np.array([[*state, radius, 0.2]])
    return surroundings(row, [max_acceleration], velocity_error=[velocity_error])


def walked(walker, robot, dt):
    """The next state of a walker that accelerates at the robot, across, or to and fro."""
    radius, max_acceleration, (x, y, vx, vy), push = walker
    away = math.atan2(robot.y - y, robot.x - x)
    turn = {"at": 0.0, "side": math.pi / 2, "weave": math.pi * (int(10 * x) % 2)}[push]
    ax, ay = max_acceleration * math.cos(away + turn), max_acceleration * math.sin(away + turn)
    x, y = x + vx * dt + 0.5 * ax * dt * dt, y + vy * dt + 0.5 * ay * dt * dt
    return radius, max_acceleration, np.array([x, y, vx + ax * dt, vy + ay * dt]), push


@given(outlines(), commands(), walkers(), st.sampled_from([0.0, 0.0, 0.1, 0.6]), angles)
def test_a_certified_command_is_hit_by_no_walker_before_it_stands(
    outline, command, walker, off, way
):
    """Nor by one whose velocity is wrong by its velocity_error."""
    lim, twist = command
    radius, max_acceleration, state, push = walker
    assume(max_acceleration > 0.0 or off > 0.0 or state[2:].any())  # else it rests
    reported = one_disc(radius, max_acceleration, state, off)
    if certificate(outline, twist, lim, reported) != CLEAR or twist == Twist(0.0, 0.0):
        return
    state = state + np.array([0.0, 0.0, off * math.cos(way), off * math.sin(way)])
    walker = radius, max_acceleration, state, push
    for pose in list(stopped_after(twist, lim))[: FINE * max(len(braking(twist, lim, DT)), 1) + 1]:
        assert clearances(outline, pose, one_disc(*walker[:3]))[0] >= 0.0075 - 1e-9
        walker = walked(walker, pose, DT / FINE)


@st.composite
def oncomers(draw, agilities=(0.0, 0.5, 2.0)):
    """A disc 0.05 to 1 m off that may be on its way to the robot: radius, max_acceleration,
    state, velocity_error."""
    bearing, off = draw(angles), draw(st.floats(-0.6, 0.6))
    away = draw(st.floats(0.4, 1.8))
    speed = draw(st.one_of(st.just(0.0), st.floats(0.0, 2.0)))
    course = bearing + math.pi + off
    state = [away * math.cos(bearing), away * math.sin(bearing)]
    state += [speed * math.cos(course), speed * math.sin(course)]
    radius, off = draw(st.floats(0.02, 0.3)), draw(st.sampled_from([0.0, 0.0, 0.3]))
    return radius, draw(st.sampled_from(agilities)), np.array(state), off


def worst_gaps(outline, twist, lim, radius, max_acceleration, state, off, until=0.0):
    """The gap at each of the looks of `stopped_after`, the disc grown by its velocity's error t +
    largest acceleration t^2 / 2; also while the robot then stands, until that time [s]."""
    poses = list(stopped_after(twist, lim))
    poses += [poses[-1]] * (round(until / DT * FINE) + 1 - len(poses))
    for k, pose in enumerate(poses):
        t = k * DT / FINE
        x, y = state[:2] + state[2:] * t
        reached = radius + off * t + max_acceleration * t * t / 2
        yield clearances(outline, pose, surroundings([[x, y, 0.0, 0.0, reached, 0.2]]))[0]


@given(outlines(), commands(), oncomers())
def test_a_mover_is_cleared_exactly_where_it_can_not_come_near_while_the_robot_moves(
    outline, command, oncomer
):
    lim, twist = command
    _, max_acceleration, state, off = oncomer
    assume(twist != Twist(0.0, 0.0))
    assume(max_acceleration > 0.0 or off > 0.0 or state[2:].any())  # else it rests
    around = one_disc(*oncomer)
    pace = (
        abs(twist.v) + abs(twist.omega) * circumscribed_radius(outline) + np.hypot(*state[2:]) + off
    )
    now = clearances(outline, Pose(0.0, 0.0, 0.0), around)[0]
    if certificate(outline, twist, lim, around) == CLEAR:
        gaps = list(worst_gaps(outline, twist, lim, *oncomer))
        if now < 0.015:  # see `_leaves`
            gaps = gaps[: FINE * max(len(braking(twist, lim, DT)), 1) + 1]
        assert min(gaps) >= 0.0075 - 1e-9
    else:  # the certificate looks on until rounded braking has ended
        stop = DT * (1 + math.ceil(brake_steps(twist, lim, DT)))
        between = (pace + max_acceleration * stop) * DT / FINE
        assert min(worst_gaps(outline, twist, lim, *oncomer, stop)) <= 0.015 + between


@given(commands())
def test_braking_ends_at_rest_within_the_limits_and_on_the_certified_arc(command):
    lim, twist = command
    steps, before, pose = [], twist, Pose(0.0, 0.0, 0.0)
    while before != Twist(0.0, 0.0):
        after = braked(before, lim, DT)
        assert inside_limits(after, before, lim, DT)
        assert len(steps) <= brake_steps(twist, lim, DT)
        steps.append(after)
        pose, before = moved(pose, after, DT), after
    ahead = moved(Pose(0.0, 0.0, 0.0), twist, coasting(twist, lim, DT))
    assert pose == pytest.approx(ahead, abs=1e-9)
    expected = braking(twist, lim, DT)
    assert len(steps) - 1 in (len(expected) - 1, len(expected), len(expected) + 1)


@pytest.mark.parametrize(
    "around",
    [
        surroundings([[0.7, 0.0, 0.0, 0.0, 0.1, 0.2]]),
        surroundings([[0.7, 0.0, 0.0, 0.0, 0.1, 0.2]], [0.1]),
        surroundings(segments=[[0.6, -1.0, 0.6, 1.0]]),
        surroundings(points=[[math.nan, 0.0], [0.6, 0.0]]),
    ],
)
def test_driving_on_into_an_obstacle_ahead_is_refused_and_backing_off_is_not(around: Surroundings):
    last = len(around.discs) + len(around.segments) + len(around.points) - 1
    assert certificate(SALLY, Twist(1.0, 0.0), SALLY_LIMITS, around) == last
    assert certificate(SALLY, Twist(-1.0, 0.0), SALLY_LIMITS, around) == CLEAR
    assert certificate(SALLY, Twist(0.0, 0.0), SALLY_LIMITS, around) == CLEAR


@pytest.mark.parametrize("clearance", [0.0085, 0.011, 0.0149])
def test_a_disc_that_came_near_the_standing_robot_may_be_left_but_not_approached(clearance):
    person = surroundings([[0.46 + clearance, 0.05, 0.0, 0.0, 0.1, 0.2]], [1.0])
    for away in (-0.04, -0.1, -0.5, -1.0):
        assert certificate(SALLY, Twist(away, 0.0), SALLY_LIMITS, person) == CLEAR
    for near in (Twist(1e-3, 0.0), Twist(0.04, 0.0), Twist(0.0, 0.1), Twist(0.0, -0.1)):
        assert certificate(SALLY, near, SALLY_LIMITS, person) == 0
    assert certificate(SALLY, Twist(-0.001, 0.0), SALLY_LIMITS, person) == 0  # slower than they
    assert certificate(SALLY, Twist(0.0, 0.0), SALLY_LIMITS, person) == CLEAR


def test_a_disc_upon_the_robot_holds_it_where_it_stands():
    person = surroundings([[0.468, 0.0, 0.0, 0.0, 0.1, 0.2]], [1.0])
    assert certificate(SALLY, Twist(-0.1, 0.0), SALLY_LIMITS, person) == 0
    assert certificate(SALLY, Twist(0.0, 0.0), SALLY_LIMITS, person) == CLEAR


def test_a_disc_at_rest_with_a_velocity_error_is_not_static():
    """A mover of unknown velocity: at 1.3 m/s it is there before the robot stands."""
    for off, said in ((0.0, CLEAR), (1.3, 0)):
        person = surroundings([[1.0, 0.0, 0.0, 0.0, 0.1, 0.2]], [0.0], velocity_error=[off])
        assert certificate(SALLY, Twist(0.6, 0.0), SALLY_LIMITS, person) == said


def test_the_robot_does_not_move_before_a_mover_faster_than_itself():
    person = surroundings([[0.47, 0.0, -0.5, 0.0, 0.1, 0.2]], [1.0])
    assert certificate(SALLY, Twist(-0.3, 0.0), SALLY_LIMITS, person) == 0
    assert certificate(SALLY, Twist(-1.0, 0.0), SALLY_LIMITS, person) == 0  # it has to stop, too


def test_a_disc_that_is_being_left_stays_beyond_half_the_hard_margin_between_two_steps():
    """Steps of 0.1 s: the corner swings past a disc that is as far off after it as before."""
    reach, backing = circumscribed_radius(SALLY), Twist(-0.945, 0.0)
    passing = surroundings([[0.352572, -0.459795, 0.782436, 0.024635, 0.155611, 0.2]])
    m = manoeuvre(Pose(0.0, 0.0, 0.0), backing, SALLY_LIMITS, 0.1, reach)
    assert blocking_obstacle(m, SALLY, reach, passing, 0.015) == 0


@given(outlines(), commands(), oncomers())
def test_every_command_finds_a_mover_no_nearer_than_clear_or_than_it_was(outline, command, oncomer):
    lim, twist = command
    _, max_acceleration, state, off = oncomer
    assume(twist != Twist(0.0, 0.0))
    assume(max_acceleration > 0.0 or off > 0.0 or state[2:].any())
    around = one_disc(*oncomer)
    now = clearances(outline, Pose(0.0, 0.0, 0.0), around)[0]
    if certificate(outline, twist, lim, around) == CLEAR:
        moving = len(braking(twist, lim, DT)) or 1  # in the last step of braking it stands
        found = list(worst_gaps(outline, twist, lim, *oncomer))[::FINE][: moving + 1]
        assert min(found) >= min(now, 0.015) - 1e-9


@pytest.mark.parametrize("kind", ["point", "disc", "mover"])
def test_a_corner_that_swings_past_between_two_commands_is_refused(kind):
    """It is 9 mm away before the step and after it, and 5 mm in between."""
    reach = circumscribed_radius(SALLY)
    swing, off = 0.016 / reach, 0.00494
    ahead = math.atan2(0.29, 0.36) + 0.5 * swing
    turning = Twist(0.0, swing / DT)
    x, y = math.cos(ahead), math.sin(ahead)
    far = reach + off
    past = {
        "point": surroundings(points=[[far * x, far * y]]),
        "disc": surroundings([[far * x, far * y, 0.0, 0.0, 1e-4, 0.2]]),
        "mover": surroundings([[far * x, far * y, 1e-6, 0.0, 1e-4, 0.2]]),
    }[kind]
    for turned in (0.0, swing):
        assert clearances(SALLY, Pose(0.0, 0.0, turned), past)[0] > 0.0085
    assert clearances(SALLY, Pose(0.0, 0.0, 0.5 * swing), past)[0] < 0.0075
    assert certificate(SALLY, turning, SALLY_LIMITS, past) == 0
    assert certificate(SALLY, Twist(0.0, 0.0), SALLY_LIMITS, past) == CLEAR


def test_what_takes_too_many_checks_is_refused():
    """A wall a micrometre beside the robot meets it 5 cm ahead; by a hard margin of 0.1 um the
    checks end before. One a millimetre beside it takes few. Nor is a disc followed that is ahead by
    less than the hard margin."""
    wall = surroundings(segments=[[0.36, 0.29 + 1e-6, 1.36, 0.29 - 19e-6]])
    assert certificate(SALLY, Twist(1.0, 0.0), SALLY_LIMITS, wall, 1e-7) == 0
    beside = surroundings(segments=[[0.36, 0.291, 1.36, 0.291]])
    assert certificate(SALLY, Twist(1.0, 0.0), SALLY_LIMITS, beside, 1e-7) == CLEAR
    ahead = surroundings([[0.46 + 9e-8, 0.0, 0.9, 0.0, 0.1, 0.2]])
    assert certificate(SALLY, Twist(0.9, 0.0), SALLY_LIMITS, ahead, 1e-7) == 0
    farther = surroundings([[0.469, 0.0, 0.9, 0.0, 0.1, 0.2]])
    assert certificate(SALLY, Twist(0.9, 0.0), SALLY_LIMITS, farther) == CLEAR


@pytest.mark.parametrize("speed", [0.5, 1e-3, 4e-4, 1e-6])
def test_repeated_waits_never_creep_towards_a_near_obstacle(speed):
    """However little a step takes: fifty a second would add up."""
    wall = surroundings(segments=[[0.367, -3.0, 0.367, 3.0]])
    assert certificate(SALLY, Twist(speed, 0.0), SALLY_LIMITS, wall) == 0
    assert certificate(SALLY, Twist(0.0, speed), SALLY_LIMITS, wall) == 0
    assert certificate(SALLY, Twist(-speed, 0.0), SALLY_LIMITS, wall) == CLEAR
    beside = surroundings(segments=[[-3.0, 0.297, 3.0, 0.297]])
    assert certificate(SALLY, Twist(speed, 0.0), SALLY_LIMITS, beside) == CLEAR


@given(outlines(), commands(), still_things())
def test_every_command_finds_the_clearance_that_the_certificate_guarantees(
    outline, command, around
):
    """Where the next command may come in, after the hold or a braking step, there is no dip."""
    lim, twist = command
    floor = 0.0075 + 0.015 / 16
    around = beyond(outline, around, 1e-3)
    start = clearances(outline, Pose(0.0, 0.0, 0.0), around)
    if certificate(outline, twist, lim, around) == CLEAR:
        for pose in list(stopped_after(twist, lim))[::FINE]:
            assert (clearances(outline, pose, around) >= np.minimum(start, floor) - 1e-9).all()


def test_a_clearance_between_the_hard_margin_and_half_of_it_may_be_used_up_to_the_half():
    wall = surroundings(segments=[[0.372, -3.0, 0.372, 3.0]])
    assert certificate(SALLY, Twist(0.09, 0.0), SALLY_LIMITS, wall) == CLEAR  # 3 mm
    assert certificate(SALLY, Twist(0.2, 0.0), SALLY_LIMITS, wall) == 0  # 12 mm


def thing(ends, drift, kind):
    """A disc that may move, one at rest, a wall or two points, of the same numbers (3, 2)."""
    disc = np.hstack((ends[:1], drift if kind == 0 else 0.0 * drift, [[0.2, 0.4]]))
    if kind < 2:
        return surroundings(disc, [0.5 * (kind == 0)])
    walls = surroundings(segments=[[*ends[1], *ends[2]]])
    return walls if kind == 2 else surroundings(points=ends[1:])


def test_where_in_the_world_all_this_happens_makes_no_difference():
    rng = np.random.default_rng(3)
    reported = []
    for _ in range(150):
        twist = Twist(rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0))
        pose = Pose(*rng.uniform(-30.0, 30.0, 2), rng.uniform(-3.0, 3.0))
        c, s = math.cos(pose.psi), math.sin(pose.psi)
        turn = np.array([[c, s], [-s, c]])
        ends = rng.uniform(-1.2, 1.2, (3, 2))
        drift = rng.uniform(-0.5, 0.5, (1, 2)) * (rng.random() < 0.5)
        kind = rng.integers(4)
        here = thing(ends, drift, kind)
        there = thing(ends @ turn + np.array(pose[:2]), drift @ turn, kind)
        reach = circumscribed_radius(SALLY)
        a = manoeuvre(Pose(0.0, 0.0, 0.0), twist, SALLY_LIMITS, DT, reach)
        b = manoeuvre(pose, twist, SALLY_LIMITS, DT, reach)
        was = blocking_obstacle(a, SALLY, reach, here, 0.015)
        assert was == blocking_obstacle(b, SALLY, reach, there, 0.015)
        reported.append((kind, was == CLEAR))
    assert len(set(reported)) == 8
