"""When movers are evaluated: with each new scan, and not much less often without."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import CENTRED, Pose, Stick, Twist, disc
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.pilot import Pilot
from cohelm.plan.evasion.evade import is_due
from cohelm.plan.evasion.movers import (
    COUNT,
    WALKED,
    acceleration,
    empty_mover_history,
    updated_history,
)
from cohelm.plan.evasion.params import EvasionParams
from tests.pilot.drives import DT, SETTINGS

PERIOD = EvasionParams().period


def evaluations(scans, seconds=5.0, dt=0.02):
    """(n, 2): when movers are evaluated, and whether with a scan; scans: when they come [s]."""
    out, since, after_scan = [], math.inf, False
    steps = [math.ceil(t / dt - 1e-9) for t in scans]
    for k in range(int(seconds / dt)):
        since, fresh = since + dt, k in steps
        if is_due(since, fresh, after_scan, PERIOD, dt):
            out.append((k * dt, fresh))
            since, after_scan = 0.0, fresh
    return np.array(out)


def test_without_scans_they_are_a_period_apart():
    assert np.diff(evaluations([])[:, 0]) == pytest.approx(PERIOD)


@given(st.floats(0.0, 0.1), st.lists(st.floats(-0.01, 0.01), min_size=50, max_size=50))
def test_at_ten_scans_a_second_each_is_evaluated_when_it_comes_and_nothing_else(phase, late):
    scans = phase + 0.1 * np.arange(50) + late
    made = evaluations(np.maximum(scans, 0.0))
    settled = made[made[:, 0] > phase + 0.15]
    assert settled[:, 1].all()
    assert len(settled) >= np.sum((scans > phase + 0.17) & (scans < 4.97))


@given(st.floats(0.5, 50.0), st.floats(0.0, 1.0))
def test_whatever_the_rate_of_the_scans_they_are_neither_rare_nor_wasteful(rate, phase):
    made = evaluations((phase + np.arange(int(5.0 * rate))) / rate)
    between = np.diff(made[:, 0])
    assert between.max() <= 1.3 * PERIOD + 0.02
    assert len(made) <= 5.0 / 0.06 + 2.0
    with_scan = made[made[:, 1] > 0.0, 0]
    if rate <= 1.0 / PERIOD:  # none of them has to wait
        assert len(with_scan) >= int(5.0 * rate) - 2


def test_an_acceleration_goes_by_the_true_times_between_evaluations():
    rng, history = np.random.default_rng(3), empty_mover_history()
    t = 0.0
    for since in rng.choice([0.02, 0.06, 0.1, 0.12], 12):
        t += since
        seen = updated_history(
            history, surroundings([disc(0.5 * 0.7 * t * t, 0.0, 0.3, 0.8, 0.7 * t, 0.0)]).discs,
            np.zeros(1), since,
        )  # fmt: skip
        history[: len(seen)], history[len(seen) :] = seen, math.nan
    assert acceleration(seen[0], 1.0) == pytest.approx((0.7, 0.0), abs=1e-6)


def test_who_was_somewhere_else_a_while_ago_is_not_taken_to_have_been_here():
    """The operator led for a while, or nobody has looked yet: then what moves is new."""
    walker = surroundings([disc(0.0, 0.0, 0.3, 0.8, 0.8, 0.0)])
    history = empty_mover_history()
    seen = updated_history(history, walker.discs, np.zeros(1), 0.1)
    history[: len(seen)] = seen
    counts = [
        updated_history(history, walker.discs, np.zeros(1), since)[0]
        for since in (0.1, 3.0, math.inf)
    ]
    velocities = [row[COUNT] for row in counts]
    assert velocities == [2.0, 1.0, 1.0]
    assert np.isfinite(counts[2][WALKED])


def test_after_the_operator_has_led_movers_are_evaluated_at_once():
    pilot = Pilot(through([(0.0, 0.0), (4.0, 0.0)], 0.5), SETTINGS)
    near = surroundings([disc(2.0, 1.0, 0.3, 0.8, -0.2, 0.0)], [1.0])
    for k in range(100):
        stick = Stick(1.0, 0.0) if 20 <= k < 71 else CENTRED
        pilot.step(k * DT, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), stick, near)
        if k == 70:
            assert 51 * DT - 1e-9 < pilot.state.evasion.since < 51 * DT + PERIOD
        if k == 71:
            assert pilot.state.evasion.since == 0.0
