"""What the loop receives from the operator, however it came: link, local stick, script."""

from __future__ import annotations

from typing import NamedTuple

from cohelm.link.messages import Ask, Command, Request

STALE = 0.25
"""A stick that was not heard of for so long is gone, whichever way it comes [s]: an older command
is not used."""


class ClientRequest(NamedTuple):
    """A request that the loop must do or refuse, and answer."""

    client: int
    name: str
    request: Request
    age: float = 0.0
    """How long ago it was made, at most [s]; NaN: whoever made it is gone."""


class OperatorInput(NamedTuple):
    """What the link knows of the driver's will, now."""

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
    """Counts the leases: another one than before, and what was chosen in that is over. A driver who
    is lost, with nobody after him, leaves it as it was."""
    why: str = ""
    """Why there is no stick, where more is known than that."""


def stops_first(requests: tuple[ClientRequest, ...]) -> tuple[ClientRequest, ...]:
    """The same with the stops before all else, in whatever order they came."""
    return tuple(sorted(requests, key=lambda one: one.request.what != Ask.STOP))
