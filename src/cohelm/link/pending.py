"""Requests between their arrival and the loop's next period; stops are kept apart.

Nothing displaces a stop, and stops are handed over first. Earlier requests of any client that could
move the robot are cancelled by it. The stops of all clients are handed over, not only the first:
later requests are judged against the stops of all others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from cohelm.link.messages import RequestKind
from cohelm.link.operator import ClientRequest

MOST_WAITING = 16
"""Requests of one client that may wait for the loop; twice what one command carries."""
MOVES = frozenset({RequestKind.RESET, RequestKind.MODE})
"""Requests that may lead to motion."""
FOR_ANYONE = frozenset({RequestKind.STOP, RequestKind.ACKNOWLEDGE})
"""Requests that a client may make who is not the driver."""
_MOST_STOPPING = 64
"""Clients whose stops wait, in one period; the robot stops in any case."""


class Pending:
    """Not thread-safe; whoever owns it has the lock."""

    def __init__(self) -> None:
        self._stops: dict[int, list[ClientRequest]] = {}
        self._others: list[ClientRequest] = []
        self._waiting: Counter[int] = Counter()

    def stop(self, request: ClientRequest) -> tuple[ClientRequest, ...]:
        """Add a stop; returns the requests that it cancels."""
        if request.client in self._stops or len(self._stops) < _MOST_STOPPING:
            first = self._stops.get(request.client, [request])[0]
            self._stops[request.client] = [first] if first is request else [first, request]
        return self._without(lambda other: other.request.what in MOVES)

    def add(self, request: ClientRequest) -> bool:
        """Add a request; False: too many of this client wait."""
        if self._waiting[request.client] >= MOST_WAITING:
            return False
        self._waiting[request.client] += 1
        self._others.append(request)
        return True

    def withdraw(self, client: int) -> tuple[ClientRequest, ...]:
        """Withdraw what a client requested as the driver; returns it."""
        return self._without(
            lambda one: one.client == client and one.request.what not in FOR_ANYONE
        )

    def _without(self, which: Callable[[ClientRequest], bool]) -> tuple[ClientRequest, ...]:
        removed = tuple(one for one in self._others if which(one))
        self._others = [one for one in self._others if not which(one)]
        self._waiting.subtract(one.client for one in removed)
        return removed

    def take(self) -> tuple[ClientRequest, ...]:
        """All of them, once: the stops, in order of arrival, then the others."""
        stops = [stop for of_one in self._stops.values() for stop in of_one]
        taken = (*stops, *self._others)
        self._stops, self._others = {}, []
        self._waiting.clear()
        return taken
