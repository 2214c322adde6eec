"""The gate's promises under any sequence of events whatever, good, bad and mad."""

import math
from itertools import pairwise

from hypothesis import given, strategies as st

from cohelm.core.types import Twist
from cohelm.robot.gate import gate as g
from cohelm.robot.gate.bounds import Bounds
from cohelm.robot.gate.gate import Gate, GateRules, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched

BOUNDS = Bounds(1.0, 4.0, 2.0, 16.0, 1.2, 2.0, 0.5)
RULES = GateRules(BOUNDS)

number = st.one_of(
    st.floats(-1.5, 1.5), st.floats(), st.sampled_from([0.0, math.nan, math.inf, 1e300])
)
age = st.one_of(st.floats(0.0, 0.03), st.floats(-1.0, 1.0), st.just(math.nan))
event = st.one_of(
    st.tuples(st.just("propose"), st.integers(-1, 3), age, number, number),
    st.tuples(st.just("propose"), st.just(1), st.just(0.0), st.floats(-1.5, 1.5), st.floats(-3, 3)),
    st.tuples(st.just("tick")),
    st.tuples(st.just("stop")),
    st.tuples(st.just("fault")),
    st.tuples(st.just("reset")),
    st.tuples(st.just("drive"), st.sampled_from(list(GateMode))),
)
step = st.one_of(st.floats(0.0, 0.03), st.floats(0.0, 0.3), st.sampled_from([0.02, -0.5, math.nan]))
history = st.lists(st.tuples(step, event), max_size=60)


def played(events):
    """(before, after, now, event) of every event in order."""
    gate, now, n = Gate(), 100.0, 0
    for dt, (what, *more) in events:
        at = now + dt
        now = at if math.isfinite(at) else now
        before = gate
        if what == "propose":
            jump, old, v, omega = more
            n += jump
            gate, _ = g.propose(gate, Proposal(n, at - old, Twist(v, omega)), at, RULES)
        elif what == "tick":
            gate, _ = g.tick(gate, at, RULES)
        elif what == "stop":
            gate = g.stop(gate, "stop")
        elif what == "fault":
            gate = g.fault(gate, "fault")
        elif what == "reset":
            gate, _ = g.reset(gate, now, RULES)
        else:
            gate, _ = g.drive(gate, more[0], now, RULES)
        yield before, gate, at, what


@given(history)
def test_whatever_comes_what_goes_out_is_within_the_bounds(events):
    for _, gate, _, _ in played(events):
        v, omega = gate.applied
        assert abs(v) <= 1.0 + 1e-12
        assert abs(omega) <= 2.0 + 1e-12
        assert abs(v) + 0.25 * abs(omega) <= 1.2 + 1e-12


@given(history)
def test_in_any_stretch_of_time_the_wheels_gain_no_more_than_they_may(events):
    """But for a stop because the clock is no number, and a clock that was put back."""
    seen = [(now, gate.applied) for _, gate, now, _ in played(events)]
    for i in range(len(seen)):
        for j in range(i + 1, min(i + 12, len(seen))):
            stretch = seen[i : j + 1]
            if any(not math.isfinite(t) for t, _ in stretch):
                break
            if any(b < a for (a, _), (b, _) in pairwise(stretch)):
                break
            (t0, a), (t1, b) = seen[i], seen[j]
            allowed = 2.0 * (t1 - t0 + RULES.period + RULES.jitter) + 1e-9
            for side in (-0.25, 0.25):
                assert abs(b.v - a.v + side * (b.omega - a.omega)) <= allowed


@given(history)
def test_nothing_but_a_reset_leads_out_of_a_latch_and_only_to_idle(events):
    for before, gate, _, what in played(events):
        if latched(before.mode) and not latched(gate.mode):
            assert what == "reset"
            assert gate.mode == GateMode.IDLE
            assert gate.applied == Twist(0.0, 0.0)


@given(history)
def test_nothing_but_a_choice_makes_it_drive(events):
    for before, gate, _, what in played(events):
        if driving(gate.mode) and not driving(before.mode):
            assert what == "drive"
            assert before.mode == GateMode.IDLE


@given(history)
def test_an_idle_robot_never_gets_faster(events):
    for before, gate, now, _ in played(events):
        if not driving(gate.mode) and math.isfinite(now):
            assert abs(gate.applied.v) <= abs(before.applied.v)
            assert abs(gate.applied.omega) <= abs(before.applied.omega)


@given(history)
def test_every_latch_has_a_reason(events):
    for _, gate, _, _ in played(events):
        assert bool(gate.reason) == latched(gate.mode)


@given(history, st.floats(0.101, 5.0))
def test_after_silence_it_never_drives(events, silence):
    *_, (_, gate, _, _) = [*played(events), (None, Gate(), 0.0, "")][: len(events) or 1]
    if driving(gate.mode):
        after, _ = g.tick(gate, gate.last_proposal + silence, RULES)
        assert after.mode == GateMode.FAULTED
