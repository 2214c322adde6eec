"""The station never repeats a deflection beyond its maximum age."""

from __future__ import annotations

import time

import pytest

from cohelm.core.types import Stick
from cohelm.link.messages import Command, Device
from cohelm.station import messages as page
from cohelm.station.operator import PageOperator

STALE = 0.25


class Link:
    def __init__(self) -> None:
        self.steered: list[tuple[Command, float | None]] = []

    def steer(self, command: Command, until: float | None = None) -> None:
        self.steered.append((command, until))


def said(operator: PageOperator, n: int, beat: float) -> None:
    """A page's stick, by the beat that it had heard [s]."""
    command = Command(Stick(0.5, 0.0), True, True, Device.GAMEPAD)
    operator._on_message(page.Steer(n=n, echo_ms=1e3 * beat, command=command))


@pytest.mark.parametrize("on_the_way", [0.0, 0.1, 0.2])
def test_a_deflection_is_lost_at_its_maximum_age_since_the_beat_that_it_echoes(on_the_way):
    link = Link()
    operator = PageOperator("key", "anna", link, STALE)
    beat = time.monotonic() - on_the_way
    said(operator, 1, beat)
    [(command, until)] = link.steered
    assert command.valid
    assert until == pytest.approx(beat + STALE, abs=1e-3)


def test_a_deflection_that_is_too_old_at_its_arrival_or_came_before_is_not_sent():
    link = Link()
    operator = PageOperator("key", "anna", link, STALE)
    now = time.monotonic()
    said(operator, 5, now)
    said(operator, 5, now)
    said(operator, 4, now)
    said(operator, 6, now - STALE - 0.01)
    said(operator, 7, now + 10.0)
    assert len(link.steered) == 1
