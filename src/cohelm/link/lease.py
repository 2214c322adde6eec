"""The lease: one driver at a time, as a pure state machine.

A request is granted at once while there is no driver. Otherwise the driver hands the lease over or
refuses; without an answer within `ANSWER_WITHIN` it is handed over, since the driver may have left
the screen. A driver that disconnects loses it at once (`without`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

ANSWER_WITHIN = 10.0
"""Time for the driver to answer a request for the lease [s]."""

NO_DRIVER = 0


class LeaseState(NamedTuple):
    """The driver, and the client that requests the lease."""

    driver: int = NO_DRIVER
    """Client number."""
    requester: int = NO_DRIVER
    until: float = math.nan
    """When it is handed over if the driver does not answer [s]."""


class LeaseResult(NamedTuple):
    """The result of a request."""

    held: LeaseState
    granted: bool
    reason: str


def take(held: LeaseState, client: int, now: float, silent: bool = False) -> LeaseResult:
    """A client requests the lease. silent: the driver sends nothing, so it is not waited for."""
    if held.driver == client:
        return LeaseResult(held, True, "you are the driver already")
    if held.driver == NO_DRIVER or silent:
        return LeaseResult(LeaseState(client), True, "")
    if held.requester == client:
        return LeaseResult(held, False, "requested; the driver has not answered yet")
    if held.requester != NO_DRIVER:
        return LeaseResult(held, False, "another operator has a pending request")
    return LeaseResult(
        LeaseState(held.driver, client, now + ANSWER_WITHIN),
        False,
        "requested; the driver must answer",
    )


def give(held: LeaseState, client: int, to: int, known: frozenset[int]) -> LeaseResult:
    """The driver gives the lease to a client, or (0) to the one that requests it, or to none."""
    if held.driver != client:
        return LeaseResult(held, False, "you are not the driver")
    new = to or held.requester
    if new != NO_DRIVER and new not in known:
        return LeaseResult(held, False, "there is no such client")
    return LeaseResult(LeaseState(new), True, "")


def refuse(held: LeaseState, client: int) -> LeaseResult:
    """The driver keeps the lease."""
    if held.driver != client:
        return LeaseResult(held, False, "you are not the driver")
    if held.requester == NO_DRIVER:
        return LeaseResult(held, False, "no request is pending")
    return LeaseResult(LeaseState(held.driver), True, "")


def without(held: LeaseState, client: int) -> LeaseState:
    """A client has left: its lease passes to the one that requests it, else to none."""
    if held.driver == client:
        return LeaseState(held.requester)
    if held.requester == client:
        return LeaseState(held.driver)
    return held


def expired(held: LeaseState, now: float) -> LeaseState:
    """The lease as of now: a driver that has not answered in time loses it."""
    return LeaseState(held.requester) if held.requester != NO_DRIVER and now >= held.until else held
