"""The connected stations, and the limits on the load of each."""

from __future__ import annotations

import math
import socket
from collections import deque

from cohelm.link.clock import Path
from cohelm.link.dtls import Channel
from cohelm.link.listener import Guest
from cohelm.link.messages import MOST_ANSWERS, Answer, Command
from cohelm.link.operator import AHEAD
from cohelm.link.rate import TokenBucket

DATAGRAMS = 200.0
"""Of one client, processed per second: twice a stick's rate, four times a page's."""
DATAGRAM_BURST = 200.0
"""... and in a burst: four seconds of a page, after a network interruption."""
DECRYPTED = 2000.0
"""Of one client, decrypted per second; beyond `DATAGRAMS` only stops count."""
REQUESTS = 20.0
"""Of one client, executed per second, except stops."""
REQUEST_BURST = 40.0
MAX_CLIENTS = 16
MAX_CLIENTS_PER_KEY = 12
"""Clients with one certificate: the pages of one station, and a few places for others."""
MAX_CLIENT_NUMBER = 65535
"""Client numbers have two bytes; they are used again."""


class Client:
    """Known by its number while connected, by certificate and session across connections."""

    def __init__(self, number: int, guest: Guest, now: float) -> None:
        self.number = number
        self.channel: Channel = guest.channel
        self.socket: socket.socket = guest.socket
        self.address = guest.address
        self.path = Path()
        self.since = self.last = now
        self.session: int | None = None
        """None: connected, but no valid message yet."""
        self.same_as: Client | None = None
        """The client that this one is, reconnected on a new channel."""
        self.sequence = 0
        self.command: Command | None = None
        self.stamp = math.nan
        self.dropped = 0
        self.done = 0
        """Number of the last request processed."""
        self.answers: deque[Answer] = deque(maxlen=64)
        """The newest, more than its burst of requests."""
        self.awaited: frozenset[int] = frozenset()
        """Numbers of the requests that its newest command repeats: it has no answer to them yet."""
        self.told = 0
        """How many statuses have had answers that it awaits."""
        self.datagrams = TokenBucket(DATAGRAMS, DATAGRAM_BURST, now)
        self.decrypted = TokenBucket(DECRYPTED, 0.2 * DECRYPTED, now)
        self.requests = TokenBucket(REQUESTS, REQUEST_BURST, now)

    @property
    def merged(self) -> Client:
        """This client, or the one that it was found to be."""
        return self if self.same_as is None else self.same_as.merged

    @property
    def name(self) -> str:
        """As logs and reasons name it: several stations may share a certificate's name."""
        return f"{self.channel.name} ({self.number})"

    def due_answers(self) -> tuple[Answer, ...]:
        """The answers for its next status: those that it awaits, by turns where they are too many
        for one; else the newest."""
        due = [answer for answer in self.answers if answer.number in self.awaited]
        if not due:
            return tuple(self.answers)[-MOST_ANSWERS:]
        self.told += 1
        first = (self.told - 1) * MOST_ANSWERS % len(due)
        return tuple((due + due)[first : first + min(MOST_ANSWERS, len(due))])

    def in_time(self, stamp: float, now: float, life: float) -> bool:
        """Whether a stamp's worst-case age is at most `life` [s], and it is not from the future."""
        return -AHEAD <= self.path.age(stamp, now) and self.path.max_age(stamp, now) <= life


class Clients(dict[int, Client]):
    """The connected clients, by number."""

    last = 0
    """The last number assigned."""

    def add(self, guest: Guest, now: float) -> Client:
        """Add a new client."""
        self.last = free_number(self.last, set(self))
        client = self[self.last] = Client(self.last, guest, now)
        return client

    def identified(self) -> list[Client]:
        """Clients that have sent a valid message."""
        return [client for client in self.values() if client.session is not None]

    def find(self, fingerprint: str, session: int) -> Client | None:
        """The client with this certificate and session."""
        for client in self.values():
            if client.session == session and client.channel.peer == fingerprint:
                return client
        return None

    def crowded_by(self, new: Client) -> list[Client]:
        """The clients of which one must leave to make room for a new one; empty: there is room."""
        others = self.identified()
        same = [client for client in others if client.channel.peer == new.channel.peer]
        if len(same) >= MAX_CLIENTS_PER_KEY:
            return same
        return others if len(others) >= MAX_CLIENTS else []

    def merge(self, old: Client, new: Client) -> None:
        """A client has reconnected: it keeps its identity, with the new channel."""
        old.socket.close()
        old.channel, old.socket, old.address = new.channel, new.socket, new.address
        del self[new.number]
        new.same_as = old

    def max_age(self, number: int, stamp: float, now: float) -> float:
        """Upper bound of a stamp's age [s]; NaN: the client has left."""
        client = self.get(number)
        return math.nan if client is None else client.path.max_age(stamp, now)

    def name(self, number: int) -> str:
        """The name in its certificate; empty if it is not connected."""
        client = self.get(number)
        return client.channel.name if client else ""


def free_number(last: int, taken: frozenset[int] | set[int]) -> int:
    """The next free number after `last`, so that numbers are reused late."""
    number = last % MAX_CLIENT_NUMBER + 1
    while number in taken:
        number = number % MAX_CLIENT_NUMBER + 1
    return number
