"""Alarms have numbers that the link can carry, however many there were."""

from cohelm.loop.alarms import Alarms


def test_no_number_is_too_large_for_the_link_after_a_hundred_thousand_alarms():
    alarms, numbers = Alarms(), set()
    for _ in range(100_000):
        assert alarms.on("stick", "it flutters")
        numbers.add(alarms.worst()[0].number)
        alarms.acknowledge(0)
        alarms.off("stick")
    assert min(numbers) == 1
    assert max(numbers) == 65_535
