"""One connected station, and the bounds on what it may cost the robot."""

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


def free_number(last: int, taken: frozenset[int] | set[int]) -> int:
    """The number after `last` that nobody has, so that the numbers of who left rest for long."""
    number = last % MOST_NUMBER + 1
    while number in taken:
        number = number % MOST_NUMBER + 1
    return number
