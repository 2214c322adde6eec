"""The connected stations, and the bounds on what each may cost the robot."""

from __future__ import annotations

import math
import socket
from collections import deque

from cohelm.link.clock import Path
from cohelm.link.dtls import Channel
from cohelm.link.listener import Guest
from cohelm.link.messages import Answer, Command
from cohelm.link.rate import TokenBucket

DATAGRAMS = 200.0
"""Of one client, heard per second: twice what a stick sends, four times what a page does."""
AT_ONCE = 200.0
"""... and at once: four seconds of a page, as a network delivers them that hoarded."""
LOOKED_AT = 2000.0
"""Of one client, decrypted per second; of those beyond `DATAGRAMS`, only a stop is heard."""
REQUESTS = 20.0
"""Of one client, done per second, but for stops: as often as a command comes by, nearly."""
REQUESTS_AT_ONCE = 40.0
AHEAD = 0.05
"""What seems to come from further ahead than this is not used [s]."""
MOST_CLIENTS = 16
MOST_OF_ONE_KEY = 12
"""Clients with one certificate: the pages of one station, and a few places for others."""
MOST_NUMBER = 65535
"""Client numbers have two bytes; they are used again."""


class Client:
    """Known by its number while it is connected, and by certificate and session beyond that."""

    def __init__(self, number: int, guest: Guest, now: float) -> None:
        self.number = number
        self.channel: Channel = guest.channel
        self.socket: socket.socket = guest.socket
        self.address = guest.address
        self.path = Path()
        self.since = self.last = now
        self.session: int | None = None
        """None: let in, but nothing that makes sense was heard of it yet."""
        self.same_as: Client | None = None
        """Who this turned out to be: a client that came again on a new channel."""
        self.sequence = 0
        self.command: Command | None = None
        self.stamp = math.nan
        self.used_age = math.nan
        self.dropped = 0
        self.done = 0
        """Number of the last request that was looked at."""
        self.answers: deque[Answer] = deque(maxlen=3)
        self.datagrams = TokenBucket(DATAGRAMS, AT_ONCE, now)
        self.looked_at = TokenBucket(LOOKED_AT, 0.2 * LOOKED_AT, now)
        self.requests = TokenBucket(REQUESTS, REQUESTS_AT_ONCE, now)

    @property
    def name(self) -> str:
        """As logs and reasons name it: several stations may share a certificate's name."""
        return f"{self.channel.name} ({self.number})"

    def in_time(self, stamp: float, now: float, life: float) -> bool:
        """Whether what it stamped is younger than `life` [s] even in the worst case, and not from
        the future."""
        return -AHEAD <= self.path.age(stamp, now) and self.path.oldest(stamp, now) <= life


class Clients(dict[int, Client]):
    """Who is connected, by number."""

    last = 0
    """The number given last."""

    def welcome(self, guest: Guest, now: float) -> Client:
        """A client of its own for who was let in."""
        self.last = free_number(self.last, set(self))
        client = self[self.last] = Client(self.last, guest, now)
        return client

    def heard(self) -> list[Client]:
        """Those of whom something that makes sense was heard."""
        return [client for client in self.values() if client.session is not None]

    def found(self, fingerprint: str, session: int) -> Client | None:
        """Who has this certificate and session."""
        for client in self.values():
            if client.session == session and client.channel.peer == fingerprint:
                return client
        return None

    def crowd(self, new: Client) -> list[Client]:
        """Of whom one has to go before there is a place for a new one; nobody: there is one."""
        others = self.heard()
        same = [client for client in others if client.channel.peer == new.channel.peer]
        if len(same) >= MOST_OF_ONE_KEY:
            return same
        return others if len(others) >= MOST_CLIENTS else []

    def reunite(self, old: Client, new: Client) -> None:
        """One came again on a new channel: it goes on as who it was, with that channel."""
        old.socket.close()
        old.channel, old.socket, old.address = new.channel, new.socket, new.address
        del self[new.number]
        new.same_as = old

    def oldest(self, number: int, stamp: float, now: float) -> float:
        """How long ago at most a client stamped something [s]; NaN: it is gone."""
        client = self.get(number)
        return math.nan if client is None else client.path.oldest(stamp, now)

    def name(self, number: int) -> str:
        """By its certificate; empty for who is not there."""
        client = self.get(number)
        return client.channel.name if client else ""


def free_number(last: int, taken: frozenset[int] | set[int]) -> int:
    """The number after `last` that nobody has, so that the numbers of who left rest for long."""
    number = last % MOST_NUMBER + 1
    while number in taken:
        number = number % MOST_NUMBER + 1
    return number
