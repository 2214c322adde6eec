"""Alarm numbers fit the link after any number of alarms."""

import pytest

from cohelm.link import messages as m
from cohelm.link.wire import encode, from_robot
from cohelm.loop import loop
from cohelm.loop.alarms import ActiveAlarms
from tests.link.ends import STATUS
from tests.link.test_wire import HEADER


def test_no_number_is_too_large_for_the_link_after_a_hundred_thousand_alarms():
    alarms, numbers = ActiveAlarms(), set()
    for _ in range(100_000):
        assert alarms.on("stick", "it flutters")
        numbers.add(alarms.worst()[0].number)
        alarms.acknowledge(0)
        alarms.off("stick")
    assert min(numbers) == 1
    assert max(numbers) == 65_535


def test_an_alarm_keeps_its_number_when_its_text_changes():
    alarms = ActiveAlarms()
    alarms.reword("lost", "nobody is")
    assert alarms.worst() == ()
    assert alarms.on("lost", "lost: looking for the robot on the map")
    alarms.acknowledge(0)
    before = alarms.worst()[0]
    alarms.reword("lost", "lost: two places look alike: drive on a little")
    assert alarms.worst() == (
        before._replace(text="lost: two places look alike: drive on a little"),
    )
    alarms.off("lost")
    alarms.reword("lost", "it is over")
    assert alarms.worst() == ()


@pytest.mark.parametrize("text", [loop._NO_PLANNER, loop._LATE_PLANNER, loop._RECORDER_HANGS])
def test_alarms_about_the_loops_helpers_fit_the_message(text):
    alarm = m.Alarm(1, m.Severity.ALARM, True, False, text)
    status = STATUS._replace(alarms=(alarm,))
    assert from_robot(encode(HEADER, status))[1].alarms == (alarm,)
