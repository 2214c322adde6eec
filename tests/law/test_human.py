import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Desired, Pose, Stick, Twist, discs
from cohelm.law.gains import Gains
from cohelm.law.human import Authority, authority, blend, human, intent, limited, supplied_energy
from cohelm.law.step import step
from tests.law import states

PAPER = Gains()
BAND = PAPER.dead_band
inside = st.one_of(st.floats(-BAND, BAND), st.sampled_from([-BAND, BAND, 0.0]))
outside = st.one_of(
    st.floats(math.nextafter(BAND, 1.0), 1.0), st.floats(-1.0, math.nextafter(-BAND, -1.0))
)
EMPTY = discs()


@given(inside, inside)
def test_inside_the_dead_band_there_is_no_command_and_no_intent(x, psi):
    hand = limited(Stick(x, psi), PAPER)
    assert human(hand, PAPER) == (0.0, 0.0)
    assert intent(hand, PAPER) == (0.0, 0.0)
    assert authority(intent(hand, PAPER), PAPER) == (1.0, 1.0)


@given(outside, inside)
def test_fore_aft_alone_commands_speed_in_proportion(x, psi):
    assert human(limited(Stick(x, psi), PAPER), PAPER) == (PAPER.k_hx * x * PAPER.u_d, 0.0)


@given(inside, outside)
def test_left_right_alone_also_commands_forward_speed(x, psi):
    v, omega = human(limited(Stick(x, psi), PAPER), PAPER)
    assert (v, omega) == (PAPER.k_hx * PAPER.u_d, PAPER.k_hpsi * psi)


@given(outside, outside)
def test_with_both_axes_out_the_speed_is_the_fore_aft_axis(x, psi):
    """E8: (45) has no case for it."""
    v, omega = human(limited(Stick(x, psi), PAPER), PAPER)
    assert (v, omega) == (PAPER.k_hx * x * PAPER.u_d, PAPER.k_hpsi * psi)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_a_deflection_beyond_the_stop_counts_as_the_stop(x, psi):
    clipped = Stick(float(np.clip(x, -1, 1)), float(np.clip(psi, -1, 1)))
    assert limited(Stick(x, psi), PAPER) == limited(clipped, PAPER)


@given(states.gains(), st.data())
def test_authority_is_a_share_and_falls_as_the_stick_goes_out(gains, data):
    near = data.draw(states.sticks(gains.dead_band))
    grow = data.draw(st.floats(1.0, 10.0))
    far = Stick(near.x * grow, near.psi * grow)
    shares = [authority(intent(limited(s, gains), gains), gains) for s in (near, far)]
    for before, after in zip(*shares, strict=True):
        assert 0.0 < after <= before <= 1.0


@given(states.sticks())
def test_joint_authority_is_one_share_and_the_product_of_the_two_axes(stick):
    v = intent(limited(stick, PAPER), PAPER)
    joint = authority(v, PAPER)
    each = authority(v, PAPER._replace(joint=False))
    assert joint.x == joint.psi == pytest.approx(each.x * each.psi, rel=1e-14)


@given(st.floats(0.06, 1.0))
def test_per_axis_authority_leaves_the_other_axis_to_the_controller(x):
    share = authority(intent(Stick(x, 0.0), PAPER), PAPER._replace(joint=False))
    assert share.x < 1.0
    assert share.psi == 1.0


unit = st.floats(0.0, 1.0)


@given(states.twists, states.twists, st.builds(Authority, unit, unit))
def test_each_axis_of_the_blend_lies_between_the_two_commands(automatic, person, share):
    for one, other, between in zip(automatic, person, blend(automatic, person, share), strict=True):
        slack = 1e-15 * (abs(one) + abs(other))
        assert min(one, other) - slack <= between <= max(one, other) + slack


@given(states.twists, st.builds(Authority, unit, unit))
def test_the_shares_add_up_to_one(nominal, share):
    assert blend(nominal, nominal, share) == pytest.approx(nominal, rel=1e-14, abs=1e-15)


@given(states.twists, states.twists)
def test_full_authority_on_either_side_is_that_sides_command(automatic, person):
    alone = blend(automatic, person, Authority(1.0, 1.0))
    assert alone == pytest.approx(automatic, rel=1e-15, abs=1e-15)
    alone = blend(automatic, person, Authority(0.0, 0.0))
    assert alone == pytest.approx(person, rel=1e-15, abs=1e-15)


@given(states.poses, states.desireds, states.gains(barrier=False), st.data())
def test_the_shared_command_never_leaves_the_two_commands(pose, desired, gains, data):
    s = step(pose, desired, data.draw(states.sticks(gains.dead_band)), EMPTY, gains)
    for a, b, shared in (
        (s.tracking_v, s.operator_v, s.nominal_v),
        (s.tracking_omega, s.operator_omega, s.nominal_omega),
    ):
        slack = 1e-14 * (abs(a) + abs(b))
        assert min(a, b) - slack <= shared <= max(a, b) + slack
    assert (s.safe_v, s.safe_omega) == (s.nominal_v, s.nominal_omega)


def supplied(path):
    energy = 0.0
    for before, now in pairwise(path):
        energy = supplied_energy(energy, before, now, PAPER)
    return energy


unlimited_sticks = st.builds(Stick, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@given(st.lists(unlimited_sticks, max_size=60))
def test_moved_from_rest_the_energy_supplied_is_the_intent_and_never_negative(path):
    """(40)–(42): along any path of an ideal spring the integral is V_h at its end."""
    energy = supplied([Stick(0.0, 0.0), *path])
    end = path[-1] if path else Stick(0.0, 0.0)
    assert energy == pytest.approx(sum(intent(end, PAPER)), abs=1e-12)
    assert energy >= -1e-12


@given(st.floats(0.1, 1.0), st.floats(-1.0, 1.0))
def test_a_stick_released_gives_back_what_was_put_in(x, psi):
    """A record that starts deflected shows it: the observable goes below 0 by V_h (40)."""
    start = Stick(x, psi)
    assert supplied([start, Stick(0.0, 0.0)]) == pytest.approx(-sum(intent(start, PAPER)))
    assert supplied([Stick(0.0, 0.0), start, Stick(0.0, 0.0)]) == pytest.approx(0.0, abs=1e-15)


def test_a_stick_at_rest_leaves_the_controller_alone():
    desired = Desired(0.2, 0.1, 0.2, 0.5, 0.1)
    s = step(Pose(0.0, 0.0, 0.0), desired, Stick(0.0, 0.0), EMPTY)
    assert Twist(s.safe_v, s.safe_omega) == Twist(s.tracking_v, s.tracking_omega)
