"""What the loop receives from the operator, by link, local stick or script."""

from __future__ import annotations

from typing import NamedTuple

from cohelm.link.messages import Command, Request, RequestKind

STALE = 0.25
"""A stick without a command for this long is lost [s]: an older command is not used."""


class ClientRequest(NamedTuple):
    """A request that the loop must execute or refuse, and answer."""

    client: int
    name: str
    request: Request
    age: float = 0.0
    """Upper bound of its age [s]; NaN: the client has left."""


class OperatorInput(NamedTuple):
    """The driver's present input."""

    driver: int
    """Client number; 0: nobody drives."""
    name: str
    command: Command | None
    """The driver's newest, if it is not stale."""
    age: float
    """Of that command [s]; without one, the time since the last one that was used; or NaN."""
    round_trip: float
    """To the driver [s]; NaN: not known."""
    requests: tuple[ClientRequest, ...]
    """New since the last call, oldest first, but a stop before all others."""
    term: int = 0
    """Count of leases; a change ends what was chosen before. A driver that is lost without a
    successor leaves it unchanged."""
    why: str = ""
    """Why there is no stick, where it is known."""


def stops_first(requests: tuple[ClientRequest, ...]) -> tuple[ClientRequest, ...]:
    """The requests with stops first."""
    return tuple(sorted(requests, key=lambda one: one.request.what != RequestKind.STOP))
