"""Losing the stick, the link and the driver, in every order."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Stick
from cohelm.link import hand
from cohelm.link.hand import CENTRE, OnLoss, Rules, State
from cohelm.link.messages import Arming, Ask, Command, Device, Mode, Request

DT = 0.02


def command(x: float = 0.0, valid: bool = True, armed: bool = True) -> Command:
    return Command(Stick(x, 0.0), valid, armed, Device.SCRIPT, 1.0, ())


def request(what: Ask, value: int = 0) -> Request:
    return Request(1, what, value, 0.0)


def driving(mode: Mode = Mode.SHARED, rules: Rules | None = None) -> hand.Hand:
    """A driver with an armed stick, at time 0."""
    state = State(mode=mode, stopped="")
    return hand.step(state, command(), 1, 0.0, rules)


def after(hand_: hand.Hand, seconds: float, what: Command | None, rules: Rules | None = None):
    """Steps until `seconds` later; the last one, and all alarms."""
    alarms = []
    for number in range(1, round(seconds / DT) + 1):
        hand_ = hand.step(
            hand_.state, what, hand_.state.driver, hand_.state.heard + DT if what else number * DT,
            rules,
        )  # fmt: skip
        alarms += [hand_.alarm] if hand_.alarm else []
    return hand_, alarms


def test_a_stick_steers_only_after_it_has_been_seen_centred():
    state = State(mode=Mode.SHARED, stopped="")
    first = hand.step(state, command(0.8), 1, 0.0)
    assert first.state.arming is Arming.WAITING
    assert first.stick == CENTRE
    second = hand.step(first.state, command(0.03), 1, DT)
    assert second.state.arming is Arming.ARMED
    assert hand.step(second.state, command(0.8), 1, 2 * DT).stick == Stick(0.8, 0.0)


@pytest.mark.parametrize("mode", [Mode.SHARED, Mode.MANUAL])
def test_a_stick_lost_in_use_stops_the_robot_until_it_is_reset(mode):
    lost = hand.step(driving(mode).state, command(valid=False), 1, DT)
    assert lost.brake
    assert lost.alarm == lost.state.stopped == "the stick was lost"
    again = hand.step(lost.state, command(), 1, 2 * DT)
    assert again.brake
    assert not again.alarm
    state, granted, _ = hand.ask(again.state, request(Ask.RESET), "anna", command())
    assert granted
    assert not hand.step(state, command(), 1, 3 * DT).brake


def test_a_stick_lost_in_use_is_no_stop_only_where_that_was_chosen_and_there_is_a_plan():
    rules = Rules(stick_lost=OnLoss.ALONE)
    alone = hand.step(driving(Mode.SHARED, rules).state, command(valid=False), 1, DT, rules)
    assert not alone.brake
    assert alone.alarm
    manual = hand.step(driving(Mode.MANUAL, rules).state, command(valid=False), 1, DT, rules)
    assert manual.brake


def test_a_stick_never_armed_may_come_and_go():
    state = State(mode=Mode.SHARED, stopped="")
    for valid in (False, True, False):
        step = hand.step(state, command(valid=valid, armed=False), 1, 0.0)
        assert not step.brake
        assert not step.alarm
        state = step.state


def test_without_a_fresh_command_an_armed_stick_brakes_at_once_and_stops_after_the_watchdog():
    start = driving()
    gap = hand.step(start.state, None, 1, 0.26)
    assert gap.brake
    assert not gap.alarm
    assert not hand.step(gap.state, command(), 1, 0.28).brake  # it was only late
    lost = hand.step(gap.state, None, 1, 0.301)
    assert lost.brake
    assert lost.alarm == "the link to the driver was lost"
    back = hand.step(lost.state, command(0.9), 1, 3.0)
    assert back.brake
    assert back.stick == CENTRE
    assert not hand.ask(back.state, request(Ask.RESET), "anna", command(0.9))[1]
    state, granted, _ = hand.ask(back.state, request(Ask.RESET), "anna", command())
    assert granted
    deflected = hand.step(state, command(0.9), 1, 3.1)
    assert deflected.stick == CENTRE  # not centred since


def test_automatic_goes_on_until_the_watchdog_and_beyond_it_only_where_that_was_chosen():
    for rules, goes_on in ((Rules(), False), (Rules(link_lost=OnLoss.ALONE), True)):
        start = driving(Mode.AUTOMATIC, rules)
        assert not hand.step(start.state, None, 1, 0.29, rules).brake
        lost, alarms = after(start, 2.0, None, rules)
        assert lost.brake is not goes_on
        assert alarms == ["the link to the driver was lost"]


def test_a_driver_who_gives_the_lease_to_nobody_leaves_a_robot_that_stands():
    left = hand.step(driving().state, None, 0, DT)
    assert left.brake
    assert left.state.stopped == "nobody drives"


def test_another_driver_must_centre_the_stick_first_but_the_robot_need_not_stop():
    new = hand.step(driving(Mode.AUTOMATIC).state, None, 2, DT)
    assert not new.brake
    new = hand.step(driving(Mode.SHARED).state, command(1.0), 2, DT)
    assert new.stick == CENTRE
    assert not new.brake


def test_anybody_stops_and_a_stop_needs_the_stick_centred_again():
    state, granted, _ = hand.ask(driving().state, request(Ask.STOP), "ben", None)
    assert granted
    assert state.stopped == "ben pressed stop"
    assert state.arming is Arming.WAITING
    assert hand.step(state, command(), 1, DT).brake
    assert hand.ask(state, request(Ask.RESET), "anna", None)[1:] == (
        False, "the driver is not heard",
    )  # fmt: skip


def test_modes_that_are_none_are_refused_and_a_change_asks_for_a_centred_stick():
    state = driving().state
    assert not hand.ask(state, request(Ask.MODE, 99), "anna", command())[1]
    changed = hand.ask(state, request(Ask.MODE, Mode.MANUAL), "anna", command())[0]
    assert hand.step(changed, command(0.9), 1, DT).brake
    assert hand.step(changed, command(0.9), 1, DT).stick == CENTRE


commands = st.one_of(
    st.none(),
    st.builds(command, st.sampled_from([0.0, 0.02, 0.5, -1.0]), st.booleans(), st.booleans()),
)
events = st.lists(
    st.tuples(
        commands, st.sampled_from([0, 1, 1, 1, 2]), st.floats(0.0, 0.4),
        st.sampled_from([None, None, Ask.STOP, Ask.RESET, Ask.MODE]), st.integers(0, 5),
    ),
    max_size=60,
)  # fmt: skip


@given(events, st.sampled_from(OnLoss), st.sampled_from(OnLoss))
def test_whatever_happens_the_robot_moves_only_when_it_may(events, link_lost, stick_lost):
    rules = Rules(link_lost=link_lost, stick_lost=stick_lost)
    state, now, stopped = State(mode=Mode.SHARED, stopped=""), 0.0, False
    seen_centred = False
    for what, driver, dt, asked, value in events:
        now += dt
        before = state
        if asked is not None:
            state, granted, reason = hand.ask(state, request(asked, value), "x", what, rules)
            assert granted or reason
            stopped = (stopped or asked is Ask.STOP) and not (asked is Ask.RESET and granted)
        if driver != before.driver or asked is not None:
            seen_centred = False
        result = hand.step(state, what, driver, now, rules)
        if what is None or not (what.valid and what.armed):
            # a gap alone does not disarm, so it may stay seen
            seen_centred = seen_centred and what is None
        elif abs(what.stick.x) <= rules.centred:
            seen_centred = True
        if stopped:
            assert result.brake
        if result.stick != CENTRE:
            assert what is not None
            assert result.stick == what.stick
            assert what.valid
            assert what.armed
            assert seen_centred or state.arming is Arming.ARMED
            assert not result.brake
        if result.state.stopped:
            assert result.brake
        if what is None and not result.brake:
            fresh = now - result.state.heard <= rules.watchdog and driver != 0
            assert fresh or link_lost is OnLoss.ALONE
        stopped = bool(result.state.stopped)
        state = result.state
