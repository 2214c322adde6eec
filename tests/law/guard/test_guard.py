import math

import numba
import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist, disc
from cohelm.law.guard.bounds import braked
from cohelm.law.guard.contact import wall_clearance
from cohelm.law.guard.step import NOTHING
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.verdict import BRAKING, INVALID, SHAPED, STANDING, UNTOUCHED
from tests.law.guard.scenes import (
    HERE,
    JACKAL_LIMITS,
    REST,
    RULES,
    SALLY,
    SALLY_LIMITS,
    beyond,
    clearances,
    guard_step,
    inside_limits,
    lengths,
    limits,
    moved,
    outlines,
    still_things,
    twists,
    wishes,
)  # fmt: skip

anything = st.floats()
EMPTY = surroundings()


@st.composite
def driving(draw):
    lim = draw(limits())
    return lim, draw(twists(lim)), draw(wishes)


@given(outlines(), driving(), still_things())
def test_the_command_is_within_the_limits_to_the_last_digit(outline, state, around):
    lim, before, nominal = state
    got = guard_step(HERE, before, nominal, around, outline, lim)
    assert inside_limits(got.twist, before, lim, RULES.dt)


@given(outlines(), driving(), still_things())
def test_a_nominal_command_far_from_every_bound_passes_to_the_last_bit(outline, state, around):
    lim, before, _ = state
    nominal = Twist(0.9999 * before.v, 0.9999 * before.omega)
    x, y = around.points.T + 12.0
    far = surroundings(
        around.discs + np.array([9, 9, 0, 0, 0, 0]), None, around.segments + 9, np.c_[x, y]
    )
    got = guard_step(HERE, before, nominal, far, outline, lim)
    assert got.twist == nominal
    assert (got.verdict, got.limiting) == (UNTOUCHED, NOTHING)


@given(outlines(), driving(), still_things())
def test_verdict_and_change_describe_the_filters_action(outline, state, around):
    lim, before, nominal = state
    got = guard_step(HERE, before, nominal, around, outline, lim)
    v, omega = got.twist
    change = math.hypot(v - nominal.v, RULES.steer_weight * (omega - nominal.omega))
    assert got.change == pytest.approx(change, abs=1e-12)
    count = len(around.discs) + len(around.segments) + len(around.points)
    assert -1 <= got.limiting < count
    if got.verdict == UNTOUCHED:
        assert got.twist == pytest.approx(nominal, abs=1e-8)
    elif got.verdict == SHAPED:
        assert got.change > 1e-9
    else:
        assert got.verdict == (STANDING if got.twist == REST else BRAKING)
    near = clearances(outline, HERE, around)
    if 0.0 < got.clearance < math.inf:  # the gap of one of them, and if any is near, of the nearest
        assert np.abs(near - got.clearance).min() < 1e-9
    if 0.0 < near.min(initial=math.inf) < RULES.soft_margin:
        assert got.clearance == pytest.approx(near.min(), abs=1e-9)


@st.composite
def mirrors(draw):
    """Left and right, or front and back: signs of x, y, v, omega."""
    return draw(st.sampled_from([(1, -1, 1, -1), (-1, 1, -1, -1), (-1, -1, -1, 1)]))


@given(outlines(), driving(), still_things(), mirrors())
def test_it_guards_both_sides_and_both_directions_alike(outline, state, around, mirror):
    lim, before, nominal = state
    around = beyond(outline, around, 1e-3)
    sx, sy, sv, so = mirror
    got = guard_step(HERE, before, nominal, around, outline, lim)
    there = surroundings(
        around.discs * [sx, sy, sx, sy, 1, 1], None,
        around.segments * [sx, sy, sx, sy], around.points * [sx, sy],
    )  # fmt: skip
    flipped = outline * [sx, sy]
    flipped = flipped[::-1].copy() if sx * sy < 0 else flipped  # counter-clockwise again
    other = guard_step(
        HERE, Twist(sv * before.v, so * before.omega), Twist(sv * nominal.v, so * nominal.omega),
        there, flipped, lim,
    )  # fmt: skip
    assert (sv * other.twist.v, so * other.twist.omega) == pytest.approx(got.twist, abs=1e-7)
    assert other.verdict == got.verdict


@pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="uncompiled, Python raises where IEEE says infinite"
)
@given(st.lists(anything, min_size=25, max_size=25), still_things())
def test_whatever_goes_in_a_number_comes_out(numbers, around):
    """NaN, infinities and the largest floats in pose, speeds, wish and things."""
    x, y, psi, v0, omega0, v, omega = numbers[:7]
    mad = surroundings([numbers[7:13]], [abs(numbers[13])], [numbers[14:18]], [numbers[18:20]])
    for things in (mad, around, surroundings(points=[numbers[20:22]])):
        for lim in (SALLY_LIMITS, JACKAL_LIMITS):
            got = guard_step(
                Pose(x, y, psi), Twist(v0, omega0), Twist(v, omega), things, SALLY, lim
            )
            assert math.isfinite(got.twist.v)
            assert math.isfinite(got.twist.omega)
            assert not math.isnan(got.clearance)
            if not np.isfinite(numbers[:7]).all():
                assert got.verdict == INVALID


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_brakes_from_a_known_speed(bad):
    cruise = Twist(0.5, 0.0)
    cases = [
        (Pose(bad, 0.0, 0.0), Twist(0.5, 0.0), EMPTY),
        (Pose(0.0, 0.0, bad), Twist(0.5, 0.0), EMPTY),
        (HERE, Twist(bad, 0.0), EMPTY),
        (HERE, Twist(0.5, bad), EMPTY),
        (HERE, cruise, surroundings([[3.0, bad, 0.0, 0.0, 0.1, 0.2]])),
        (HERE, cruise, surroundings([[3.0, 0.0, bad, 0.0, 0.1, 0.2]])),
        (HERE, cruise, surroundings([[3.0, 0.0, 0.0, 0.0, 0.1, 0.2]], [bad])),
        (HERE, cruise, surroundings(segments=[[3.0, 0.0, 3.0, bad]])),
    ]
    for pose, nominal, around in cases:
        got = guard_step(pose, cruise, nominal, around, SALLY, SALLY_LIMITS)
        assert got.twist == pytest.approx((0.46, 0.0))
        assert got.verdict == INVALID
    unknown = guard_step(HERE, Twist(bad, 0.0), cruise, EMPTY, SALLY, SALLY_LIMITS)
    assert (*unknown.twist, unknown.verdict) == (0.0, 0.0, INVALID)


def test_a_scan_with_drop_outs_is_a_scan_of_the_rest():
    scan = np.array([[math.nan, math.nan], [math.inf, 0.0], [0.39, 0.0], [1.0, math.nan]])
    got = guard_step(HERE, REST, Twist(1.0, 0.0), surroundings(points=scan), SALLY, SALLY_LIMITS)
    assert got.twist.v == pytest.approx(0.0, abs=1e-12)
    assert got.limiting == 2
    assert got.clearance == pytest.approx(0.03)


def test_ten_thousand_points_all_round_leave_no_way_but_standing():
    turn = np.linspace(-math.pi, math.pi, 10_000)
    ring = surroundings(points=np.c_[0.47 * np.cos(turn), 0.47 * np.sin(turn)])
    for nominal in (Twist(1.0, 0.0), Twist(-1.0, 0.5), Twist(0.3, -2.0)):
        got = guard_step(HERE, REST, nominal, ring, SALLY, SALLY_LIMITS)
        after = moved(HERE, got.twist, 0.02)
        assert clearances(SALLY, after, ring).min() >= 0.0075


def test_a_robot_of_no_size_is_guarded_as_a_point():
    dot = np.zeros((3, 2))
    ahead = surroundings([disc(0.12, 0.0, 0.1)])
    got = guard_step(HERE, REST, Twist(1.0, 0.0), ahead, dot, SALLY_LIMITS)
    assert got.clearance == pytest.approx(0.02)
    assert got.twist.v == pytest.approx(0.0, abs=1e-9)
    away = guard_step(HERE, REST, Twist(-1.0, 0.0), ahead, dot, SALLY_LIMITS)
    assert away.twist.v == pytest.approx(-0.04)


def test_a_robot_without_limits_stops_at_once_in_front_of_a_wall():
    free = SALLY_LIMITS._replace(
        speed=math.inf, yaw_rate=math.inf, wheel_speed=math.inf, wheel_acceleration=math.inf
    )
    wall = surroundings(segments=[[1.0, -1.0, 1.0, 1.0]])
    for outline in (SALLY, np.zeros((1, 2))):
        got = guard_step(HERE, Twist(9.0, 0.0), Twist(99.0, 0.0), wall, outline, free)
        front = outline[:, 0].max()
        assert front + got.twist.v * 0.02 == pytest.approx(1.0 - RULES.soft_margin)


@pytest.mark.parametrize("was", [Twist(-0.0581, 0.0), Twist(-0.1425, 0.0)])
def test_where_no_motion_keeps_all_bounds_it_brakes(was):
    """Too near in front, behind and beside, and turning brings a corner nearer still."""
    box = surroundings(points=[[0.39, 0.0957], [-0.3872, -0.1607], [-0.0622, 0.3053]])
    got = guard_step(Pose(0.0, 0.0, 0.0), was, Twist(0.27, -0.48), box, SALLY, SALLY_LIMITS)
    assert got.twist == braked(was, SALLY_LIMITS, RULES.dt)
    assert got.verdict == BRAKING


def test_it_backs_out_and_turns_where_it_is_boxed_in():
    """Walls ahead and beside, 2 cm off: nothing but backing out is left, and it is left."""
    pen = surroundings(
        segments=[[0.38, -0.31, 0.38, 0.31], [-2.0, 0.31, 0.38, 0.31], [-2.0, -0.31, 0.38, -0.31]]
    )
    forward = guard_step(HERE, REST, Twist(1.0, 0.0), pen, SALLY, SALLY_LIMITS)
    assert forward.twist.v == 0.0
    assert forward.limiting in (0, 1, 2)
    back = guard_step(HERE, REST, Twist(-1.0, 0.0), pen, SALLY, SALLY_LIMITS)
    assert back.twist.v == pytest.approx(-0.04)
    mirrored = surroundings(segments=-pen.segments)
    assert guard_step(
        HERE, REST, Twist(1.0, 0.0), mirrored, SALLY, SALLY_LIMITS
    ).twist.v == pytest.approx(0.04)
    spin = guard_step(HERE, REST, Twist(0.0, 2.0), surroundings([disc(0.7, 0, 0.1)]), SALLY,
                      SALLY_LIMITS)  # fmt: skip
    assert spin.twist == pytest.approx((0.0, 0.16))


@st.composite
def overlapping(draw):
    outline = draw(outlines())
    middle = outline.mean(axis=0)
    x, y = middle + np.array([draw(st.floats(-0.1, 0.1)), draw(st.floats(-0.1, 0.1))])
    kind = draw(st.sampled_from(["disc", "wall", "point"]))
    if kind == "disc":
        return outline, surroundings([disc(x, y, 0.1)])
    if kind == "point":
        return outline, surroundings(points=[[x, y]])
    return outline, surroundings(segments=[[x, y, x + draw(lengths), y + draw(lengths)]])


def depth(outline, pose, around):
    """How deep the one thing is in the outline [m], in the body frame of the pose."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    body = np.array([[c, s], [-s, c]])
    if len(around.segments):
        ends = (around.segments.reshape(2, 2) - [pose.x, pose.y]) @ body.T
        return -wall_clearance(outline, *ends.ravel())
    centre, radius = (
        (around.discs[0, :2], around.discs[0, 4]) if len(around.discs) else (around.points[0], 0.0)
    )
    x, y = body @ (centre - [pose.x, pose.y])
    return radius - wall_clearance(outline, x, y, x, y)


@given(overlapping(), driving())
def test_an_obstacle_inside_the_footprint_never_gets_deeper(scene, state):
    outline, around = scene
    lim, _, nominal = state
    pose, before = HERE, REST
    deep = depth(outline, pose, around)
    assume(deep > 1e-6)
    for _ in range(20):
        got = guard_step(pose, before, nominal, around, outline, lim)
        before = got.twist
        pose = moved(pose, before, 0.02)
        after = depth(outline, pose, around)
        assert after <= max(deep, -RULES.hard_margin / 2) + 1e-9  # once out, as any other thing
        deep = after


@pytest.mark.parametrize(
    "around",
    [
        surroundings([disc(0.4, 0.0, 0.1)]),
        surroundings(points=[[0.3, 0.0]]),
        surroundings(segments=[[0.3, -2.0, 0.3, 2.0]]),
        surroundings(segments=[[0.3, 0.05, 2.0, 0.05]]),
    ],
)
def test_from_an_overlap_it_can_leave_and_then_not_return(around):
    pose, before = HERE, REST
    for _ in range(60):
        got = guard_step(pose, before, Twist(-0.5, 0.0), around, SALLY, SALLY_LIMITS)
        before = got.twist
        pose = moved(pose, before, 0.02)
    assert pose.x < -0.3
    for _ in range(200):
        got = guard_step(pose, before, Twist(1.0, 0.0), around, SALLY, SALLY_LIMITS)
        before = got.twist
        pose = moved(pose, before, 0.02)
        assert clearances(SALLY, pose, around).min() >= 0.0075


def test_the_robots_side_of_a_wall_is_that_of_its_outline_not_of_its_origin():
    """A tractor's hitch: origin behind the wall's line, body in front of it and leaving."""
    body = SALLY + np.array([1.0, 0.0])
    wall = surroundings(segments=[[0.62, -1.0, 0.62, 1.0]])
    away = guard_step(HERE, REST, Twist(1.0, 0.0), wall, body, SALLY_LIMITS)
    assert away.twist.v == pytest.approx(0.04)
    assert guard_step(HERE, REST, Twist(-1.0, 0.0), wall, body, SALLY_LIMITS).twist.v == 0.0


def test_incompatible_parts_are_refused_with_the_reason():
    with pytest.raises(CohelmError, match="max_acceleration"):
        surroundings([disc(1, 0, 0.1)], [0.0, 1.0])
    with pytest.raises(CohelmError, match="velocity_error"):
        surroundings([disc(1, 0, 0.1)], [1.0], velocity_error=[0.0, 1.0])
    with pytest.raises(CohelmError, match="6 columns"):
        surroundings(np.zeros((2, 5)))
