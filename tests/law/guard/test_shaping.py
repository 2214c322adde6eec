"""What the bounds do before the certificate has a say: how things are approached, and named."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Pose, Twist, disc
from cohelm.law.guard.approach import approach
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.step import guard
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.verdict import BRAKING, INVALID, SHAPED, STANDING, UNTOUCHED
from cohelm.robot.achievable import achievable
from cohelm.robot.limits import Limits
from tests.law.guard.scenes import (
    HERE,
    REST,
    RULES,
    SALLY,
    SALLY_LIMITS,
    angles,
    beyond,
    clearances,
    guard_step,
    lengths,
    limits,
    moved,
    outlines,
    still_things,
    twists,
    wishes,
)
from tests.law.guard.test_project import least_change

EMPTY = surroundings()
BRISK = Limits(1.5, 8.0, 3.0, 20.0, math.inf, math.inf, 0.4)
SLOW_CLOCK = Rules(dt=0.1)


@given(st.floats(1e-6, 3.0), st.floats(0.5, 20.0), st.floats(0.005, 0.2))
def test_the_approach_speed_is_what_one_step_and_the_braking_after_it_use_up(h, a, dt):
    speed = approach(h, a, dt)
    assert speed * dt + speed * speed / (2.0 * a) == pytest.approx(h)
    assert approach(h, math.inf, dt) == h / dt
    assert approach(-h, a, dt) == 0.0


@given(outlines(), still_things(), wishes)
def test_nothing_is_approached_faster_than_the_robot_can_stop(outline, around, nominal):
    """Found from the gaps alone: where they are a tenth of a millisecond later."""
    around = beyond(outline, around, 1e-3)
    near = clearances(outline, HERE, around)
    got = guard_step(HERE, Twist(0.0, 0.0), nominal, around, outline, BRISK, SLOW_CLOCK)
    after = clearances(outline, moved(HERE, got.twist, 1e-4), around)
    most = [approach(clearance - 0.03, 0.7 * 8.0, 0.1) for clearance in near]
    assert (after >= near - 1e-4 * np.array(most) - 1e-6).all()


@given(st.floats(0.031, 0.7), angles, wishes)
def test_an_obstacle_right_beside_is_approached_as_fast_as_allowed_and_no_faster(
    clearance, turn, nominal
):
    """A wall square to the bow, and the robot straight at it: the approach law to the digit."""
    wall = surroundings(segments=[[0.36 + clearance, -0.2, 0.36 + clearance, 0.2]])
    got = guard_step(HERE, Twist(0.0, 0.0), Twist(5.0, 0.0), wall, SALLY, BRISK, SLOW_CLOCK)
    assert got.twist.v == pytest.approx(min(approach(clearance - 0.03, 0.7 * 8.0, 0.1), 0.8))


@given(st.floats(0.2, 1.2), st.floats(0.0, 1.0))
def test_a_moving_disc_is_approached_with_its_own_speed_taken_off(clearance, speed):
    """It comes at `speed`, or leaves; what comes faster than allowed is not fled from."""
    for sign in (1.0, -1.0):
        oncoming = surroundings([disc(0.36 + clearance + 0.1, 0.0, 0.1, 0.2, -sign * speed, 0.0)])
        got = guard_step(HERE, Twist(0.0, 0.0), Twist(5.0, 0.0), oncoming, SALLY, BRISK, SLOW_CLOCK)
        allowed = max(approach(clearance - 0.03, 0.7 * 8.0, 0.1) - sign * speed, 0.0)
        assert -1e-9 <= got.twist.v <= min(allowed, 0.8) + 1e-9
        if speed == 0.0:
            assert got.twist.v == pytest.approx(min(allowed, 0.8))


@given(limits(), wishes, wishes)
def test_with_nothing_near_it_is_the_least_change_that_the_wheels_can_do(lim, was, nominal):
    before = achievable(was, Twist(0.0, 0.0), lim, 1e6)
    got = guard_step(HERE, before, nominal, EMPTY, SALLY, lim)
    half, dt = lim.track / 2, RULES.dt
    rows = []
    for a, b, most, change in (
        (1.0, 0.0, lim.speed, lim.acceleration), (0.0, 1.0, lim.yaw_rate, lim.yaw_acceleration),
        (1.0, -half, lim.wheel_speed, lim.wheel_acceleration),
        (1.0, half, lim.wheel_speed, lim.wheel_acceleration),
    ):  # fmt: skip
        now = a * before.v + b * before.omega
        for sign in (1.0, -1.0):
            low = max(-most, sign * now - change * dt)
            if low > -math.inf:
                rows.append((sign * a, sign * b, low, -1.0))
    best = least_change(nominal, np.array(rows), RULES.steer_weight, 1e-9)
    assert got.change == pytest.approx(best, abs=1e-6)


def turned(around: Surroundings, pose: Pose) -> Surroundings:
    """The same things for a robot at `pose` as `around` is for one at the origin."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    back = np.array([[c, s], [-s, c]])

    def there(xy):
        return xy @ back + [pose.x, pose.y]

    d = around.discs.copy()
    d[:, :2], d[:, 2:4] = there(d[:, :2]), d[:, 2:4] @ back
    walls = there(around.segments.reshape(-1, 2)).reshape(-1, 4)
    return surroundings(d, around.max_acceleration, walls, there(around.points))


@given(outlines(), limits(), still_things(), lengths, lengths, angles, angles, st.data())
def test_where_the_origin_of_the_world_is_makes_no_difference(
    outline, lim, around, x, y, psi, course, data
):
    assume((np.abs(clearances(outline, HERE, around) - 0.015) > 1e-6).all())
    before, nominal = data.draw(twists(lim)), data.draw(wishes)
    around.discs[::2, 2:4] = 0.7 * math.cos(course), 0.7 * math.sin(course)
    here = guard_step(HERE, before, nominal, around, outline, lim)
    pose = Pose(x, y, psi)
    there = guard_step(pose, before, nominal, turned(around, pose), outline, lim)
    assert there.twist == pytest.approx(here.twist, abs=1e-7)
    assert (there.verdict, there.limiting) == (here.verdict, here.limiting)
    if (
        here.clearance < RULES.soft_margin
    ):  # a far one may or may not be looked at, by the last digit
        assert there.clearance == pytest.approx(here.clearance, abs=1e-9)


FAR_DISC, FAR_WALL, FAR_POINT = disc(9.0, 9.0, 0.1), [9.0, -9.0, 8.0, -9.0], [-9.0, 9.0]
AHEAD = {
    1: surroundings([FAR_DISC, disc(0.49, 0.0, 0.1)], None, [FAR_WALL], [FAR_POINT]),
    2: surroundings([FAR_DISC], None, [FAR_WALL, [0.39, -1.0, 0.39, 1.0]], [FAR_POINT]),
    4: surroundings([FAR_DISC, FAR_DISC], None, [FAR_WALL], [FAR_POINT, [0.39, 0.0]]),
}


@pytest.mark.parametrize("limiting", AHEAD)
def test_the_limiting_obstacle_is_numbered_through_discs_walls_and_points(limiting):
    """The shaping names it; and the certificate does where the shaping is blind (margin 0)."""
    around = AHEAD[limiting]
    shaped = guard_step(HERE, Twist(0.0, 0.0), Twist(1.0, 0.0), around, SALLY, SALLY_LIMITS)
    assert (shaped.verdict, shaped.limiting) == (SHAPED, limiting)
    fast = guard_step(HERE, Twist(0.9, 0.0), Twist(1.0, 0.0), around, SALLY, SALLY_LIMITS)
    assert (fast.verdict, fast.limiting) == (BRAKING, limiting)
    assert fast.twist.v == pytest.approx(0.86)
    blind = Rules(soft_margin=-1.0)
    for speed, verdict, left in ((0.3, SHAPED, 0.27), (0.5, BRAKING, 0.46)):  # a quarter; none
        was = Twist(speed, 0.0)
        got = guard_step(HERE, was, was, around, SALLY, SALLY_LIMITS, blind)
        assert (got.twist.v, got.verdict, got.limiting) == (pytest.approx(left), verdict, limiting)


def test_standing_is_distinguished_from_braking():
    """Somebody upon the robot lets it only stand; spinning, it first has to stop."""
    upon = surroundings([disc(0.367, 0.0, 0.0)], [1.0])
    still = guard_step(HERE, Twist(0.0, 0.0), Twist(-1.0, 0.0), upon, SALLY, SALLY_LIMITS)
    assert (*still.twist, still.verdict) == (0.0, 0.0, STANDING)
    spinning = guard_step(HERE, Twist(0.0, 1.0), Twist(-1.0, 0.0), upon, SALLY, SALLY_LIMITS)
    assert spinning.verdict == BRAKING
    assert spinning.twist == (0.0, pytest.approx(0.84))
    rolling = guard_step(HERE, Twist(0.5, 0.0), Twist(-1.0, 0.0), upon, SALLY, SALLY_LIMITS)
    assert rolling.verdict == BRAKING


@pytest.mark.parametrize(
    "far",
    [
        surroundings([disc(9.0, 0.0, 0.2)]),
        surroundings([disc(9.0, 0.0, 0.2)], [1.0]),
        surroundings([[9.0, 0.0, -0.5, 0.0, 0.2, 0.4]]),
        surroundings(segments=[[9.0, -3.0, 9.0, 3.0]]),
        surroundings(points=[[9.0, 0.0]]),
    ],
)
def test_with_nothing_near_the_clearance_is_infinite_and_the_command_passes(far):
    got = guard_step(HERE, Twist(0.5, 0.0), Twist(0.52, 0.0), far, SALLY, SALLY_LIMITS)
    assert (*got.twist, got.clearance, got.change) == (0.52, 0.0, math.inf, 0.0)


def crossing(x: float) -> Surroundings:
    """Somebody who walks across, ahead of the robot."""
    return surroundings([disc(x, -0.5, 0.25, 0.3, -1.0, 1.5)], [1.0])


def test_a_motion_that_was_planned_is_not_slowed_down_while_it_can_still_stop():
    args = HERE, Twist(0.8, 0.0), Twist(0.8, 0.0), crossing(1.6)
    assert guard_step(*args, SALLY, SALLY_LIMITS).twist.v < 0.8
    got = guard(*args, SALLY, SALLY_LIMITS, RULES, True)
    assert (*got.twist, got.verdict) == (0.8, 0.0, UNTOUCHED)


def test_a_planned_motion_that_can_not_be_certified_is_shaped_as_any_other():
    args = HERE, Twist(0.8, 0.0), Twist(0.8, 0.0), crossing(0.9)
    plain = guard_step(*args, SALLY, SALLY_LIMITS)
    assert plain.twist.v < 0.8
    assert guard(*args, SALLY, SALLY_LIMITS, RULES, True) == plain


def test_nothing_is_planned_beside_a_disc_that_is_not_a_number():
    bad = surroundings([disc(2.0, 0.0, 0.25, 0.3, 0.0, 0.0)])
    bad.discs[0, 4] = math.nan
    got = guard(HERE, REST, Twist(0.5, 0.0), bad, SALLY, SALLY_LIMITS, RULES, True)
    assert (*got.twist, got.verdict) == (0.0, 0.0, INVALID)
