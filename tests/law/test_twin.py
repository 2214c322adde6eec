"""The compiled law against its slow twin, written from the paper and not from the code."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.types import Twist
from cohelm.law.step import step
from cohelm.law.track import pose_error, track
from cohelm.law.verdict import SHAPED, UNTOUCHED
from tests.law import states
from tests.oracle import paper

CLOSE = 1e-9


@given(st.data())
def test_every_number_of_a_control_step_is_the_papers(data):
    pose, desired = data.draw(states.poses), data.draw(states.desireds)
    gains = data.draw(states.gains())
    stick = data.draw(states.sticks(gains.dead_band))
    discs = data.draw(states.scenes(pose))
    rows, parameters = states.as_rows(discs), states.as_parameters(gains)
    eta, goal = states.eta(pose), states.as_goal(desired)
    reported = paper.step(eta, goal, gains.u_d, np.array(stick), rows, parameters)
    slope = paper.L_gB(eta, rows)
    # I = J is a jump of (33) and L_gB = 0 its pole: on either, rounding decides.
    size = float(np.abs(slope) @ np.abs(reported.tau)) + abs(reported.I) + abs(reported.J)
    assume(abs(reported.I - reported.J) > 1e-6 * size)
    assume(slope @ slope > 1e-10 or reported.I <= reported.J)

    ours = step(pose, desired, stick, discs, gains)

    same = {"rel": CLOSE, "abs": CLOSE}
    assert (ours.tracking_v, ours.tracking_omega) == pytest.approx(tuple(reported.tau_c), **same)
    assert (ours.operator_v, ours.operator_omega) == pytest.approx(tuple(reported.tau_h), **same)
    assert (ours.authority_x, ours.authority_psi) == pytest.approx(tuple(reported.k_c), **same)
    assert (ours.nominal_v, ours.nominal_omega) == pytest.approx(tuple(reported.tau), **same)
    assert (ours.intent_x, ours.intent_psi) == pytest.approx(
        tuple(paper.intent(np.array(stick), parameters)), **same
    )
    assert (ours.avoid_v, ours.avoid_omega) == pytest.approx(
        tuple(reported.u), rel=CLOSE, abs=CLOSE * (1 + np.abs(reported.u).max())
    )
    assert (ours.safe_v, ours.safe_omega) == pytest.approx(
        tuple(reported.U), rel=CLOSE, abs=CLOSE * (1 + np.abs(reported.u).max())
    )
    if gains.barrier:
        assert ours.verdict == (SHAPED if reported.I > reported.J else UNTOUCHED)
        assert ours.I == pytest.approx(reported.I, rel=CLOSE, abs=CLOSE * (1 + size))
        assert ours.J == pytest.approx(reported.J, **same)
        h = paper.margins(eta, rows).min() if len(rows) else math.inf
        assert ours.h == pytest.approx(h, rel=CLOSE, abs=1e-12)
    else:
        assert ours.verdict == UNTOUCHED


@given(states.poses, states.desireds, states.gains())
def test_the_tracking_law_is_the_papers(pose, desired, gains):
    reported = paper.tracking(
        states.eta(pose), states.as_goal(desired), states.as_parameters(gains)
    )
    assert track(pose, desired, gains) == pytest.approx(Twist(*reported), rel=CLOSE, abs=CLOSE)


@given(states.poses, states.desireds)
def test_the_pose_error_is_the_papers_with_the_heading_wrapped(pose, desired):
    reported = paper.pose_error(states.eta(pose), states.as_goal(desired))
    assert pose_error(pose, desired) == pytest.approx(reported, rel=CLOSE, abs=CLOSE)
