"""Pending requests: a stop is never lost, comes first, and cancels earlier requests."""

from hypothesis import given, strategies as st

from cohelm.link.messages import Request, RequestKind
from cohelm.link.operator import ClientRequest
from cohelm.link.pending import MOST_WAITING, MOVES, Pending

whats = st.sampled_from(
    [
        RequestKind.STOP,
        RequestKind.RESET,
        RequestKind.ACKNOWLEDGE,
        RequestKind.MODE,
        RequestKind.RECORD,
    ]
)
asked = st.tuples(st.integers(1, 4), whats)


def request(client: int, number: int, what: RequestKind) -> ClientRequest:
    return ClientRequest(client, f"client {client}", Request(number, what, 1, 0.0))


def fill(pending: Pending, sequence) -> list[ClientRequest]:
    """Put them all in; returns those that were refused or called off."""
    out = []
    for number, (client, what) in enumerate(sequence, 1):
        one = request(client, number, what)
        if what is RequestKind.STOP:
            out += pending.stop(one)
        elif not pending.add(one):
            out.append(one)
    return out


@given(st.lists(asked, max_size=400))
def test_no_flood_and_no_order_loses_a_stop(sequence):
    pending = Pending()
    out = fill(pending, sequence)
    taken = [(a.client, a.request.number) for a in pending.take()]
    stops = [(c, n) for n, (c, what) in enumerate(sequence, 1) if what is RequestKind.STOP]
    # the first and the newest of each client, before all else: all are obeyed, none twice
    first = dict(reversed(stops))
    due = set(first.items()) | set(dict(stops).items())
    assert set(taken[: len(due)]) == due
    assert taken[:1] == stops[:1] or not stops
    # nothing else is lost without being told
    assert len(taken) - len(due) + len(out) == len(sequence) - len(stops)
    assert pending.take() == ()


@given(st.lists(asked, max_size=60))
def test_a_mode_or_reset_from_before_a_stop_is_not_executed_after_it(sequence):
    pending = Pending()
    fill(pending, sequence)
    last = max(
        (n for n, (_, what) in enumerate(sequence, 1) if what is RequestKind.STOP), default=0
    )
    for one in pending.take():
        if one.request.what in MOVES:
            assert one.request.number > last


@given(st.lists(asked, max_size=400))
def test_no_client_displaces_the_requests_of_another(sequence):
    pending = Pending()
    fill(pending, [(1, what) for _, what in sequence])
    assert pending.add(request(2, 1, RequestKind.ACKNOWLEDGE))
    assert len(pending.take()) <= MOST_WAITING + 3


@given(st.lists(asked, max_size=60))
def test_withdrawn_requests_are_not_executed_and_others_keep_waiting(sequence):
    pending = Pending()
    fill(pending, [one for one in sequence if one[1] is not RequestKind.STOP])
    off = pending.withdraw(1)
    assert all(one.client == 1 and one.request.what is not RequestKind.ACKNOWLEDGE for one in off)
    left = pending.take()
    assert not any(one in left for one in off)
    assert not any(a.client == 1 and a.request.what is not RequestKind.ACKNOWLEDGE for a in left)
