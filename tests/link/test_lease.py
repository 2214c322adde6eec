"""The lease: one driver at a time, for any sequence of requests."""

from __future__ import annotations

from hypothesis import given, strategies as st

from cohelm.link import lease
from cohelm.link.lease import ANSWER_WITHIN, LeaseState

clients = st.integers(1, 4)
everyone = frozenset({1, 2, 3, 4})


def test_the_first_requester_drives_and_the_next_waits_for_the_driver():
    first = lease.take(LeaseState(), 1, 0.0)
    assert first.granted
    assert first.held.driver == 1
    second = lease.take(first.held, 2, 1.0)
    assert not second.granted
    assert second.held == LeaseState(1, 2, 1.0 + ANSWER_WITHIN)
    third = lease.take(second.held, 3, 2.0)
    assert not third.granted
    assert third.held == second.held
    assert lease.give(second.held, 1, 0, everyone).held == LeaseState(2)
    assert lease.refuse(second.held, 1).held == LeaseState(1)


def test_a_driver_who_does_not_answer_loses_the_lease():
    held = lease.take(LeaseState(1), 2, 0.0).held
    assert lease.expired(held, ANSWER_WITHIN - 0.01) == held
    assert lease.expired(held, ANSWER_WITHIN) == LeaseState(2)


def test_a_silent_driver_loses_the_lease_at_once():
    assert lease.take(LeaseState(1), 2, 0.0, silent=True).held == LeaseState(2)


def test_only_the_driver_hands_over_or_refuses_and_only_to_a_client():
    assert not lease.give(LeaseState(1), 2, 0, everyone).granted
    assert not lease.refuse(LeaseState(1, 2, 5.0), 2).granted
    assert not lease.give(LeaseState(1), 1, 9, everyone).granted
    assert lease.give(LeaseState(1), 1, 3, everyone).held == LeaseState(3)
    assert lease.give(LeaseState(1), 1, 0, everyone).held == LeaseState(0)


def test_a_disconnected_driver_leaves_the_lease_to_the_requester():
    assert lease.without(LeaseState(1, 2, 5.0), 1) == LeaseState(2)
    assert lease.without(LeaseState(1, 2, 5.0), 2) == LeaseState(1)
    assert lease.without(LeaseState(1), 3) == LeaseState(1)


@given(st.lists(st.tuples(st.sampled_from("tgrxl"), clients, st.integers(0, 4)), max_size=60))
def test_no_client_becomes_driver_without_request_or_handover(steps):
    held, now, wanted = LeaseState(), 0.0, set()
    for what, client, other in steps:
        now += 1.0
        before = held
        if what == "t":
            held = lease.take(held, client, now).held
            wanted.add(client)
        elif what == "g":
            held = lease.give(held, client, other, everyone).held
        elif what == "r":
            held = lease.refuse(held, client).held
        elif what == "x":
            held = lease.without(held, client)
        else:
            held = lease.expired(held, now)
        if held.driver not in (before.driver, 0):
            by_driver = what == "g" and client == before.driver
            assert held.driver in wanted or by_driver
            assert before.driver == 0 or by_driver or held.driver == before.requester
