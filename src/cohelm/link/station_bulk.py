"""The station's end of bulk: receives what the robot publishes, sends waypoints and requests.

Of published messages the newest of each kind is kept until it is read; of answers and pieces of
records only as much as was requested. The connection to a robot that sends more is closed: no
requested message is dropped, and memory stays bounded.
"""

from __future__ import annotations

import logging
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable

from cohelm.link import udp
from cohelm.link.bulk_messages import (
    LARGEST_BULK,
    Checked,
    Digest,
    Fetch,
    FromOperator,
    FromRobot,
    Picture,
    Piece,
    slot_of,
)
from cohelm.link.codec import Malformed
from cohelm.link.dtls import HandshakeRefused, stream_context
from cohelm.link.io_thread import IoThread
from cohelm.link.keys import Keys
from cohelm.link.stream import Stream
from cohelm.link.wire import Header, encode, from_robot

_PATIENCE = 10.0  # [s], for a connection
_RETRY = 1.0  # [s], until the next one is tried
_MOST_ANSWERS = 256
_MOST_UNREAD = 16_000_000
"""Of pieces, sixteen times what a download requests at once [byte]."""
_log = logging.getLogger("cohelm.link")


class StationBulk(IoThread):
    """Keeps connected as long as it is open; a context manager."""

    def __init__(
        self, keys: Keys, host: str, port: int, session: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """session: that of the StationEnd, by which the robot assigns this stream to it."""
        self._context = stream_context(keys)
        self._family, self._to = udp.resolved(host, port, socket.SOCK_STREAM)
        self._session = session
        self._clock = clock
        super().__init__("link bulk")
        self._lock = threading.Lock()
        self._news: dict[object, FromRobot] = {}
        self._answers = self._unread = 0
        self._picture: Picture | None = None
        self._outbox: deque[tuple[FromOperator, float]] = deque(maxlen=64)
        """Messages, and when they were made [s]."""
        self._sequence = 0
        self.connected = False
        self._start()

    def send(self, message: FromOperator) -> None:
        """Send it as soon as there is a connection, with the time of now."""
        with self._lock:
            self._outbox.append((message, self._clock()))
        self._waker.wake()

    def news(self) -> list[FromRobot]:
        """Messages since the last call, in order, except pictures; the newest of a kind."""
        with self._lock:
            new = list(self._news.values())
            self._news.clear()
            self._answers = self._unread = 0
        return new

    def picture(self) -> Picture | None:
        """The newest picture; each is returned once."""
        with self._lock:
            newest, self._picture = self._picture, None
        return newest

    def _poll_once(self) -> None:
        """One connection, from its beginning to its end."""
        try:
            self._connection()
        except HandshakeRefused as refused:
            _log.info("no bulk from the robot: %s", refused)
        finally:
            self.connected = False
        self._wait(_RETRY)

    def _on_error(self) -> None:
        self._wait(_RETRY)

    def _wait(self, seconds: float) -> None:
        until = self._clock() + seconds
        while self._open and self._clock() < until:
            time.sleep(0.05)

    def _connection(self) -> None:
        sock = socket.socket(self._family, socket.SOCK_STREAM)
        sock.settimeout(_PATIENCE)
        try:
            sock.connect(self._to)
        except OSError as error:
            sock.close()
            raise HandshakeRefused(error.strerror or "the robot does not answer") from None
        stream = Stream(self._context, sock, server=False, most=LARGEST_BULK)
        began = self._clock()
        # names this session, and requests the list
        following: tuple[FromOperator, float] | None = (Fetch(""), began)
        try:
            while self._open:
                waiting = select.poll()
                waiting.register(self._waker, select.POLLIN)
                mask = select.POLLIN | (select.POLLOUT if stream.blocked else 0)
                waiting.register(stream.socket, mask)
                stream.push()
                waiting.poll(100.0)
                self._waker.drain()
                for data in stream.pull():
                    self._message(data)
                if not stream.up and self._clock() - began > _PATIENCE:
                    raise HandshakeRefused("the handshake took too long")
                self.connected = stream.up
                if stream.up and stream.idle:
                    with self._lock:
                        if following is None and self._outbox:
                            following = self._outbox.popleft()
                    if following is not None:
                        (message, made), following = following, None
                        self._sequence += 1
                        header = Header(self._session, self._sequence, made, float("nan"), 0.0)
                        stream.put(encode(header, message))
        finally:
            stream.close()

    def _message(self, data: bytes) -> None:
        try:
            _, message = from_robot(data, bulk=True)
        except Malformed as malformed:
            raise HandshakeRefused(str(malformed)) from None
        with self._lock:
            if isinstance(message, Picture):
                self._picture = message
                return
            slot = slot_of(message)
            if isinstance(message, Piece | Digest | Checked):
                self._answers += 1
                self._unread += len(message.data) if isinstance(message, Piece) else 0
                slot = self._answers
                if self._unread > _MOST_UNREAD or self._answers > _MOST_ANSWERS:
                    raise HandshakeRefused("it sends more than requested")
            self._news.pop(slot, None)  # the newest stands last
            self._news[slot] = message
