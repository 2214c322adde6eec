"""The robot's end of bulk: pictures, maps, paths and records down, waypoints up.

One thread for all stations, on the TCP port with the number of the datagrams' UDP port. A message
published again before it was sent is replaced: a slow path gets fewer pictures, not older ones. Of
a record only the requested part is sent; pictures and maps on that stream wait meanwhile, so a
station fetches on a stream of its own.
"""

from __future__ import annotations

import logging
import secrets
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.link import udp
from cohelm.link.bulk_messages import (
    Checked,
    Fetch,
    FromRobot,
    Map,
    Picture,
    Piece,
    Records,
    Waypoints,
    ZoneMap,
    slot_of,
)
from cohelm.link.codec import Malformed
from cohelm.link.congestion import CongestionControl
from cohelm.link.dtls import HandshakeRefused, stream_context
from cohelm.link.io_thread import IoThread
from cohelm.link.keys import Keys
from cohelm.link.messages import Answer
from cohelm.link.operator import STALE
from cohelm.link.robot_end import RobotEnd
from cohelm.link.robot_records import Digests, RecordTransfer, listed, opened
from cohelm.link.stream import Stream
from cohelm.link.wire import Header, encode, from_operator

MOST_STREAMS = 24
_MAX_HANDSHAKES = 8
_PATIENCE = 5.0  # [s], for a handshake
_LARGEST_UP = 65_536
_PORTS = 5  # that are tried
_LAST = (Picture, Map, ZoneMap)  # the big ones, after all others
_CURE = "is another robot running here? Choose another port with --listen HOST:PORT"
_log = logging.getLogger("cohelm.link")


class Proposed(NamedTuple):
    """Waypoints proposed by a station; the loop checks them and answers with `reply`."""

    client: int
    name: str
    what: Waypoints


class _Station:
    """A stream to one station."""

    def __init__(self, stream: Stream, address: udp.Address, now: float) -> None:
        self.stream, self.address, self.since = stream, address, now
        self.session: int | None = None
        self.sequence = 0
        self.pace = CongestionControl(now)
        self.replies: deque[FromRobot] = deque(maxlen=64)
        self.slots: dict[object, FromRobot] = {}
        self.wanted: RecordTransfer | None = None
        self.digest_of = ""
        """The record whose hash it waits for."""


def both_ends(
    keys: Keys, host: str, port: int = 0, records: Path | None = None, stale: float = STALE
) -> tuple[RobotEnd, RobotBulk]:
    """Datagrams and bulk on ports of one number; port 0 takes one that is free for both.

    A port that is free for UDP may be in use for TCP. Raises CohelmError.
    """
    for left in range(0 if port else _PORTS, -1, -1):
        end = RobotEnd(keys, host, port, stale=stale)
        try:
            return end, RobotBulk(end, keys, records)
        except CohelmError:
            end.close()
            if not left:
                raise
        except BaseException:
            end.close()
            raise
    raise AssertionError


class RobotBulk(IoThread):
    """Listens as long as it is open; a context manager."""

    def __init__(self, end: RobotEnd, keys: Keys, records: Path | None = None) -> None:
        """records: the folder whose files stations may fetch; None: none."""
        self._end = end
        self._records = records
        self._digests = Digests(records)
        self._clock: Callable[[], float] = time.monotonic
        self._context = stream_context(keys)
        self._listener = udp.listening(end.address, _CURE)
        self._listener.setblocking(False)
        self._session = secrets.randbits(64)
        super().__init__("link bulk")
        self._lock = threading.Lock()
        self._stations: list[_Station] = []
        self._published: dict[object, FromRobot] = {}
        self._proposed: dict[object, Proposed] = {}
        """The newest of each kind from each station: no station can crowd out another's."""
        self._start()

    # ---- for the loop ------------------------------------------------------------------

    def publish(self, message: FromRobot) -> None:
        """Send to all stations, and later ones; replaces the previous message of its kind."""
        key = slot_of(message)
        with self._lock:
            self._published[key] = message
            for station in self._stations:
                station.slots[key] = message
        self._waker.wake()

    @property
    def watched(self) -> bool:
        """Whether a station receives what is published."""
        with self._lock:
            return any(station.stream.up for station in self._stations)

    def proposed(self) -> tuple[Proposed, ...]:
        """New since the last call; from each station the newest way to check, and to drive."""
        with self._lock:
            new = tuple(self._proposed.values())
            self._proposed.clear()
        return new

    def reply(self, client: int, answer: Checked) -> None:
        """Send to one station."""
        with self._lock:
            for station in self._stations:
                if self._number(station) == client:
                    station.replies.append(answer)
        self._waker.wake()

    # ---- the thread --------------------------------------------------------------------

    def _close_all(self) -> None:
        for station in list(self._stations):
            self._remove(station, "the robot's end is closed")
        self._digests.close()
        self._listener.close()

    def _poll_once(self) -> None:
        waiting = select.poll()
        for source in (self._waker, self._listener):
            waiting.register(source, select.POLLIN)
        busy = False
        for station in self._stations:
            # What its pace holds back is retried soon, not when the socket is writable.
            held = not station.stream.idle or bool(station.slots or station.replies)
            busy = busy or held or (station.wanted is not None and station.wanted.outstanding)
            waiting.register(station.stream.socket, select.POLLIN)
        waiting.poll(0.0 if self._digests.busy else 10.0 if busy else 200.0)
        self._waker.drain()
        self._accept()
        now = self._clock()
        for station in list(self._stations):
            try:
                self._serve(station, now)
            except HandshakeRefused as refused:
                self._remove(station, str(refused))
        self._digest()

    def _digest(self) -> None:
        """Compute a slice of a hash that a station waits for."""
        fetch = next((s.digest_of for s in self._stations if s.digest_of), "")
        digest = self._digests.turn() if self._digests.busy else None
        if digest is None and fetch and not self._digests.busy:
            digest = self._digests.begin(fetch)
        for station in self._stations:
            if digest is not None and station.digest_of == digest.name:
                station.digest_of = ""
                station.replies.append(digest)

    def _accept(self) -> None:
        while True:
            try:
                sock, address = self._listener.accept()
            except OSError:
                return
            self._take_in(sock, address)

    def _take_in(self, sock: socket.socket, address: udp.Address) -> None:
        pending = [s for s in self._stations if not s.stream.up]
        if len(pending) >= _MAX_HANDSHAKES:
            self._remove(pending[0], "replaced by newer handshakes")
        if len(self._stations) >= MOST_STREAMS:
            sock.close()
            return
        stream = Stream(self._context, sock, server=True, most=_LARGEST_UP)
        with self._lock:
            self._stations.append(_Station(stream, address, self._clock()))

    def _serve(self, station: _Station, now: float) -> None:
        was_up = station.stream.up
        for data in station.stream.pull():
            self._message(station, data)
        if station.stream.up and not was_up:
            with self._lock:
                station.slots.update(self._published)
        if not station.stream.up and now - station.since > _PATIENCE:
            raise HandshakeRefused("the handshake took too long")
        times = self._end.round_trips().get(self._number(station) or 0)
        if times is not None:
            station.pace.observe(*times, now)
        allowed = station.pace.allowed(now) if station.stream.up else 1 << 16
        while allowed > 0:
            if station.stream.idle and station.stream.up:
                following = self._next(station)
                if following is not None:
                    station.sequence += 1
                    stamp = self._end.clock()
                    header = Header(self._session, station.sequence, stamp, float("nan"), 0.0)
                    station.stream.put(encode(header, following))
            count = station.stream.push(allowed)
            station.pace.sent(count)
            allowed -= count
            if count == 0:
                break

    def _next(self, station: _Station) -> FromRobot | None:
        """The next message: replies, then small ones, pieces of a record, and large ones."""
        wanted = station.wanted if station.wanted and station.wanted.outstanding else None
        with self._lock:
            if station.replies:
                return station.replies.popleft()
            if station.slots:
                key = min(station.slots, key=lambda k: isinstance(station.slots[k], _LAST))
                if wanted is None or not isinstance(station.slots[key], _LAST):
                    return station.slots.pop(key)
        return None if wanted is None else wanted.piece()

    def _message(self, station: _Station, data: bytes) -> None:
        try:
            header, message = from_operator(data, bulk=True)
        except Malformed as malformed:
            raise HandshakeRefused(str(malformed)) from None
        station.session = header.session
        if isinstance(message, Fetch):
            self._fetch(station, message)
        elif isinstance(message, Waypoints):
            client = self._number(station)
            key = (client, message.only_check)
            why = "" if message.only_check else self._end.path_refusal(client, header.stamp)
            if client is None or why:
                why = why or "no connection for commands yet"
                station.replies.append(Checked(Answer(message.number, False, why), 65535))
            else:
                with self._lock:  # at the end: oldest first
                    self._proposed.pop(key, None)
                    self._proposed[key] = Proposed(client, station.stream.name, message)

    def _fetch(self, station: _Station, fetch: Fetch) -> None:
        if not fetch.name:
            station.replies.append(Records(listed(self._records)))
        elif fetch.size == 0:
            station.digest_of = fetch.name
        elif station.wanted is None or not station.wanted.more(fetch):
            self._end_fetch(station)
            file = opened(self._records, fetch.name)
            if file is None:
                station.replies.append(Piece(fetch.name, fetch.offset, b""))
            else:
                station.wanted = RecordTransfer(fetch, file)

    @staticmethod
    def _end_fetch(station: _Station) -> None:
        if station.wanted is not None:
            station.wanted.close()
            station.wanted = None

    def _number(self, station: _Station) -> int | None:
        if station.session is None:
            return None
        return self._end.client_of(station.stream.peer, station.session)

    def _remove(self, station: _Station, why: str) -> None:
        peer = station.stream.name or f"an unpaired client at {station.address[0]}"
        _log.info("bulk to %s ended: %s", peer, why)
        with self._lock:
            self._stations.remove(station)
            if not self._stations:  # pictures end with the last one: none shall begin with an old
                self._published.pop(Picture, None)
        self._end_fetch(station)
        station.stream.close()
