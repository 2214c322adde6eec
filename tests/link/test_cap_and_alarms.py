"""The cap on speed, and alarms."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, strategies as st

from cohelm.link import alarms
from cohelm.link.alarms import MOST, Alarms
from cohelm.link.cap import CRAWL, FREE, speed_cap
from cohelm.link.messages import Severity


@given(st.floats(FREE + 0.001, 5.0), st.floats(0.0, 20.0), st.floats(0.1, 5.0))
def test_what_the_person_sees_leaves_room_to_stop(delay, clearance, deceleration):
    cap = speed_cap(delay, clearance, deceleration, math.inf)
    way = cap.speed * delay + cap.speed**2 / (2.0 * deceleration)
    assert way == pytest.approx(clearance) or cap.speed == CRAWL
    assert "delay" in cap.reason


@pytest.mark.parametrize(("delay", "clearance"), [(0.1, 0.2), (math.nan, 0.2), (1.0, math.inf)])
def test_without_delay_or_obstacles_nothing_is_capped(delay, clearance):
    assert speed_cap(delay, clearance, 1.0, 1.0) == (math.inf, "")


def test_more_delay_is_never_faster_and_a_cap_above_the_robot_is_none():
    caps = [speed_cap(0.2 + 0.1 * n, 1.0, 1.0, math.inf).speed for n in range(10)]
    assert caps == sorted(caps, reverse=True)
    assert speed_cap(0.2, 50.0, 1.0, 1.0).speed == math.inf
    assert speed_cap(math.inf, 1.0, 1.0, 1.0).speed == CRAWL


def test_an_alarm_stays_until_it_is_both_seen_and_gone():
    one = alarms.raised(Alarms(), Severity.ALARM, "lost", active=True)
    assert alarms.raised(one, Severity.ALARM, "lost", active=True) == one
    seen = alarms.acknowledged(one, 1)
    assert seen.all[0].acknowledged
    assert not alarms.ended(seen, "lost").all
    gone = alarms.ended(one, "lost")
    assert len(gone.all) == 1
    assert not alarms.acknowledged(gone, 0).all


def test_the_same_thing_again_is_a_new_alarm_and_the_worst_unseen_is_shown_first():
    many = Alarms()
    for severity, text in ((0, "a"), (2, "b"), (1, "c"), (2, "b")):
        many = alarms.raised(many, Severity(severity), text)
    assert [a.text for a in alarms.shown(many)] == ["b", "b", "c", "a"]
    active = alarms.raised(many, Severity.ALARM, "d", active=True)
    assert alarms.shown(alarms.acknowledged(active, 5))[-1].text == "d"


def test_of_too_many_those_that_are_over_are_forgotten_first():
    many = alarms.raised(Alarms(), Severity.ALARM, "goes on", active=True)
    for number in range(3 * MOST):
        many = alarms.raised(many, Severity.NOTICE, str(number))
    assert len(many.all) == MOST
    assert many.all[0].text == "goes on"
    assert many.last == 3 * MOST + 1
