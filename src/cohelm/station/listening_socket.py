"""A listening socket that always has room for the next connection.

A connection is *waiting* until its first request is complete, *served* from then on, and *admitted*
once it has sent a session. The number of each of the first two is limited; beyond it, the oldest of
its kind is closed. So idle connections, also ones in a TLS handshake, block no other: they make
room for new ones, and a page is loaded within milliseconds. An admitted connection is never closed
for others.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import time
from collections.abc import Callable
from enum import Enum
from typing import Any

from cohelm.station.access_control import is_loopback

_log = logging.getLogger("cohelm.station")

MOST_WAITING = 256
"""Room for a page that sends its request within 0.1 s, among 2000 new connections a second; well
below the 1024 files that a process may have open by default."""
MOST_SERVED = 128
"""A browser opens six at once for a page, and needs them for 0.3 s: so room for a page among 400
new requests a second."""
MOST_OF_ONE_ADDRESS = 48
"""Waiting and served, from one network address; loopback, all local users, has no limit."""
Address = tuple[str, int]


class _Kind(Enum):
    WAITING = 1
    SERVED = 2
    ADMITTED = 3


class _Connection:
    def __init__(self, sock: socket.socket, now: float) -> None:
        self.sock, self.since, self.kind = sock, now, _Kind.WAITING
        self.abort: Callable[[], None] | None = None


class ListeningSocket(socket.socket):
    """All calls but the constructor come from the thread of the server."""

    def __init__(self, family: socket.AddressFamily) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self._all: dict[Address, _Connection] = {}
        self._closed_count = 0
        self._logged = 0.0

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection, after making room for it."""
        sock, address = super().accept()
        for known, connection in list(self._all.items()):
            if connection.sock.fileno() < 0:
                del self._all[known]
        self._all[address[:2]] = _Connection(sock, time.monotonic())
        self._make_room(address[0])
        return sock, address

    def made(self, client: Address, abort: Callable[[], None]) -> None:
        """A connection is established. abort: closes it at once."""
        if client in self._all:
            self._all[client].abort = abort

    def served(self, client: Address) -> None:
        """A connection has sent its first request."""
        self._set_kind(client, _Kind.SERVED)

    def admitted(self, client: Address) -> None:
        """A connection has sent a valid session."""
        self._set_kind(client, _Kind.ADMITTED)

    def is_admitted(self, client: Address) -> bool:
        """Whether a connection has sent a valid session."""
        return client in self._all and self._all[client].kind is _Kind.ADMITTED

    def count(self) -> int:
        """Number of open connections."""
        return sum(connection.sock.fileno() >= 0 for connection in self._all.values())

    def _set_kind(self, client: Address, kind: _Kind) -> None:
        connection = self._all.get(client)
        if connection is not None and connection.kind is not kind:  # a repeat keeps the age
            connection.kind, connection.since = kind, time.monotonic()
            self._make_room(client[0])

    def _make_room(self, address: str) -> None:
        others = [a for a, c in self._all.items() if c.kind is not _Kind.ADMITTED]
        if not is_loopback(address):
            here = [a for a in others if a[0] == address]
            self._keep(here, MOST_OF_ONE_ADDRESS)
        for kind, limit in ((_Kind.WAITING, MOST_WAITING), (_Kind.SERVED, MOST_SERVED)):
            self._keep([a for a in others if a in self._all and self._all[a].kind is kind], limit)

    def _keep(self, clients: list[Address], limit: int) -> None:
        """Keep the newest connections and close the others."""
        if len(clients) <= limit:
            return
        for client in sorted(clients, key=lambda a: self._all[a].since)[: len(clients) - limit]:
            connection = self._all.pop(client)
            if connection.abort is not None:
                connection.abort()
            else:  # still in the handshake: the server closes what is shut down
                with contextlib.suppress(OSError):
                    connection.sock.shutdown(socket.SHUT_RDWR)
            self._closed_count += 1
        now = time.monotonic()
        if now - self._logged >= 1.0:
            self._logged = now
            _log.warning("too many connections; %d closed so far", self._closed_count)
