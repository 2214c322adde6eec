"""Requests between their arrival and the loop's next period. A stop is not in the queue with them.

A stop is a flag with a name on it: the first one since the loop last looked wins, nothing can crowd
it out, and it is handed over before all else. What was asked before it, by anybody, and would move
the robot, is not done after it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from cohelm.link.heard import Asked
from cohelm.link.messages import Ask

MOST_WAITING = 16
"""Requests of one client that may wait for the loop; twice what one command carries."""
MOVES = frozenset({Ask.RESET, Ask.MODE})
"""Requests after which wheels may turn."""


class Taken(NamedTuple):
    """What the loop gets."""

    asked: tuple[Asked, ...]
    """A stop first, if there was one; then the others, oldest first."""
    stops: tuple[tuple[int, int], ...]
    """Client and newest request number of further stops, which that one does."""


class Pending:
    """Not thread-safe; whoever owns it has the lock."""

    def __init__(self) -> None:
        self._stop: Asked | None = None
        self._stops: dict[int, int] = {}
        self._others: list[Asked] = []
        self._waiting: Counter[int] = Counter()

    def stop(self, asked: Asked) -> tuple[Asked, ...]:
        """Somebody stops the robot; returns the requests that are called off by it."""
        if self._stop is None:
            self._stop = asked
        if asked.client in self._stops or len(self._stops) < 64:  # the flag is up in any case
            self._stops[asked.client] = asked.request.number
        return self._without(lambda other: other.request.what in MOVES)

    def add(self, asked: Asked) -> bool:
        """Another request; False: too many of this client wait already."""
        if self._waiting[asked.client] >= MOST_WAITING:
            return False
        self._waiting[asked.client] += 1
        self._others.append(asked)
        return True

    def withdraw(self, client: int, but: frozenset[Ask]) -> tuple[Asked, ...]:
        """Take back what a client has asked for, except these; returns it."""
        return self._without(lambda one: one.client == client and one.request.what not in but)

    def _without(self, which: Callable[[Asked], bool]) -> tuple[Asked, ...]:
        off = tuple(one for one in self._others if which(one))
        self._others = [one for one in self._others if not which(one)]
        self._waiting.subtract(one.client for one in off)
        return off

    def take(self) -> Taken:
        """All of them, once."""
        stop = () if self._stop is None else (self._stop,)
        told = None if self._stop is None else (self._stop.client, self._stop.request.number)
        further = tuple(one for one in self._stops.items() if one != told)
        taken = Taken((*stop, *self._others), further)
        self._stop, self._stops, self._others = None, {}, []
        self._waiting.clear()
        return taken
