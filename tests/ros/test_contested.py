"""Two controllers that command in turn are named: the robot does as the last says, and jerks."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cohelm.ros.commands import Commands
from cohelm.ros.mismatch import TWIST
from cohelm.ros.port import Received


def heard(*senders: str, step: float = 0.05) -> list[bool]:
    """Whether they are contested, after each message of these senders."""
    callbacks = {}
    transport = SimpleNamespace(
        subscribe=lambda _topic, kind, _qos, callback: callbacks.setdefault(kind, callback)
    )
    commands = Commands(transport, "/cmd", 0.5, SimpleNamespace())  # type: ignore[arg-type]
    twist = SimpleNamespace(linear=SimpleNamespace(x=0.1, y=0.0), angular=SimpleNamespace(z=0.0))
    found = []
    for k, sender in enumerate(senders):
        callbacks[TWIST](Received(twist, 10.0 + k * step, "", sender))
        found.append(commands.contested(10.0 + k * step))
    return found


def test_two_senders_in_turn_are_contested():
    assert heard("a", "a", "b", "a", "b", "b") == [False, False, False, False, True, True]
    assert heard(*"aabab", *"b" * 50)[-1] is False  # one of them has gone


@pytest.mark.parametrize("senders", ["aaabbbb", "aaaabaaa", ""])
def test_a_controller_that_is_replaced_or_not_named_is_not(senders):
    assert not any(heard(*senders))
    assert not any(heard("", "", "", ""))
