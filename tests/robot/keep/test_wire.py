"""What loop and gate process tell each other in every period comes out as it went in."""

import math
import pickle

from hypothesis import given, strategies as st

from cohelm.core.types import Pose, Twist
from cohelm.robot.gate.gate import Gate, Passed, Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.wire import (
    gate_of,
    packed_gate,
    packed_passed,
    packed_proposal,
    packed_readings,
    passed_of,
    proposal_of,
    readings_of,
)
from cohelm.robot.port import Contact, Health, Odometry, Readings

NUMBERS = st.floats(allow_nan=False)
TWISTS = st.builds(Twist, NUMBERS, NUMBERS)
WHOLE = st.integers(-1, 10**9)
READINGS = st.builds(
    Readings,
    odometry=st.none()
    | st.builds(Odometry, NUMBERS, st.builds(Pose, NUMBERS, NUMBERS, NUMBERS), TWISTS),
    health=st.none()
    | st.builds(Health, NUMBERS, NUMBERS, st.lists(st.text(), max_size=2).map(tuple)),
    scan=st.none(), frame=st.none(), further=st.just(()), outline=st.none(),
    contacts=st.lists(st.builds(Contact, NUMBERS, st.text(), st.booleans()), max_size=2).map(tuple),
)  # fmt: skip
GATES = st.builds(
    Gate,
    st.sampled_from(list(GateMode)),
    st.text(),
    TWISTS,
    NUMBERS,
    NUMBERS,
    WHOLE,
    NUMBERS,
    WHOLE,
)


def same(what, packed, unpacked):
    there = unpacked(pickle.loads(pickle.dumps(packed(what))))
    assert there == what
    assert repr(there) == repr(what)  # of the same types, all through


@given(GATES, st.builds(Proposal, WHOLE, NUMBERS, TWISTS), st.builds(Passed, TWISTS, st.text()))
def test_gate_proposal_and_answer_come_as_they_were(gate, proposal, passed):
    same(gate, packed_gate, gate_of)
    same(proposal, packed_proposal, proposal_of)
    same(passed, packed_passed, passed_of)


@given(READINGS)
def test_readings_come_as_they_were(readings):
    same(readings, packed_readings, readings_of)


def test_nan_stays_nan():
    told = packed_proposal(Proposal(1, math.nan, Twist(math.nan, math.inf)))
    proposal = proposal_of(pickle.loads(pickle.dumps(told)))
    assert math.isnan(proposal.stamp)
    assert math.isnan(proposal.twist.v)
    assert proposal.twist.omega == math.inf
