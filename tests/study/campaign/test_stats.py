"""Shares with exact bounds, against scipy's own and against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.study.campaign.result import NOT_DRIVEN
from cohelm.study.campaign.stats import share, spread, summary


@given(st.integers(1, 20_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_bounds_are_those_of_the_exact_binomial_test(counted):
    from scipy.stats import binomtest  # takes 0.4 s, in every worker

    count, of = counted
    found = share(count, of)
    theirs = binomtest(count, of).proportion_ci(0.95, "exact")
    assert found.low == pytest.approx(theirs.low, abs=1e-9)
    assert found.high == pytest.approx(theirs.high, abs=1e-9)


@pytest.mark.parametrize("of", [1, 60, 10_000])
def test_none_of_many_leaves_the_closed_form(of):
    assert share(0, of).high == pytest.approx(1.0 - 0.025 ** (1.0 / of), rel=1e-9)
    assert share(of, of).low == pytest.approx(0.025 ** (1.0 / of), rel=1e-9)
    assert (share(0, of).low, share(of, of).high) == (0.0, 1.0)


def test_of_nothing_anything_is_possible():
    assert (share(0, 0).low, share(0, 0).high) == (0.0, 1.0)


@pytest.mark.parametrize("p", [0.001, 0.1, 0.5])
def test_the_bounds_hold_the_truth_at_least_as_often_as_promised(p):
    from scipy.stats import binom

    counts = np.arange(101)
    held = [share(int(k), 100).low <= p <= share(int(k), 100).high for k in counts]
    assert binom.pmf(counts, 100, p)[held].sum() >= 0.95


def test_what_is_not_finite_is_left_out_of_a_spread():
    assert spread([3.0, math.nan, 1.0, math.inf, 2.0]) == (2.0, 1.0, 3.0, 3)
    assert spread([]).of == 0


def row(**changes):
    return NOT_DRIVEN._replace(suite="random", law="guard", fault="", **changes)


def test_an_episode_that_failed_counts_as_one_that_did_not_arrive():
    rows = [row(arrived=True), row(arrived=True, contacts_moving=3), NOT_DRIVEN._replace(fault="x")]
    found = summary("guard", rows, goals=True)
    assert (found.episodes, found.faults) == (3, 1)
    assert (found.moving.of, found.standing.of, found.touched.of) == (2, 2, 2)
    assert found.arrived is not None
    assert found.success is not None
    assert (found.arrived.count, found.success.count, found.moving.count) == (2, 1, 1)
    assert found.arrived.of == 3


def test_without_goals_nobody_is_said_to_have_arrived():
    assert summary("guard", [row()], goals=False).as_dict()["arrived"] is None


def test_the_score_is_the_mean_over_all_episodes_failures_counting_nothing():
    rows = [row(score=0.5), row(score=0.25), NOT_DRIVEN._replace(fault="x")]
    assert summary("guard", rows, goals=True).score == pytest.approx(0.25)
    assert math.isnan(summary("guard", [row()], goals=True).score)


def test_contacts_with_what_was_out_of_view_are_counted_apart():
    rows = [
        row(contacts_moving=1, contact_seen_s=0.0),
        row(contacts_moving=2, contact_seen_s=0.4, contact_needed_s=1.0),
        row(contacts_moving=1, contact_seen_s=1.2, contact_needed_s=1.0),  # it was seen in time
        row(contacts_standing=1, contact_seen_s=0.0),  # the robot stood
        row(),
    ]
    found = summary("guard", rows, goals=True)
    assert found.unseen is not None
    assert found.late is not None
    assert (found.moving.count, found.unseen.count, found.unseen.of) == (3, 1, 5)
    assert (found.late.count, found.late.of) == (1, 5)
    assert found.as_dict()["contacts_moving_unseen"] == 1
    assert found.as_dict()["contacts_moving_late"] == 1
    assert found.touched_unseen is not None
    assert (found.touched.count, found.touched_unseen.count, found.touched_unseen.of) == (4, 2, 5)
    assert found.as_dict()["touched_unseen"] == 2
    told = summary("guard", [row(contacts_moving=1)], goals=True)  # knows all, sees nothing
    assert told.unseen is None
    assert told.as_dict()["contacts_moving_unseen"] is None
    assert told.as_dict()["contacts_moving_late"] is None
    assert told.as_dict()["touched_unseen"] is None


def test_the_json_has_the_keys_that_are_promised():
    rows = [
        row(
            min_clearance_m=-0.01, contacts_standing=1, contacts_departing=1,
            untouched_share=0.8, duration_s=10.0,
        ),
        row(min_clearance_m=0.3, untouched_share=1.0, duration_s=30.0, unrecovered=2),
    ]  # fmt: skip
    got = summary("guard", rows, goals=True).as_dict()
    assert (got["episodes"], got["contacts_moving"], got["contacts_standing"]) == (2, 0, 1)
    assert (got["contacts_departing"], got["closest_m"], got["touched"]) == (1, -0.01, 1)
    assert got["unrecovered"] == 2
    assert got["untouched_share"] == pytest.approx(0.95)
    assert got["arrived"] == 0
