"""The station's end of the link: one robot.

An I/O thread moves the datagrams, and reconnects by itself. `steer` sends at once, and must be
called periodically: a deflection is repeated until it is lost, and then "no stick" is sent, so that
a station without its browser does not look alive.
"""

from __future__ import annotations

import logging
import math
import secrets
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from cohelm.core.types import CENTRED
from cohelm.link import udp
from cohelm.link.bulk_messages import FromRobot
from cohelm.link.clock import Path
from cohelm.link.codec import Malformed
from cohelm.link.dtls import Channel, HandshakeRefused, context
from cohelm.link.io_thread import IoThread
from cohelm.link.keys import Keys
from cohelm.link.messages import (
    NO_STICK,
    Answer,
    Command,
    Discs,
    Request,
    RequestKind,
    ScanPart,
    Status,
    Uplink,
)
from cohelm.link.scans import Scans
from cohelm.link.wire import Header, encode, from_robot

FRESH = 0.1
"""Without `steer` for this long a stick of this process is lost [s]."""
_BEAT = 0.05  # [s], between messages when there is nothing to say
_LOST = 2.0  # [s], of silence, until a new connection is tried beside the old one
_PATIENCE = 5.0  # [s], for a handshake without any answer
_ANSWERED = 2.0
"""... to which something was said, beside three round trips [s]. What was damaged on the way may be
past mending: then the other end repeats itself in vain."""
_REQUEST_LIFE = 1.0  # [s]; a stop lives until it is answered
_PER_TURN = 64
M = TypeVar("M", covariant=True)
_log = logging.getLogger("cohelm.link")


class StampedMessage(NamedTuple, Generic[M]):
    """A message from the robot."""

    message: M
    stamp: float
    """The robot's clock when it was true [s]."""
    age: float
    """How long ago that was [s]; NaN: not known."""


class LinkState(NamedTuple):
    """State of the link; NaN for what is not known."""

    connected: bool
    name: str
    """The robot's address."""
    why: str
    """Why it is not connected; empty while it is."""
    round_trip: float = math.nan
    """[s]"""
    lost: float = math.nan
    """Share of the robot's datagrams lost in the last seconds."""
    offset: float = math.nan
    """The robot's clock less this one [s]."""


class _Connection:
    """A socket and a channel to the robot, up or on its way up."""

    def __init__(self, channel: Channel, family: int, to: udp.Address, since: float) -> None:
        self.channel = channel
        self.since = since
        self.answered = math.inf
        """Time of the robot's first answer to it."""
        self.socket: socket.socket = udp.opened(family)
        self.socket.connect(to)

    @property
    def patience(self) -> float:
        """For how long a handshake may take [s]."""
        return min(_PATIENCE, _ANSWERED + 3.0 * (self.answered - self.since))


class StationEnd(IoThread):
    """Keeps connected as long as it is open; a context manager."""

    def __init__(
        self, keys: Keys, host: str, port: int = udp.PORT,
        clock: Callable[[], float] = time.monotonic, speaks_for: float = math.inf,
    ) -> None:  # fmt: skip
        """speaks_for: so long after the last `steer` it says that there is no stick, and then
        nothing but requests: to the robot its driver has gone, in automatic mode too [s].

        Raises CohelmError where there is no such host; else it tries for ever.
        """
        self.clock, self._name = clock, f"{host}:{port}"
        self._speaks_for = speaks_for
        self._context = context(keys, server=False)
        self._family, self._to = udp.resolved(host, port, socket.SOCK_DGRAM)
        self.session = secrets.randbits(64)
        """What this end calls itself in every message."""
        super().__init__("link station")
        self._lock = threading.RLock()
        self._path = Path()
        self._connection: _Connection | None = None
        self._reconnection: _Connection | None = None
        self._try_at = clock()
        self._why = f"no answer from {self._name}"
        self._sequence = 0
        self._steered = NO_STICK
        self._steered_at = self._lost_at = self._sent_at = -math.inf
        self._requests: deque[Request] = deque()
        self._number = 0
        self._answers: dict[int, Answer] = {}
        self._status: tuple[Header, Status] | None = None
        self._robot: int | None = None
        self._scans = Scans()
        self._news: dict[object, tuple[Status | ScanPart | Discs, float]] = {}
        """What `news` has not returned yet, and its stamp [s]."""
        self._start()

    # ---- for the station ---------------------------------------------------------------

    def steer(self, command: Command, until: float | None = None) -> None:
        """Send the operator's command now, with the requests made here. To be called at 50 Hz.

        until: when it is lost, if no other comes, by this end's clock; None: `FRESH` from now [s].
        A deflection that is not in [-1, 1], or no number, is sent as a stick that is not valid.
        """
        if not all(-1.0 <= axis <= 1.0 for axis in command.stick):
            command = command._replace(stick=CENTRED, valid=False)
        if not 0.0 <= command.speed_scale <= 1.0:
            command = command._replace(speed_scale=0.0)
        with self._lock:
            now = self._steered_at = self.clock()
            self._steered, self._lost_at = command, now + FRESH if until is None else until
        self._waker.wake()

    def ask(self, what: RequestKind, value: int = 0, made: float | None = None) -> int:
        """Make a request; returns the number of its answer.

        made: when the person did, by this end's clock; None: now [s].
        It is repeated until it is answered, or a second is over; a stop for ever.
        """
        with self._lock:
            self._number += 1
            number = self._number
            now = self.clock()
            made = now if made is None else min(made, now)
            self._requests.append(Request(number, what, value, made))
            while len(self._requests) > 8:  # of so many, the oldest but for stops
                others = [r for r in self._requests if r.what is not RequestKind.STOP]
                self._expire(others[0] if others else self._requests[0], "too many at once")
            self._sent_at = -math.inf
        self._waker.wake()
        return number

    def answer(self, number: int) -> Answer | None:
        """The answer to a request; None: none yet."""
        with self._lock:
            return self._answers.get(number)

    def status(self) -> StampedMessage[Status] | None:
        """The robot's newest status."""
        with self._lock:
            if self._status is None:
                return None
            header, status = self._status
            return StampedMessage(status, header.stamp, self.age(header.stamp))

    def news(self) -> list[StampedMessage[Status | ScanPart | Discs]]:
        """Messages since the last call: the newest status, scan of each LiDAR, and obstacles."""
        with self._lock:
            new, self._news = self._news, {}
            return [
                StampedMessage(message, stamp, self.age(stamp)) for message, stamp in new.values()
            ]

    def age(self, stamp: float) -> float:
        """How long ago a stamp of the robot was [s]; NaN: not known yet."""
        with self._lock:
            return self._path.age(stamp, self.clock())

    def state(self) -> LinkState:
        """How the link is now."""
        with self._lock:
            path, now = self._path, self.clock()
            connected = self._connection is not None and path.silence(now) < _LOST
            return LinkState(
                connected, self._name, "" if connected else self._why, path.round_trip, path.lost,
                path.offset,
            )  # fmt: skip

    # ---- the thread --------------------------------------------------------------------

    def _on_error(self) -> None:
        self._why = "internal error in the link: see the log"

    def _close_all(self) -> None:
        for connection in (self._connection, self._reconnection):
            if connection is not None:
                udp.send(connection.socket, connection.channel.close())
                connection.socket.close()
        self._connection = self._reconnection = None

    def _poll_once(self) -> None:
        waiting = select.poll()
        waiting.register(self._waker, select.POLLIN)
        for connection in (self._connection, self._reconnection):
            if connection is not None:
                waiting.register(connection.socket, select.POLLIN)
        waiting.poll(1000.0 * _BEAT / 2.0)
        self._waker.drain()
        self._connect()
        for connection in (self._connection, self._reconnection):
            if connection is not None:
                self._receive(connection)
        self._send_command()

    def _connect(self) -> None:
        now = self.clock()
        if self._reconnection is not None:
            try:
                self._reconnection.channel.tick()
            except HandshakeRefused as refused:
                self._failed(self._reconnection, str(refused))
                return
            udp.send(self._reconnection.socket, self._reconnection.channel.waiting())
            if now - self._reconnection.since > self._reconnection.patience:
                self._failed(self._reconnection, "the robot does not answer")
            return
        one, silence = self._connection, self._path.silence(now)
        if one is not None and not silence < now - one.since:  # it is new, and has its time too
            silence = now - one.since
        well = one is not None and silence <= _LOST
        if well or now < self._try_at:
            return
        try:
            self._reconnection = _Connection(
                Channel(self._context, server=False), self._family, self._to, now
            )
        except OSError as error:
            self._why, self._try_at = f"robot unreachable: {error.strerror}", now + 1.0
            return
        self._advance(self._reconnection, None)

    def _advance(self, connection: _Connection, datagram: bytes | None) -> list[bytes]:
        """Pass a datagram to a channel (or begin), send its output; returns messages."""
        try:
            if datagram is None:
                connection.channel.start()
                return []
            return connection.channel.take(datagram)
        except HandshakeRefused as refused:
            self._failed(connection, _explained(str(refused)))
            return []
        finally:
            udp.send(connection.socket, connection.channel.waiting())

    def _failed(self, connection: _Connection, why: str) -> None:
        if why != self._why:
            _log.warning("no link to the robot: %s", why)
        with self._lock:
            self._why = why
            self._try_at = self.clock() + 0.5
            connection.socket.close()
            if connection is self._reconnection:
                self._reconnection = None
            elif connection is self._connection:
                self._connection = None

    def _receive(self, connection: _Connection) -> None:
        for datagram, _ in udp.receive(connection.socket, _PER_TURN):
            if math.isinf(connection.answered):
                connection.answered = self.clock()
            messages = self._advance(connection, datagram)
            if connection is self._reconnection and connection.channel.up:
                self._established(connection)
            for message in messages:
                self._message(message)
            if connection is not self._connection and connection is not self._reconnection:
                return  # refused meanwhile

    def _established(self, connection: _Connection) -> None:
        _log.info("linked to %s", connection.channel.name)
        with self._lock:
            if self._connection is not None:
                self._connection.socket.close()
            self._connection, self._reconnection = connection, None
            connection.since = self.clock()
            self._why = "no data from the robot"
            self._sent_at = -math.inf

    def _message(self, data: bytes) -> None:
        try:
            header, message = from_robot(data)
        except Malformed as malformed:
            _log.warning("from the robot: %s", malformed)
            self._why = str(malformed)
            return
        now = self.clock()
        with self._lock:
            if self._robot != header.session:  # it started anew, and counts from the beginning
                self._robot = header.session
                self._status = None
                self._scans = Scans()
                self._news.clear()
            newest = self._path.update(header, now)
            if newest and self._reconnection is not None and self._connection is not None:
                self._reconnection.socket.close()  # the old way works again
                self._reconnection = None
            self._keep(header, message, newest)

    def _keep(self, header: Header, message: FromRobot, newest: bool) -> None:
        if isinstance(message, ScanPart):  # each part counts, in whatever order they come
            scan = self._scans.take(message)
            if scan is not None:
                self._news[scan.lidar] = scan, scan.taken
        elif not newest:
            return
        elif isinstance(message, Status):
            self._status = (header, message)
            self._news[Status] = message, header.stamp
            for answer in message.answers:
                self._answers[answer.number] = answer
            last = max((answer.number for answer in message.answers), default=0)
            for request in list(self._requests):
                # of several stops at once not all are answered, but all are executed
                if request.what is RequestKind.STOP and request.number <= last:
                    self._answers.setdefault(request.number, Answer(request.number, True, ""))
                if request.number in self._answers:
                    self._requests.remove(request)
            while len(self._answers) > 256:
                del self._answers[next(iter(self._answers))]
        elif isinstance(message, Discs):
            self._news[Discs] = message, header.stamp

    def _expire(self, request: Request, why: str) -> None:
        self._requests.remove(request)
        self._answers[request.number] = Answer(request.number, False, why)

    def _send_command(self) -> None:
        """Send the newest command, or "no stick"."""
        now = self.clock()
        with self._lock:
            for request in list(self._requests):
                if request.what is not RequestKind.STOP and now - request.made > _REQUEST_LIFE:
                    self._expire(request, "the robot did not answer in time")
            lost = now > self._lost_at
            new = self._sent_at < (self._lost_at if lost else self._steered_at)
            if not new and now - self._sent_at < _BEAT:
                return
            gone = -math.inf < self._steered_at < now - self._speaks_for
            if gone and not self._requests:
                return
            command = self._steered
            if lost:  # the speed that is allowed is not lost with the stick
                command = NO_STICK._replace(speed_scale=self._steered.speed_scale)
            message = Uplink(command, tuple(self._requests))
            self._sent_at = now
            connection = self._connection
            if connection is None:
                return
            self._sequence += 1
            echo, hold = self._path.echo(now)
            header = Header(self.session, self._sequence, now, echo, hold)
        try:
            datagrams = connection.channel.seal(encode(header, message))
        except HandshakeRefused as refused:
            self._failed(connection, str(refused))
            return
        udp.send(connection.socket, datagrams)


def _explained(why: str) -> str:
    """With what mends it, where a certificate was not accepted; of an alert, there."""
    if why == "certificate verify failed":
        return (
            f"another robot answers there than the paired one ({why}): check the address and "
            "--name, or pair it with `cohelm pair`"
        )
    if "alert" in why and (why.endswith(" ca") or "certificate" in why):
        return f"the robot does not accept this station ({why}): pair them with `cohelm pair`"
    return why
