import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import disc
from cohelm.sim.operator_model import IDLE, OperatorModel, normal, replay, replayed
from cohelm.sim.run import run
from cohelm.sim.world import Body, world
from tests.sim.runs import LAB, NO_WALLS, bodies, lab_run

rows = st.lists(st.tuples(st.floats(0, 10), st.floats(-1, 1), st.floats(-1, 1)), max_size=12)


def hand(events):
    return tuple(np.array(column, dtype=float) for column in zip(*sorted(events), strict=True))


@given(rows.filter(bool), st.floats(-1, 11))
def test_a_recorded_deflection_holds_until_the_next(events, t):
    times, x, psi = hand(events)
    past = np.flatnonzero(times <= t)
    held = (0.0, 0.0)
    if len(past) and t <= times[-1]:
        held = (x[past[-1]], psi[past[-1]])
    assert replayed(replay(times, x, psi), t) == held


def test_before_and_after_the_record_the_stick_is_centred():
    one = replay([1.0, 2.0], [0.3, 0.4], [-0.3, -0.4])
    seen = [replayed(one, t).x for t in (0.0, 0.999, 1.0, 1.999, 2.0, 2.001, 100.0)]
    assert seen == [0.0, 0.0, 0.3, 0.3, 0.4, 0.0, 0.0]


def test_of_two_events_at_one_instant_the_later_counts():
    one = replay([1.0, 1.0, 2.0], [0.3, 0.4, 0.5], np.zeros(3))
    assert replayed(one, 1.0).x == 0.4


def test_no_record_is_a_centred_stick():
    assert replayed(replay(), 5.0) == (0.0, 0.0)


def test_trembling_is_standard_normal_and_its_own_for_every_seed():
    drawn = np.array([[normal(seed, k) for k in range(4000)] for seed in range(3)])
    assert np.isfinite(drawn).all()
    assert drawn.mean(axis=1) == pytest.approx([0, 0, 0], abs=4 / math.sqrt(4000))
    assert drawn.std(axis=1) == pytest.approx([1, 1, 1], abs=0.05)
    assert np.abs(np.corrcoef(drawn) - np.eye(3)).max() < 4 / math.sqrt(4000)
    assert np.corrcoef(drawn[0, :-1], drawn[0, 1:])[0, 1] == pytest.approx(
        0, abs=4 / math.sqrt(4000)
    )


PERSON = OperatorModel(active=True)


@pytest.fixture(scope="module")
def dodging():
    return run(lab_run(operator=PERSON))


def held(trace):
    return (trace.rows["stick_x"] != 0.0) | (trace.rows["stick_psi"] != 0.0)


def test_the_simulated_operator_takes_the_stick_for_an_obstacle_and_releases_it_afterwards(dodging):
    on = held(dodging)
    assert on.any()
    assert not on[0]
    takes = np.flatnonzero(np.diff(on.astype(int)) == 1)
    lets_go = np.flatnonzero(np.diff(on.astype(int)) == -1)
    assert len(takes) == len(lets_go)  # every time
    for k in takes:  # something is near when the hand closes
        row, discs = dodging.rows[k], dodging.discs[k]
        clearances = np.hypot(discs[:, 0] - row["x"], discs[:, 1] - row["y"]) - discs[:, 4]
        assert clearances.min() < PERSON.look_ahead + 0.6
    free = on[-300:]
    assert not free.any()
    assert dodging.rows["e_p"][-1] < 0.03


def test_the_hand_stays_on_the_stick_and_moves_no_faster_than_a_hand(dodging):
    for axis in ("stick_x", "stick_psi"):
        moved = np.abs(np.diff(dodging.rows[axis], prepend=0.0))
        assert moved.max() <= PERSON.hand_rate * 0.01 * (1 + 1e-12)
        assert np.abs(dodging.rows[axis]).max() <= 1.0


def test_the_simulated_operator_does_not_touch_the_stick_in_an_empty_world():
    trace = run(lab_run(operator=PERSON, obstacles=world(([], NO_WALLS)), names=()))
    assert not held(trace).any()


def test_what_the_person_does_not_notice_is_left_to_the_controller():
    unseen = [Body(b.row, b.path, b.start, noticed=False) for b in bodies()]
    trace = run(lab_run(operator=PERSON, obstacles=world((unseen, NO_WALLS))))
    assert not held(trace).any()


def test_the_person_dodges_away_from_the_obstacle():
    for side in (1, -1):
        # The cone stands left or right of a path that leads straight north.
        cone = Body(disc(-0.12 * side, 0.0, 0.1))
        trace = run(
            lab_run(None, operator=PERSON, obstacles=world(([cone], NO_WALLS)), duration=6.0)
        )
        assert held(trace).any()
        pushed = trace.rows["stick_psi"]
        first = pushed[np.flatnonzero(np.abs(pushed) > 0.1)[0]]
        assert np.sign(first) == -side  # yaw positive to the left


def same(one, other):
    return one.rows.tobytes() == other.rows.tobytes()


def test_a_hand_that_does_not_tremble_has_no_use_for_a_seed(dodging):
    assert same(run(lab_run(operator=PERSON, seed=99)), dodging)


def test_a_trembling_hand_is_the_same_again_from_the_same_seed():
    def trembling(seed):
        return run(lab_run(operator=PERSON._replace(tremor=0.05), seed=seed, duration=8.0))

    assert same(trembling(3), trembling(3))
    assert not same(trembling(3), trembling(4))
    assert np.abs(trembling(3).rows["stick_x"]).max() <= 1.0


def test_an_idle_person_has_hands_off():
    assert (IDLE.side, IDLE.x, IDLE.psi) == (0.0, 0.0, 0.0)
    assert not held(run(lab_run(operator=OperatorModel()))).any()
    assert LAB.duration > 58.0
