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
        self.steered: list[Command] = []

    def steer(self, command: Command) -> None:
        self.steered.append(command)


@pytest.mark.parametrize("on_the_way", [0.0, 0.1, 0.2])
def test_no_deflection_is_repeated_beyond_its_maximum_age(on_the_way):
    link = Link()
    operator = PageOperator("key", "anna", lambda _: link, STALE)
    now = time.monotonic()
    heard = 1e3 * (now - on_the_way)  # the beat that the page had heard when it sent this
    operator._on_message(
        page.Steer(n=1, echo_ms=heard, command=Command(Stick(0.5, 0.0), True, True, Device.GAMEPAD))
    )
    assert link.steered[-1].valid
    operator.watch(now - on_the_way + STALE - 0.01)
    assert link.steered[-1].valid
    operator.watch(now - on_the_way + STALE + 0.06)
    assert not link.steered[-1].valid
    assert link.steered[-1].device is Device.NONE
