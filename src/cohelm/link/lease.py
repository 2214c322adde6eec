"""The lease: one driver at a time, as a pure state machine.

Who asks while nobody drives gets it. Who asks while another drives waits: the driver gives it or
refuses; a driver who says nothing for `ANSWER_WITHIN` loses it, for somebody may have walked away
from a screen. A driver who is gone (`gone`) loses it at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

ANSWER_WITHIN = 10.0
"""Time for the driver to answer a request for the lease [s]."""

NOBODY = 0


class Held(NamedTuple):
    """The driver, and the client that requests the lease."""

    driver: int = NOBODY
    """Client number."""
    asking: int = NOBODY
    until: float = math.nan
    """When it is handed over without an answer [s]."""


class Said(NamedTuple):
    """The result of a request."""

    held: Held
    granted: bool
    reason: str


def take(held: Held, client: int, now: float, silent: bool = False) -> Said:
    """A client requests the lease. silent: the driver sends nothing, so it is not asked."""
    if held.driver == client:
        return Said(held, True, "you are the driver already")
    if held.driver == NOBODY or silent:
        return Said(Held(client), True, "")
    if held.asking == client:
        return Said(held, False, "requested; the driver has not answered yet")
    if held.asking != NOBODY:
        return Said(held, False, "another operator has a pending request")
    return Said(
        Held(held.driver, client, now + ANSWER_WITHIN), False, "requested; the driver must answer"
    )


def give(held: Held, client: int, to: int, known: frozenset[int]) -> Said:
    """The driver gives the lease to a client, or (0) to the one that requests it, or to none."""
    if held.driver != client:
        return Said(held, False, "you are not the driver")
    new = to or held.asking
    if new != NOBODY and new not in known:
        return Said(held, False, "there is no such client")
    return Said(Held(new), True, "")


def refuse(held: Held, client: int) -> Said:
    """The driver keeps it."""
    if held.driver != client:
        return Said(held, False, "you are not the driver")
    if held.asking == NOBODY:
        return Said(held, False, "no request is pending")
    return Said(Held(held.driver), True, "")


def gone(held: Held, client: int) -> Held:
    """A client has left: its lease passes to the one that requests it, else to none."""
    if held.driver == client:
        return Held(held.asking)
    if held.asking == client:
        return Held(held.driver)
    return held


def later(held: Held, now: float) -> Held:
    """As time passes: a driver that does not answer loses it."""
    return Held(held.asking) if held.asking != NOBODY and now >= held.until else held
