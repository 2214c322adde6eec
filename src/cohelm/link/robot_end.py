"""The robot's end of the link: several stations, one driver.

An I/O thread moves the datagrams. The control loop exchanges the newest status and command with it
and never waits. A command that is older than `STALE` at its arrival is not used; later the loop
judges it by its age. Only requests are queued, few of each client; stops are kept apart, and the
cost of each client is bounded (`client`), so that none delays another.
"""

from __future__ import annotations

import logging
import math
import secrets
import select
import threading
import time
from collections import Counter
from collections.abc import Callable

from cohelm.link import lease, udp
from cohelm.link.client import Client, Clients
from cohelm.link.codec import Malformed
from cohelm.link.dtls import HandshakeRefused, context
from cohelm.link.io_thread import IoThread
from cohelm.link.keys import Keys
from cohelm.link.listener import Guest, Listener
from cohelm.link.messages import (
    Answer,
    Discs,
    Lease,
    Request,
    RequestKind,
    ScanPart,
    Status,
    Uplink,
)
from cohelm.link.operator import STALE, ClientRequest, OperatorInput
from cohelm.link.pending import FOR_ANYONE, Pending
from cohelm.link.rate import Coalesced
from cohelm.link.wire import Header, encode, from_operator, may_stop

REQUEST_LIFE = 1.0
"""Age above which a request is refused, except a stop [s]."""
PATH_LIFE = 5.0
"""Age above which waypoints to follow are refused [s]: a stream delivers late what it has lost."""
TAKEOVER_AFTER = 2.0
"""The lease of a driver that is silent for longer is handed over without an answer [s]."""
CLIENT_TIMEOUT = 30.0
"""A client that is silent for longer is removed, and loses the lease [s]."""
_MAX_UNIDENTIFIED = 8
"""Clients without a valid message yet; a further one replaces the oldest."""
_UNIDENTIFIED = 5.0  # such a client is removed after this [s]
_PER_TURN = 64
_log = logging.getLogger("cohelm.link")

_LEASE_REQUESTS = frozenset({RequestKind.TAKE, RequestKind.GIVE, RequestKind.REFUSE})


class RobotEnd(IoThread):
    """Listens as long as it is open; a context manager."""

    def __init__(
        self, keys: Keys, host: str = "0.0.0.0", port: int = udp.PORT,
        clock: Callable[[], float] = time.monotonic, stale: float = STALE,
    ) -> None:  # fmt: skip
        """host, port: where to listen; port 0 takes a free one. stale: a command that is older at
        its arrival is not used [s]. Raises CohelmError."""
        self.clock, self._stale = clock, stale
        self._listener = Listener(context(keys, server=True), host, port, clock)
        self.address = self._listener.address
        self._session = secrets.randbits(64)
        super().__init__("link robot")
        self._lock = threading.RLock()
        self._clients = Clients()
        self._held = lease.LeaseState()
        self._term = 0
        self._given_at = -math.inf
        """When the driver got the lease other than by a request granted at once [s]."""
        self._pending = Pending()
        self._lines = Coalesced()
        self._outbox: dict[object, Status | ScanPart | Discs] = {}
        self.record: Callable[[bool], str] = lambda on: "this robot does not record"
        """Starts or ends a record, as the driver requests; returns why not, or ""."""
        self.counts: Counter[str] = Counter()
        """Messages that were not used, by reason."""
        self._start()

    # ---- for the loop ------------------------------------------------------------------

    def receive(self) -> OperatorInput:
        """The driver's newest input. Each request is returned once, stops first."""
        now = self.clock()
        with self._lock:
            taken = self._pending.take()
            requests = tuple(
                a._replace(age=self._clients.max_age(a.client, a.request.made, now)) for a in taken
            )
            client = self._clients.get(self._held.driver)
            if client is None:
                return OperatorInput(
                    self._held.driver, "", None, math.nan, math.nan, requests, self._term
                )
            age = client.path.max_age(client.stamp, now)
            return OperatorInput(
                client.number, client.channel.name, client.command, age, client.path.round_trip,
                requests, self._term,
            )  # fmt: skip

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Send the result of a request."""
        with self._lock:
            to = self._clients.get(client)
            if to is not None:
                to.answers.append(Answer(number, granted, reason))

    def send_status(self, status: Status) -> None:
        """Send this to all clients now; it replaces one not sent yet.

        `lease`, `answers` and the link's part of `timing` are filled in here, for each client.
        """
        self._put(Status, status)

    def show(self, *parts: ScanPart | Discs) -> None:
        """Send the parts of a scan, or the discs; they replace older ones not sent yet."""
        for part in parts:
            which = (part.lidar, part.start) if isinstance(part, ScanPart) else 0
            self._put((type(part), which), part)

    def client_of(self, fingerprint: str, session: int) -> int | None:
        """The number of a connected client, by its certificate and session."""
        with self._lock:
            client = self._clients.find(fingerprint, session)
            return None if client is None else client.number

    def path_refusal(self, number: int | None, made: float) -> str:
        """Why a client may not send waypoints to follow; empty: it may. made: when it sent them, by
        its clock [s]."""
        now = self.clock()
        with self._lock:
            client = self._clients.get(number or lease.NO_DRIVER)
            if client is None or number != self._held.driver:
                return "you are not the driver"
            if not client.in_time(made, now, PATH_LIFE):
                return "the waypoints are too old: send them again"
            return "you were not the driver yet" if self._before_lease(client, made, now) else ""

    @property
    def driver(self) -> int:
        """The driver's number; 0: none."""
        return self._held.driver

    def round_trips(self) -> dict[int, tuple[float, float]]:
        """Newest and shortest round trip of each client [s]."""
        with self._lock:
            return {n: (c.path.round_trip, c.path.shortest) for n, c in self._clients.items()}

    # ---- the thread --------------------------------------------------------------------

    def _put(self, slot: object, message: Status | ScanPart | Discs) -> None:
        with self._lock:
            self._outbox[slot] = message
        self._waker.wake()

    def _on_error(self) -> None:
        self.counts["mistakes of the link"] += 1

    def _close_all(self) -> None:
        for client in list(self._clients.values()):
            udp.send(client.socket, client.channel.close())
            client.socket.close()
        self._clients.clear()
        self._listener.close()

    def _poll_once(self) -> None:
        sockets = [client.socket for client in self._clients.values()]
        handshakes = self._listener.sockets()
        wait = 0.1 if len(handshakes) == 1 else 0.02
        waiting = select.poll()
        for source in (self._waker, *sockets, *handshakes):
            waiting.register(source, select.POLLIN)
        waiting.poll(wait * 1000.0)
        self._waker.drain()
        self._send()
        for client in list(self._clients.values()):
            for datagram, source in udp.receive(client.socket, _PER_TURN):
                if source[:2] != client.address[:2]:
                    continue
                if client.decrypted.take(self.clock()):
                    self._datagram(client, datagram)
                else:
                    self._not_used(client, "a flood")
        for guest in self._listener.turn():
            self._admit(guest)
        self._expire(self.clock())

    def _expire(self, now: float) -> None:
        """Time-outs of lease requests and of silent clients."""
        with self._lock:
            requester = self._clients.get(self._held.requester)
            if requester is not None and now - requester.last > TAKEOVER_AFTER:
                self._held = lease.without(self._held, requester.number)
            held = lease.expired(self._held, now)
            if held != self._held:
                self._lease(held, "the driver did not answer")
        for client in list(self._clients.values()):
            most = _UNIDENTIFIED if client.session is None else CLIENT_TIMEOUT
            if now - client.last > most:
                self._remove(client, "timed out")
        for line in self._lines.due(now):
            _log.info("%s", line)

    def _admit(self, guest: Guest) -> None:
        with self._lock:
            unidentified = [c for c in self._clients.values() if c.session is None]
            if len(unidentified) >= _MAX_UNIDENTIFIED:
                self._remove(unidentified[0], "replaced by newer connections")
            client = self._clients.add(guest, self.clock())
        self._log_line(client, f"{client.name} is connected from {guest.address[0]}")
        for message in guest.first:
            self._message(client, message)

    def _datagram(self, client: Client, datagram: bytes) -> None:
        client = client.merged
        try:
            messages = client.channel.take(datagram)
        except HandshakeRefused as refused:
            self._remove(client, str(refused))
            return
        for message in messages:
            self._message(client, message)

    def _message(self, client: Client, data: bytes) -> None:
        client, now = client.merged, self.clock()
        if client.number not in self._clients:
            return
        too_many = not client.datagrams.take(now)
        if too_many:
            self._not_used(client, "too many")
            if not may_stop(data):
                return
        try:
            header, message = from_operator(data)
        except Malformed as malformed:
            self._not_used(client, "malformed")
            self._log_line(
                client, f"invalid message from {client.name}: {malformed}", logging.WARNING
            )
            return
        if not isinstance(message, Uplink):  # datagrams up are nothing else
            return
        with self._lock:
            known = self._known(client, header, now)
            if known is None:
                return self._requests(client, message, now, stops_only=True)
            client = known
            client.last = now
            if too_many:
                return self._requests(client, message, now, stops_only=True)
            if not client.path.update(header, now):
                self._not_used(client, "out of order")
                return self._requests(client, message, now, stops_only=True)
            if not client.in_time(header.stamp, now, self._stale):
                unknown = math.isnan(client.path.offset)
                self._not_used(client, "clocks not compared" if unknown else "too old")
                return self._requests(client, message, now, stops_only=True)
            client.command, client.stamp = message.command, header.stamp
            client.awaited = frozenset(request.number for request in message.requests)
            self._requests(client, message, now, stops_only=False)

    def _known(self, client: Client, header: Header, now: float) -> Client | None:
        """The client by its session: one that reconnects on a new channel keeps its identity. None:
        there are too many clients."""
        if client.session == header.session:
            return client
        old = self._clients.find(client.channel.peer, header.session)
        if old is not None:
            self._clients.merge(old, client)
            return old
        if client.session is None and not self._make_room(client, now):
            self._listener.refuse(client.address, "too many clients")
            self._remove(client, "too many clients")
            return None
        if client.session is not None:  # a new session on the same channel starts afresh
            client.done, client.command = 0, None
            client.answers.clear()
        client.session = header.session
        return client

    def _make_room(self, client: Client, now: float) -> bool:
        """Whether there is room for a new client, if need be in place of a silent one."""
        crowd = self._clients.crowded_by(client)
        silent = [
            c for c in crowd if c.number != self._held.driver and now - c.last > TAKEOVER_AFTER
        ]
        if silent:
            self._remove(min(silent, key=lambda c: c.last), "replaced by another client")
        return not crowd or bool(silent)

    def _not_used(self, client: Client, why: str) -> None:
        client.dropped += 1
        self.counts[why] += 1

    def _requests(self, client: Client, message: Uplink, now: float, stops_only: bool) -> None:
        """Take each request once, in order; of a command that is not used, only a stop."""
        for request in message.requests:
            stop = request.what is RequestKind.STOP
            if request.number <= client.done or (stops_only and not stop):
                continue
            client.done = request.number
            pending = ClientRequest(client.number, client.name, request)
            refused = ""
            if stop:
                for off in self._pending.stop(pending):
                    self.answer(
                        off.client, off.request.number, False, f"{client.name} pressed stop"
                    )
            elif not client.requests.take(now):
                refused = "too many requests: wait a second"
            elif not client.in_time(request.made, now, REQUEST_LIFE):
                refused = "the request is too old"
            elif request.what in _LEASE_REQUESTS:
                self._lease_request(client, request, now)
            elif request.what not in FOR_ANYONE and self._held.driver != client.number:
                refused = "you are not the driver"
            elif request.what not in FOR_ANYONE and self._before_lease(client, request.made, now):
                refused = "you were not the driver yet"
            elif not self._pending.add(pending):
                refused = "too many requests: wait for their answers"
            if refused:
                self.answer(client.number, request.number, False, refused)

    def _lease_request(self, client: Client, request: Request, now: float) -> None:
        held = self._held
        if request.what is RequestKind.TAKE:
            silent = self._silent(held.driver, now)
            outcome = lease.take(held, client.number, now, silent)
        elif request.what is RequestKind.GIVE:
            outcome = lease.give(held, client.number, request.value, frozenset(self._clients))
        else:
            outcome = lease.refuse(held, client.number)
        self.answer(client.number, request.number, outcome.granted, outcome.reason)
        taken = request.what is RequestKind.TAKE
        self._lease(outcome.held, f"requested by {client.name}", taken=taken)

    def _silent(self, driver: int, now: float) -> bool:
        """Whether the driver is not waited for."""
        client = self._clients.get(driver)
        return client is None or now - client.last > TAKEOVER_AFTER

    def _before_lease(self, client: Client, made: float, now: float) -> bool:
        """Whether that was before the client could know that it is the driver. made: by its clock
        [s]."""
        return now - client.path.age(made, now) < self._given_at

    def _lease(
        self, held: lease.LeaseState, why: str, taken: bool = False, lost: bool = False
    ) -> None:
        """taken: the new driver has requested it just now. lost: the old one has disconnected."""
        if held.driver != self._held.driver:
            self._given_at = -math.inf if taken else self.clock()
            if not (lost and held.driver == lease.NO_DRIVER):
                self._term += 1
            old = self._held.driver  # its requests that the loop has not executed are withdrawn
            for withdrawn in self._pending.withdraw(old):
                self.answer(old, withdrawn.request.number, False, "you are no longer the driver")
            new = self._clients.get(held.driver)
            who = "no client" if new is None else new.name
            self._log_line(None, f"{who} is the driver: {why}")
            if new is not None:
                new.command = None  # its commands from before it was the driver do not count
        self._held = held

    def _log_line(self, about: Client | None, text: str, level: int = logging.INFO) -> None:
        """Log it; of the clients with one certificate, at most one line of a kind per second."""
        kind = text.partition(":")[0].replace(f" ({about.number})" if about else "", "")
        for line in self._lines.add(self.clock(), (kind, level), text):
            _log.log(level, "%s", line)

    def _remove(self, client: Client, why: str) -> None:
        self._log_line(client, f"{client.name} left: {why}")
        with self._lock:
            self._clients.pop(client.number, None)
            client.socket.close()
            self._lease(lease.without(self._held, client.number), why, lost=True)

    def _send(self) -> None:
        with self._lock:
            outbox, self._outbox = self._outbox, {}
            clients = list(self._clients.values())
        for message in outbox.values():
            for client in clients:
                self._send_to(client, message)

    def _send_to(self, client: Client, message: Status | ScanPart | Discs) -> None:
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
        except HandshakeRefused as refused:
            self._remove(client, str(refused))
            return
        udp.send(client.socket, datagrams)

    def _completed(self, client: Client, status: Status) -> Status:
        with self._lock:
            held, now = self._held, self.clock()
            path = client.path
            gone = held.driver != lease.NO_DRIVER and self._silent(held.driver, now)
            return status._replace(
                lease=Lease(
                    client.number, held.driver, self._clients.name(held.driver), held.requester,
                    self._clients.name(held.requester), 0.0 if gone else held.until - now,
                ),
                answers=client.due_answers(),
                timing=status.timing._replace(
                    command_age=status.timing.command_age if held.driver == client.number
                    else math.nan,
                    round_trip=path.round_trip, lost=path.lost, dropped=client.dropped,
                ),
            )  # fmt: skip
