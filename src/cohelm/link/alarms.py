"""Alarms that stay until they are both seen and gone, pure."""

from __future__ import annotations

from typing import NamedTuple

from cohelm.link.messages import Alarm, Severity

MOST = 32
"""Of more, those longest gone are forgotten."""


class Alarms(NamedTuple):
    """All that is not settled, oldest first."""

    all: tuple[Alarm, ...] = ()
    last: int = 0
    """Number of the newest."""


def raised(alarms: Alarms, severity: Severity, text: str, active: bool = False) -> Alarms:
    """Something has happened; active: and goes on until `ended`.

    What is active already is not raised again.
    """
    if any(alarm.active and alarm.text == text for alarm in alarms.all):
        return alarms
    number = alarms.last % 65535 + 1
    alarm = Alarm(number, severity, active, False, text)
    kept = sorted(alarms.all, key=lambda old: (old.active, old.number))[-(MOST - 1) :]
    return Alarms((*sorted(kept, key=lambda old: old.number), alarm), number)


def ended(alarms: Alarms, text: str) -> Alarms:
    """Its cause has gone; if it has been seen, so has the alarm."""
    return _settled(alarms, [a._replace(active=False) if a.text == text else a for a in alarms.all])


def acknowledged(alarms: Alarms, number: int) -> Alarms:
    """Somebody has seen one, or all (0)."""
    return _settled(
        alarms,
        [a._replace(acknowledged=True) if number in (0, a.number) else a for a in alarms.all],
    )


def shown(alarms: Alarms) -> tuple[Alarm, ...]:
    """As a status has them: unseen before seen, worst first, newest first."""
    order = sorted(alarms.all, key=lambda a: (a.acknowledged, -a.severity, -a.number))
    return tuple(order)


def _settled(alarms: Alarms, now: list[Alarm]) -> Alarms:
    return Alarms(tuple(a for a in now if a.active or not a.acknowledged), alarms.last)
