"""One driver at a time: a lease that the robot gives, as a pure state machine.

Who asks while nobody drives gets it. Who asks while another drives waits: the driver gives it or
refuses; a driver who says nothing for `ANSWER_WITHIN` loses it, for somebody may have walked away
from a screen. A driver who is gone (`gone`) loses it at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

ANSWER_WITHIN = 10.0
"""What a driver has to answer another's question [s]."""

NOBODY = 0


class Held(NamedTuple):
    """Who drives, and who would like to."""

    driver: int = NOBODY
    """Client number."""
    asking: int = NOBODY
    until: float = math.nan
    """When the one asking gets it, if the driver says nothing [s]."""


class Said(NamedTuple):
    """What follows from a request."""

    held: Held
    granted: bool
    reason: str


def take(held: Held, client: int, now: float, silent: bool = False) -> Said:
    """A client wants to drive. silent: nothing is heard of the driver; it can not be asked."""
    if held.driver == client:
        return Said(held, True, "you drive already")
    if held.driver == NOBODY or silent:
        return Said(Held(client), True, "")
    if held.asking == client:
        return Said(held, False, "asked; the driver has not answered yet")
    if held.asking != NOBODY:
        return Said(held, False, "another is asking already")
    return Said(Held(held.driver, client, now + ANSWER_WITHIN), False, "the driver is asked")


def give(held: Held, client: int, to: int, known: frozenset[int]) -> Said:
    """The driver gives the lease to another, or (0) to who asks, or to nobody."""
    if held.driver != client:
        return Said(held, False, "you do not drive")
    new = to or held.asking
    if new != NOBODY and new not in known:
        return Said(held, False, "there is no such client")
    return Said(Held(new), True, "")


def refuse(held: Held, client: int) -> Said:
    """The driver keeps it."""
    if held.driver != client:
        return Said(held, False, "you do not drive")
    if held.asking == NOBODY:
        return Said(held, False, "nobody asks")
    return Said(Held(held.driver), True, "")


def gone(held: Held, client: int) -> Held:
    """A client is not there any more: its lease passes to who asks for it, else to nobody."""
    if held.driver == client:
        return Held(held.asking)
    if held.asking == client:
        return Held(held.driver)
    return held


def later(held: Held, now: float) -> Held:
    """As time passes: a driver who does not answer has given it away."""
    return Held(held.asking) if held.asking != NOBODY and now >= held.until else held
