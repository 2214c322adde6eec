"""Force feedback is bounded, damped and fades with age."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import CENTRED, Stick, Twist
from cohelm.link.sticks.feel import (
    FRESH,
    GONE,
    STEEPEST,
    STRONGEST,
    damped,
    faded,
    returning,
    shake,
    spring,
    wanted,
)  # fmt: skip
from cohelm.link.sticks.port import Feel

any_speed = st.floats(allow_nan=True, allow_infinity=True)
twists = st.builds(Twist, any_speed, any_speed)
shares = st.floats(-0.4, 0.4)
pushes = st.builds(Stick, shares, shares)


def test_the_spring_follows_the_paper_up_to_the_force_of_the_device():
    assert spring(5.0) == 0.5
    assert spring(20.0) == 1.0
    assert spring(0.0) == 0.0


@given(twists, twists)
def test_the_cue_never_takes_more_than_its_share_of_the_force(asked, given):
    push = wanted(asked, given, 1.0, 1.0)
    assert max(map(abs, push)) <= STRONGEST


def test_the_cue_points_to_the_applied_command_and_is_zero_where_that_is_requested():
    held = wanted(Twist(0.5, 0.0), Twist(0.2, 0.3), 1.0, 1.0)
    assert held.x < 0.0 < held.psi
    assert wanted(Twist(0.5, 0.2), Twist(0.5, 0.2), 1.0, 1.0) == CENTRED


@given(pushes, st.lists(st.floats(0.0, 1.0), min_size=2, max_size=9))
def test_the_cue_fades_with_the_age_of_the_status(push, ages):
    felt = [abs(faded(push, age).x) for age in sorted(ages)]
    assert felt == sorted(felt, reverse=True)
    assert faded(push, FRESH) == pytest.approx(push)
    for age in (GONE, 10.0, math.nan, math.inf):
        assert faded(push, age) == CENTRED


@given(pushes, pushes, st.floats(0.0, 0.1))
def test_the_cue_changes_at_a_bounded_rate_without_overshoot(before, push, dt):
    after = damped(before, push, dt)
    assert abs(after.x - before.x) <= STEEPEST * dt + 1e-12
    assert min(before.x, push.x) - 1e-12 <= after.x <= max(before.x, push.x) + 1e-12


@given(st.builds(Stick, shares, shares), st.builds(Stick, shares, shares), st.floats(0.0, 1.0))
def test_no_cue_holds_a_released_stick_deflected(push, stick, stiffness):
    cue = returning(push, stick, stiffness)
    force = Stick(cue.x - stiffness * stick.x, cue.psi - stiffness * stick.psi)
    out = math.hypot(*stick)
    assert force.x * stick.x + force.psi * stick.psi <= -0.5 * stiffness * out**2 + 1e-9
    assert math.hypot(*cue) <= math.hypot(*push) + 1e-9
    assert math.hypot(*cue) <= 2.1 * stiffness * out + 1e-9  # none at the centre, and no jump there


def test_the_full_cue_acts_against_a_hand():
    assert returning(Stick(-0.4, 0.0), Stick(0.5, 0.0), 0.5) == pytest.approx((-0.4, 0.0))


@pytest.mark.parametrize("delay", [0, 5, 10, 20, 30])
def test_near_a_wall_the_cue_does_not_make_a_released_stick_oscillate(delay):
    """Stick, spring and cue with the delay of a round trip (in steps of 10 ms): it comes to rest.

    The stick is a mass on the device's spring; the guard takes away all speed above a half.
    """
    dt, mass, friction, stiffness = 0.01, 0.05, 0.6, 1.0
    x, v, push = 1.0, 0.0, CENTRED
    sent, seen = [x] * (delay + 1), []
    for _ in range(2000):
        asked = Twist(max(0.0, sent[-1 - delay]), 0.0)
        given = Twist(min(asked.v, 0.5), 0.0)
        cue = faded(wanted(asked, given, 1.0, 1.0), delay * dt)
        push = damped(push, cue, dt)
        force = 0.3 + push.x - stiffness * x - friction * v  # 0.3: the weight of a tired hand
        v += force / mass * dt
        x += v * dt
        sent.append(x)
        seen.append(x)
    end = seen[-500:]
    assert max(end) - min(end) < 0.01


def test_without_force_feedback_the_rumble_is_as_strong_as_the_cue():
    assert shake(Feel(1.0, CENTRED)) == 0.0
    assert shake(Feel(0.0, Stick(-0.3, 0.4))) == pytest.approx(0.5)
