"""The robot's end of the link: several stations, one driver.

A thread of its own moves the datagrams. The control loop talks to it through newest-wins slots
and never waits: `tell` what is, `heard` what the driver wants. What is older than `STALE` is not
there any more, neither when it arrives nor when it is asked for; nothing is queued.
"""

from __future__ import annotations

import logging
import math
import secrets
import select
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable

from cohelm.link import lease, udp
from cohelm.link.clock import Path
from cohelm.link.codec import Malformed
from cohelm.link.door import Door, Guest
from cohelm.link.dtls import Channel, Refused, context
from cohelm.link.heard import Asked, Heard
from cohelm.link.keys import Keys
from cohelm.link.messages import Answer, Ask, Command, Discs, Lease, Request, ScanPart, Status
from cohelm.link.turning import Turning
from cohelm.link.wire import Header, encode, from_operator

STALE = 0.25
"""An older command is not used [s]."""
AHEAD = 0.05
"""A command that seems to come from further ahead than this is not used either [s]."""
REQUEST_LIFE = 1.0
"""A request asked longer ago is refused, but for a stop [s]."""
SILENT = 2.0
"""Of whom nothing was heard for so long, the lease can be taken without asking [s]."""
FORGOTTEN = 30.0
"""... and it is let go for good, its lease too [s]."""
MOST_CLIENTS = 16
_PER_TURN = 64
_log = logging.getLogger("cohelm.link")

_FOR_ALL = frozenset({Ask.STOP, Ask.ACKNOWLEDGE})
_OF_LEASE = frozenset({Ask.TAKE, Ask.GIVE, Ask.REFUSE})


class _Client:
    """One station that is let in."""

    def __init__(self, number: int, guest: Guest, now: float) -> None:
        self.number = number
        self.channel: Channel = guest.channel
        self.socket: socket.socket = guest.socket
        self.address = guest.address
        self.path = Path()
        self.since = self.last = now
        self.session: int | None = None
        self.sequence = 0
        self.command: Command | None = None
        self.stamp = math.nan
        self.used_age = math.nan
        self.dropped = 0
        self.complained = -math.inf
        self.done = 0
        """Number of the last request that was looked at."""
        self.answers: deque[Answer] = deque(maxlen=3)


class RobotEnd(Turning):
    """Listens as long as it is open; a context manager."""

    def __init__(
        self, keys: Keys, host: str = "0.0.0.0", port: int = udp.PORT,
        clock: Callable[[], float] = time.monotonic, stale: float = STALE,
    ) -> None:  # fmt: skip
        """host, port: where to listen; port 0 takes a free one. stale: an older command is not
        used [s]. Raises CohelmError."""
        self.clock, self._stale = clock, stale
        self._door = Door(context(keys, server=True), host, port, clock)
        self.address = self._door.address
        self._session = secrets.randbits(64)
        super().__init__("link robot")
        self._lock = threading.RLock()
        self._clients: dict[int, _Client] = {}
        self._held = lease.Held()
        self._term = 0
        self._given_at = -math.inf
        """When the lease came to the driver otherwise than by his own asking just then [s]."""
        self._numbers: dict[tuple[str, int], int] = {}
        self._asked: deque[Asked] = deque(maxlen=256)
        self._outbox: dict[object, Status | ScanPart | Discs] = {}
        self.counts: Counter[str] = Counter()
        """Messages that were not used, by reason; `door_counts` has those not let in."""
        self._start()

    # ---- for the loop ------------------------------------------------------------------

    def heard(self) -> Heard:
        """What the driver wants now. Each request is handed out once."""
        now = self.clock()
        with self._lock:
            asked = tuple(a._replace(age=self._oldest(a, now)) for a in self._asked)
            self._asked.clear()
            client = self._clients.get(self._held.driver)
            if client is None:
                return Heard(self._held.driver, self._name(self._held.driver), None, math.nan,
                             math.nan, asked, self._term)  # fmt: skip
            age = client.path.age(client.stamp, now)
            fresh = client.command is not None and -AHEAD <= age <= self._stale
            if fresh:
                client.used_age = age
            return Heard(
                client.number, client.channel.name, client.command if fresh else None, age,
                client.path.round_trip, asked, self._term,
            )  # fmt: skip

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Say what became of a request."""
        with self._lock:
            to = self._clients.get(client)
            if to is not None:
                to.answers.append(Answer(number, granted, reason))

    def tell(self, status: Status) -> None:
        """Send this to all clients now; one not sent yet is forgotten.

        `lease`, `answers` and the link's part of `timing` are filled in here, for each client.
        """
        self._put(Status, status)

    def show(self, *parts: ScanPart | Discs) -> None:
        """Send the parts of a scan, or the discs; older ones not sent yet are forgotten."""
        for part in parts:
            self._put((type(part), part.start if isinstance(part, ScanPart) else 0), part)

    def clients(self) -> dict[int, str]:
        """Who is connected: names by number."""
        with self._lock:
            return {number: client.channel.name for number, client in self._clients.items()}

    def client_of(self, fingerprint: str, session: int) -> int | None:
        """The number of a connected client, by its certificate and session."""
        with self._lock:
            number = self._numbers.get((fingerprint, session))
            return number if number in self._clients else None

    @property
    def driver(self) -> int:
        """The driver's number; 0: nobody."""
        return self._held.driver

    @property
    def door_counts(self) -> Counter[str]:
        """Who was not let in, by reason."""
        return self._door.counts

    def round_trips(self) -> dict[int, tuple[float, float]]:
        """Newest and shortest round trip of each client [s]."""
        with self._lock:
            return {n: (c.path.round_trip, c.path.shortest) for n, c in self._clients.items()}

    # ---- the thread --------------------------------------------------------------------

    def _put(self, slot: object, message: Status | ScanPart | Discs) -> None:
        with self._lock:
            self._outbox[slot] = message
        self._bell.ring()

    def _mistaken(self) -> None:
        self.counts["mistakes of the link"] += 1

    def _let_go(self) -> None:
        for client in list(self._clients.values()):
            udp.send(client.socket, client.channel.close())
            client.socket.close()
        self._clients.clear()
        self._door.close()

    def _turn(self) -> None:
        sockets = [client.socket for client in self._clients.values()]
        handshakes = self._door.sockets()
        wait = 0.1 if len(handshakes) == 1 else 0.02
        waiting = select.poll()
        for source in (self._bell, *sockets, *handshakes):
            waiting.register(source, select.POLLIN)
        waiting.poll(wait * 1000.0)
        self._bell.silence()
        self._send()
        for client in list(self._clients.values()):
            for datagram, source in udp.receive(client.socket, _PER_TURN):
                if source[:2] == client.address[:2]:
                    self._datagram(client, datagram)
        for guest in self._door.turn(full=len(self._clients) >= MOST_CLIENTS):
            self._welcome(guest)
        self._time_passes(self.clock())

    def _time_passes(self, now: float) -> None:
        """Who does not answer loses the lease; who is not heard is forgotten."""
        with self._lock:
            held = lease.later(self._held, now)
            if held != self._held:
                self._lease(held, "the driver did not answer")
        for client in list(self._clients.values()):
            if now - client.last > FORGOTTEN:
                self._leave(client, "nothing heard any more")

    def _welcome(self, guest: Guest) -> None:
        with self._lock:
            number = max([0, *self._clients, *self._numbers.values()]) + 1
            client = _Client(number, guest, self.clock())
            self._clients[number] = client
        _log.info("%s is connected from %s", guest.channel.name, guest.address[0])
        for message in guest.first:
            self._message(client, message)

    def _datagram(self, client: _Client, datagram: bytes) -> None:
        try:
            messages = client.channel.take(datagram)
        except Refused as refused:
            self._leave(client, str(refused))
            return
        for message in messages:
            if client.number in self._clients:
                self._message(client, message)

    def _message(self, client: _Client, data: bytes) -> None:
        try:
            header, message = from_operator(data)
        except Malformed as malformed:
            self._not_used(client, "malformed")
            now = self.clock()
            if now - client.complained >= 1.0:
                client.complained = now
                _log.warning("from %s: %s", client.channel.name, malformed)
            return
        if not isinstance(message, Command):  # datagrams up are nothing else
            return
        now = self.clock()
        with self._lock:
            client = self._known(client, header)
            client.last = now
            if not client.path.heard(header, now):
                self._not_used(client, "out of order")
                return self._requests(client, message, now, stops_only=True)
            age = client.path.age(header.stamp, now)
            if not -AHEAD <= age <= self._stale:  # NaN too: the clocks are not compared yet
                self._not_used(client, "clocks not compared" if math.isnan(age) else "too old")
                return self._requests(client, message, now, stops_only=True)
            client.command, client.stamp = message, header.stamp
            self._requests(client, message, now, stops_only=False)

    def _known(self, client: _Client, header: Header) -> _Client:
        """The client by its session: who comes again, on a new channel, is who it was."""
        if client.session == header.session:
            return client
        key = (client.channel.peer, header.session)
        number = self._numbers.get(key)
        old = self._clients.get(number) if number is not None else None
        if old is not None and old is not client:
            old.socket.close()
            old.channel, old.socket, old.address = client.channel, client.socket, client.address
            del self._clients[client.number]
            return old
        if client.session is not None:  # a new session on the same channel: all begins anew
            client.done, client.command = 0, None
        client.session = header.session
        self._numbers[key] = client.number
        while len(self._numbers) > 8 * MOST_CLIENTS:
            del self._numbers[next(iter(self._numbers))]
        return client

    def _not_used(self, client: _Client, why: str) -> None:
        client.dropped += 1
        self.counts[why] += 1

    def _requests(self, client: _Client, command: Command, now: float, stops_only: bool) -> None:
        """Take each request once, in order; of a command that is not used, only a stop."""
        for request in command.requests:
            stop = request.what is Ask.STOP
            if request.number <= client.done or (stops_only and not stop):
                continue
            client.done = request.number
            if not stop and not -AHEAD <= client.path.age(request.made, now) <= REQUEST_LIFE:
                self.answer(client.number, request.number, False, "it came too late")
            elif request.what in _OF_LEASE:
                self._lease_request(client, request, now)
            elif request.what not in _FOR_ALL and self._held.driver != client.number:
                self.answer(client.number, request.number, False, "you do not drive")
            elif request.what not in _FOR_ALL and self._before_lease(client, request, now):
                self.answer(client.number, request.number, False, "you did not drive yet")
            else:
                self._asked.append(Asked(client.number, client.channel.name, request))

    def _lease_request(self, client: _Client, request: Request, now: float) -> None:
        held = self._held
        if request.what is Ask.TAKE:
            driver = self._clients.get(held.driver)
            silent = driver is None or now - driver.last > SILENT
            said = lease.take(held, client.number, now, silent)
        elif request.what is Ask.GIVE:
            said = lease.give(held, client.number, request.value, frozenset(self._clients))
        else:
            said = lease.refuse(held, client.number)
        self.answer(client.number, request.number, said.granted, said.reason)
        taken = request.what is Ask.TAKE
        self._lease(said.held, f"asked by {client.channel.name}", taken=taken)

    def _oldest(self, asked: Asked, now: float) -> float:
        """How long ago something was asked for at most [s]; NaN: who asked is gone."""
        client = self._clients.get(asked.client)
        if client is None:
            return math.nan
        return client.path.age(asked.request.made, now) + 0.5 * client.path.shortest

    def _before_lease(self, client: _Client, request: Request, now: float) -> bool:
        """Whether it was made before the driver could know that he drives."""
        return now - client.path.age(request.made, now) < self._given_at

    def _lease(self, held: lease.Held, why: str, taken: bool = False, lost: bool = False) -> None:
        """taken: the new driver has asked just now. lost: the old one is gone."""
        if held.driver != self._held.driver:
            _log.info("%s drives now: %s", self._name(held.driver) or "nobody", why)
            self._given_at = -math.inf if taken else self.clock()
            if not (lost and held.driver == lease.NOBODY):
                self._term += 1
            self._withdraw(self._held.driver)
            new = self._clients.get(held.driver)
            if new is not None:
                new.command = None  # what it wanted before it drove counts for nothing
        self._held = held

    def _withdraw(self, driver: int) -> None:
        """What somebody asked for as the driver, and the loop has not done, it shall not do."""
        for asked in [a for a in self._asked if a.client == driver]:
            if asked.request.what not in _FOR_ALL:
                self._asked.remove(asked)
                self.answer(driver, asked.request.number, False, "you do not drive any more")

    def _name(self, number: int) -> str:
        client = self._clients.get(number)
        return client.channel.name if client else ""

    def _leave(self, client: _Client, why: str) -> None:
        _log.info("%s left: %s", client.channel.name, why)
        with self._lock:
            self._clients.pop(client.number, None)
            client.socket.close()
            self._lease(lease.gone(self._held, client.number), why, lost=True)

    def _send(self) -> None:
        with self._lock:
            outbox, self._outbox = self._outbox, {}
            clients = list(self._clients.values())
        for message in outbox.values():
            for client in clients:
                self._send_to(client, message)

    def _send_to(self, client: _Client, message: Status | ScanPart | Discs) -> None:
        now = self.clock()
        if isinstance(message, Status):
            message = self._completed(client, message)
        client.sequence += 1
        echo, hold = client.path.echo(now)
        try:
            data = encode(Header(self._session, client.sequence, now, echo, hold), message)
            datagrams = client.channel.seal(data)
        except ValueError as error:
            self.counts["could not be sent"] += 1
            _log.error("a %s can not be sent: %s", type(message).__name__, error)
            return
        except Refused as refused:
            self._leave(client, str(refused))
            return
        udp.send(client.socket, datagrams)

    def _completed(self, client: _Client, status: Status) -> Status:
        with self._lock:
            held = self._held
            path = client.path
            return status._replace(
                lease=Lease(
                    client.number, held.driver, self._name(held.driver), held.asking,
                    self._name(held.asking), held.until - self.clock(),
                ),
                answers=tuple(client.answers),
                timing=status.timing._replace(
                    command_age=client.used_age, round_trip=path.round_trip, lost=path.lost,
                    dropped=client.dropped,
                ),
            )  # fmt: skip
