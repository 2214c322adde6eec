"""Each part of the guard by itself, against what its own words say, worked out another way."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, strategies as st

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Pose, Twist, disc
from cohelm.law.guard import approach as approaching
from cohelm.law.guard.approach import approach, approach_rows, max_rows
from cohelm.law.guard.bounds import brake_steps, coasting, wheel_rows
from cohelm.law.guard.certify import _near, _travelled, manoeuvre
from cohelm.law.guard.project import NO_OBSTACLE
from cohelm.law.guard.step import NOTHING
from cohelm.law.guard.surroundings import is_static, surroundings
from cohelm.law.verdict import INVALID, UNTOUCHED
from cohelm.robot.clearance import circumscribed_radius
from cohelm.robot.limits import Limits, unlimited
from tests.law.guard.scenes import (
    HERE,
    REST,
    SALLY,
    SALLY_LIMITS,
    angles,
    clearances,
    guard_step,
    lengths,
    limits,
    moved,
    outlines,
    still_things,
    twists,
)

DT = 0.02
EMPTY = surroundings()
ALL = Limits(1.1, 2.2, 1.7, 3.1, 1.3, 2.9, 0.45)
"""Every bound there is, and no two alike."""

coordinates = lengths


@given(coordinates, coordinates, coordinates, coordinates, st.floats(0.01, 4.0), st.booleans())
def test_a_wall_is_looked_at_exactly_where_it_is_within_reach(ax, ay, bx, by, far, dot):
    bx, by = (ax, ay) if dot else (bx, by)
    for x, y in ((0.0, 0.0), (0.7, -1.1)):
        line = shapely.MultiPoint([(ax, ay), (bx, by)]).convex_hull  # a point where they are one
        away = shapely.distance(line, shapely.Point(x, y))
        assume(abs(away - far) > 1e-9)
        assert _near(Pose(x, y, 2.0), ax, ay, bx, by, far) == (away < far)
        assert approaching._within(ax - x, ay - y, bx - x, by - y, far) == (away < far)


@given(twists(ALL), st.floats(0.0, 1.0))
@example(Twist(0.0, 2.2250738585e-313), 0.5)  # braking takes 1e-314 of a step
def test_a_manoeuvre_has_gone_as_far_as_its_steps_add_up_to(twist, share):
    """The hold at full speed, then step k at 1 - k / n of it."""
    m = manoeuvre(HERE, twist, ALL, DT, 0.5)
    n = brake_steps(twist, ALL, DT)
    t = share * (m.stop + DT)
    parts = [1.0] + [max(1.0 - k / n, 0.0) for k in range(1, math.ceil(n) + 2)] if n > 0 else [1.0]
    gone = sum(p * min(max(t - k * DT, 0.0), DT) for k, p in enumerate(parts))
    assert _travelled(m, t) == pytest.approx(gone if n > 0 else min(t, DT), abs=1e-12)
    assert m.length == pytest.approx(DT * sum(parts), abs=1e-12)
    assert m.stop == pytest.approx(DT * (1 + math.ceil(n)))
    assert m.max_speed == pytest.approx(abs(twist.v) + 0.5 * abs(twist.omega))


@given(limits(), st.data())
def test_braking_takes_as_many_steps_as_the_tightest_limit_asks(lim, data):
    twist = data.draw(twists(lim))
    rim = abs(twist.v) + lim.track / 2 * abs(twist.omega)
    least = max(
        abs(twist.v) / lim.acceleration, abs(twist.omega) / lim.yaw_acceleration,
        rim / lim.wheel_acceleration,
    ) / DT  # fmt: skip
    n = brake_steps(twist, lim, DT)
    assert n >= least
    assert n == pytest.approx(least, rel=1e-11)
    steps = range(1, math.ceil(n))
    assert coasting(twist, lim, DT) == pytest.approx(DT * sum(1 - k / n for k in steps), abs=1e-12)


def bounds_of(before: Twist, lim: Limits) -> np.ndarray:
    rows = np.full((8, 4), math.nan)
    return rows[: wheel_rows(rows, before, lim, DT)]


def test_without_limits_the_command_has_no_bound():
    assert len(bounds_of(Twist(0.3, -0.2), unlimited(0.5))) == 0
    assert len(bounds_of(Twist(0.3, -0.2), unlimited(0.5)._replace(speed=1.0))) == 2
    got = guard_step(HERE, REST, Twist(7.0, -9.0), EMPTY, SALLY, unlimited(0.5))
    assert (*got.twist, got.verdict, got.limiting) == (7.0, -9.0, UNTOUCHED, NOTHING)


@given(twists(ALL))
def test_the_wheels_bounds_are_those_of_speed_and_of_one_steps_change(before):
    rows = bounds_of(before, ALL)
    assert (rows[:, 3] == NO_OBSTACLE).all()
    half = ALL.track / 2
    wanted = []
    for a, b, most, change in (
        (1.0, 0.0, ALL.speed, ALL.acceleration), (0.0, 1.0, ALL.yaw_rate, ALL.yaw_acceleration),
        (1.0, -half, ALL.wheel_speed, ALL.wheel_acceleration),
        (1.0, half, ALL.wheel_speed, ALL.wheel_acceleration),
    ):  # fmt: skip
        now = a * before.v + b * before.omega
        wanted.append((a, b, max(-most, now - change * DT)))
        wanted.append((-a, -b, -min(most, now + change * DT)))
    assert rows[:, :3] == pytest.approx(np.array(wanted), abs=1e-12)


@given(outlines())
def test_the_farthest_corner_is_the_farthest(outline):
    assert circumscribed_radius(outline) == pytest.approx(np.hypot(*outline.T).max())


@given(twists(ALL), st.floats(0.0, 1.0))
def test_no_point_of_the_outline_can_be_faster_than_the_fastest(before, reach):
    body = ALL._replace(wheel_speed=math.inf, wheel_acceleration=math.inf)
    v = min(abs(before.v) + ALL.acceleration * DT, ALL.speed)
    omega = min(abs(before.omega) + ALL.yaw_acceleration * DT, ALL.yaw_rate)
    fast = approaching._outline_speed(before, body, reach, DT)
    assert fast == pytest.approx(v + reach * omega)
    wheels = unlimited(0.45)._replace(wheel_speed=1.3, wheel_acceleration=2.9)
    v = min(abs(before.v) + 2.9 * DT, 1.3)
    omega = abs(before.omega) + 2 * 2.9 / 0.45 * DT
    fast = approaching._outline_speed(before, wheels, reach, DT)
    assert fast == pytest.approx(v + reach * omega)
    assert approaching._outline_speed(before, unlimited(0.45), 0.0, DT) == math.inf


@given(st.floats(0.0, 3.0), st.floats(0.5, 20.0), st.floats(0.0, 0.1))
def test_from_far_off_even_the_fastest_may_come_straight_on(speed, a, margin):
    far = approaching._far(speed, a, DT, margin)
    assert approach(far - margin, a, DT) == pytest.approx(speed, abs=1e-9)
    assert approaching._far(speed, math.inf, DT, margin) == pytest.approx(margin + speed * DT)


def rows_of(pose: Pose, before: Twist, around: Surroundings, outline: np.ndarray) -> np.ndarray:
    rows = np.full((max_rows(around, outline) + 2, 4), math.nan)
    reach = circumscribed_radius(outline)
    n, least = approach_rows(rows, 2, pose, before, around, outline, reach, ALL, DT, 0.03, 0.7)
    near = clearances(outline, pose, around)
    if n > 2 and near.min() > 0.0:
        assert least >= near.min() - 1e-9
    assert np.isnan(rows[:2]).all()
    return rows[2:n]


@given(outlines(), coordinates, coordinates, angles, twists(ALL), angles)
def test_a_bound_is_the_closing_speed_of_the_clearance(outline, x, y, psi, requested, course):
    """By differences, at a pose, for a moving disc and a point."""
    pose, tick = Pose(0.3, -0.2, psi), 1e-6
    vx, vy = 0.8 * math.cos(course), 0.8 * math.sin(course)
    after = moved(pose, requested, tick)
    a = 0.7 * min(ALL.acceleration, ALL.wheel_acceleration)
    for now, toward in (
        (surroundings([disc(x, y, 0.1, 0.2, vx, vy)]), (vx, vy)),
        (surroundings(points=[[x, y]]), (0.0, 0.0)),
    ):
        near = clearances(outline, pose, now)[0]
        assume(1e-3 < near < 1.0)
        rows = rows_of(pose, REST, now, outline)
        if not len(rows):
            continue
        rate = (clearances(outline, after, now)[0] - near) / tick
        (row,) = rows
        assert row[0] * requested.v + row[1] * requested.omega == pytest.approx(rate, abs=1e-3)
        drift = Pose(pose.x - tick * toward[0], pose.y - tick * toward[1], psi)
        closing = -(clearances(outline, drift, now)[0] - near) / tick
        bound = min(closing - approach(near - 0.03, a, DT), 0.0)
        assert row[2] == pytest.approx(bound, abs=1e-3)
        assert row[3] == 0


@given(outlines(), still_things(), twists(ALL))
def test_obstacles_left_out_of_the_rows_are_out_of_reach(outline, around, before):
    """Nothing is left out that the robot could close in on too fast in the next step."""
    assume(len(around.discs) + len(around.segments) + len(around.points))
    rows = rows_of(HERE, before, around, outline)
    near = clearances(outline, HERE, around)
    assume((near > 1e-6).all())
    left_out = sorted(set(range(len(near))) - set(rows[:, 3].astype(int)))
    body = ALL
    fast = approaching._outline_speed(before, body, circumscribed_radius(outline), DT)
    a = 0.7 * min(ALL.acceleration, ALL.wheel_acceleration)
    for i in left_out:
        assert approach(near[i] - 0.03, a, DT) >= fast - 1e-9


@pytest.mark.parametrize("vx", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("vy", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("most", [0.0, 0.5])
@pytest.mark.parametrize("error", [0.0, 0.5])
def test_only_what_stands_and_can_not_set_off_is_static(vx, vy, most, error):
    now = surroundings([disc(2.0, 0.0, 0.1, 0.2, vx, vy)], [most], velocity_error=[error])
    assert is_static(now, 0) == (vx == vy == most == error == 0.0)


@pytest.mark.parametrize("vx", [-1.2, -0.5, 0.0, 0.5])
@pytest.mark.parametrize("vy", [-1.2, -0.5, 0.0, 0.5])
@pytest.mark.parametrize("error", [0.0, 0.5, 1.0])
def test_a_mover_left_out_of_the_rows_is_out_of_reach_whichever_way_it_goes(vx, vy, error):
    """Along the axes and the diagonals, exactly, too."""
    fast = approaching._outline_speed(REST, ALL, circumscribed_radius(SALLY), DT)
    a, left_out = 0.7 * min(ALL.acceleration, ALL.wheel_acceleration), 0
    for away in np.linspace(0.6, 6.0, 200):
        now = surroundings([disc(away, 0.0, 0.1, 0.2, vx, vy)], velocity_error=[error])
        if len(rows_of(HERE, REST, now, SALLY)):
            continue
        left_out += 1
        near = clearances(SALLY, HERE, now)[0]
        assert approach(near - 0.03, a, DT) >= fast + math.hypot(vx, vy) + error - 1e-9
    assert left_out


@given(outlines(), still_things())
def test_there_is_room_for_every_bound_and_for_no_more(outline, around):
    most = len(around.discs) + len(around.points) + len(around.segments) * (2 + len(outline))
    assert max_rows(around, outline) == most


NUMBERS = {
    "pose": lambda bad: (Pose(0.0, bad, 0.0), REST, REST, EMPTY),
    "wish": lambda bad: (HERE, REST, Twist(0.0, bad), EMPTY),
    "twist": lambda bad: (HERE, Twist(0.0, bad), REST, EMPTY),
    "disc": lambda bad: (HERE, REST, REST, surroundings([disc(bad, 1.0, 0.1)])),
    "velocity": lambda bad: (HERE, REST, REST, surroundings([disc(2, 1, 0.1, 0.2, 0.0, bad)])),
    "radius": lambda bad: (HERE, REST, REST, surroundings([disc(2.0, 1.0, bad)])),
    "max_acceleration": lambda bad: (HERE, REST, REST, surroundings([disc(2.0, 1.0, 0.1)], [bad])),
    "velocity_error": lambda bad: (
        HERE,
        REST,
        REST,
        surroundings([disc(2.0, 1.0, 0.1)], velocity_error=[bad]),
    ),
    "wall's x": lambda bad: (HERE, REST, REST, surroundings(segments=[[bad, 1.0, 2.0, 2.0]])),
    "wall's y": lambda bad: (HERE, REST, REST, surroundings(segments=[[1.0, bad, 2.0, 2.0]])),
    "wall's end": lambda bad: (HERE, REST, REST, surroundings(segments=[[1.0, 2.0, bad, 2.0]])),
    "wall's end's y": lambda bad: (HERE, REST, REST, surroundings(segments=[[1.0, 2.0, 2.0, bad]])),
}


@pytest.mark.parametrize("what", NUMBERS)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_an_invalid_step_is_a_stop_and_claims_nothing(what, bad):
    got = guard_step(*NUMBERS[what](bad), SALLY, SALLY_LIMITS)
    assert got == (REST, INVALID, 0.0, math.inf, NOTHING)


def test_an_absurd_nominal_command_is_clipped_to_a_billion():
    got = guard_step(HERE, REST, Twist(1e300, -1e300), EMPTY, SALLY, unlimited(0.5))
    assert got.twist == (1e9, -1e9)


@given(lengths, lengths, st.floats(0.05, 2.0))
def test_the_reported_clearance_is_the_smallest_of_all_with_bounds(x, y, far):
    near = [disc(0.36 + 0.01 + 0.1, 0.0, 0.1), disc(-0.36 - far - 0.1, 0.0, 0.1)]
    for rows in (near, near[::-1]):
        got = guard_step(HERE, REST, REST, surroundings(rows), SALLY, SALLY_LIMITS)
        assert got.clearance == pytest.approx(0.01)
    walls = [[0.37, -1.0, 0.37, 1.0], [-0.36 - far, -1.0, -0.36 - far, 1.0]]
    points = [[0.37, 0.1], [-0.36 - far, 0.1]]
    for side in (slice(None), slice(None, None, -1)):
        got = guard_step(HERE, REST, REST, surroundings(segments=walls[side]), SALLY, SALLY_LIMITS)
        assert got.clearance == pytest.approx(0.01)
        got = guard_step(HERE, REST, REST, surroundings(points=points[side]), SALLY, SALLY_LIMITS)
        assert got.clearance == pytest.approx(0.01)
