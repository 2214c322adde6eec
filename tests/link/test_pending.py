"""A stop can not be lost, is done first, and nothing that was asked before it is done after it."""

from hypothesis import given, strategies as st

from cohelm.link.heard import Asked
from cohelm.link.messages import Ask, Request
from cohelm.link.pending import MOST_WAITING, MOVES, Pending

whats = st.sampled_from([Ask.STOP, Ask.RESET, Ask.ACKNOWLEDGE, Ask.MODE, Ask.RECORD])
asked = st.tuples(st.integers(1, 4), whats)


def request(client: int, number: int, what: Ask) -> Asked:
    return Asked(client, f"client {client}", Request(number, what, 1, 0.0))


def fill(pending: Pending, sequence) -> list[Asked]:
    """Put them all in; returns those that were refused or called off."""
    out = []
    for number, (client, what) in enumerate(sequence, 1):
        one = request(client, number, what)
        if what is Ask.STOP:
            out += pending.stop(one)
        elif not pending.add(one):
            out.append(one)
    return out


@given(st.lists(asked, max_size=400))
def test_no_flood_and_no_order_loses_a_stop(sequence):
    pending = Pending()
    out = fill(pending, sequence)
    taken = pending.take()
    stops = [(c, n) for n, (c, what) in enumerate(sequence, 1) if what is Ask.STOP]
    assert [a.request.what for a in taken.asked].count(Ask.STOP) == bool(stops)
    if stops:
        assert taken.asked[0].request.what is Ask.STOP  # before all else
        assert (taken.asked[0].client, taken.asked[0].request.number) == stops[0]
        # the newest of each client, so all are answered, and none twice
        assert set(taken.stops) | {stops[0]} == set(dict(stops).items()) | {stops[0]}
        assert stops[0] not in taken.stops
    # nothing is lost without being told
    rest = len(taken.asked) - bool(stops) + len(out)
    assert rest == len(sequence) - len(stops)
    assert pending.take() == ((), ())


@given(st.lists(asked, max_size=60))
def test_no_mode_and_no_reset_from_before_a_stop_is_done_after_it(sequence):
    pending = Pending()
    fill(pending, sequence)
    last = max((n for n, (_, what) in enumerate(sequence, 1) if what is Ask.STOP), default=0)
    for one in pending.take().asked:
        if one.request.what in MOVES:
            assert one.request.number > last


@given(st.lists(asked, max_size=400))
def test_no_client_takes_anothers_place(sequence):
    pending = Pending()
    fill(pending, [(1, what) for _, what in sequence])
    assert pending.add(request(2, 1, Ask.ACKNOWLEDGE))
    assert len(pending.take().asked) <= MOST_WAITING + 2


@given(st.lists(asked, max_size=60))
def test_what_is_withdrawn_is_not_done_and_others_wait_on(sequence):
    pending = Pending()
    fill(pending, [one for one in sequence if one[1] is not Ask.STOP])
    off = pending.withdraw(1, but=frozenset({Ask.ACKNOWLEDGE}))
    assert all(one.client == 1 and one.request.what is not Ask.ACKNOWLEDGE for one in off)
    left = pending.take().asked
    assert not any(one in left for one in off)
    assert not any(a.client == 1 and a.request.what is not Ask.ACKNOWLEDGE for a in left)
