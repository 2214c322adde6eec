"""Floods, one kind each, sent from a process of their own, and a robot's loop in another.

Loopback only; bounded in rate and time. As a program it is the flood:
python -m tests.link.floods KIND PORT SECONDS RATE, with the pickled keys on stdin.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import random
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import NamedTuple

import numpy as np
from OpenSSL import SSL

from cohelm.core.types import Stick
from cohelm.link.bulk_messages import Fetch, Waypoints
from cohelm.link.dtls import Channel, HandshakeRefused, context, stream_context
from cohelm.link.keys import Keys, pair_here
from cohelm.link.messages import Command, Device, Request, RequestKind, Uplink
from cohelm.link.robot_bulk import both_ends
from cohelm.link.stream import Stream
from cohelm.link.wire import Header, encode
from tests.link.ends import STATUS
from tests.link.fuzz import mutated

HERE = "127.0.0.1"
PERIOD = 0.02


class Robot(NamedTuple):
    port: int
    keys: Keys
    told: Connection


class Seen(NamedTuple):
    """What one period of the robot's loop heard."""

    at: float
    """Machine's clock when it had heard all of it [s]."""
    stop: tuple[int, int] | None
    """Client and number of the stop it obeys."""
    first: bool
    """Whether the stops came before all other requests."""
    driven: bool
    """Whether the driver's command was there and is his."""
    age: float
    asked: int


def _robot(keys: Keys, stick: Stick, told: Connection) -> None:
    """The other process: both ends of the link, and a loop at 50 Hz that obeys."""
    sys.setswitchinterval(5e-4)  # as `Loop.run`
    end, bulk = both_ends(keys, HERE)
    with end:
        told.send(end.address[1])
        due = time.monotonic()
        while not told.poll():
            heard = end.receive()
            now = time.monotonic()
            stops = [a for a in heard.requests if a.request.what is RequestKind.STOP]
            for asked in heard.requests:
                end.answer(asked.client, asked.request.number, True, "")
            bulk.proposed()
            command = heard.command
            told.send(
                Seen(
                    now, (stops[0].client, stops[0].request.number) if stops else None,
                    heard.requests[: len(stops)] == tuple(stops),
                    command is not None and command.valid and command.stick == stick,
                    heard.age, len(heard.requests),
                )
            )  # fmt: skip
            end.send_status(STATUS)
            due = max(due + PERIOD, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
        bulk.close()
    told.send(dict(end.counts))


@contextmanager
def robot(stick: Stick) -> Generator[Robot]:
    of_robot, keys = pair_here()
    spawn = get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_robot, args=(of_robot, stick, theirs), daemon=True)
    process.start()
    assert ours.poll(60.0)
    try:
        yield Robot(ours.recv(), keys, ours)
    finally:
        with contextlib.suppress(OSError):
            ours.send("end")
        process.join(10.0)
        process.kill()


@contextmanager
def flood(kind: str, robot_: Robot, seconds: float, rate: float) -> Generator[None]:
    """So many a second of this kind, in a process that gives way to all others."""
    program = [sys.executable, "-m", "tests.link.floods", kind, str(robot_.port)]
    process = subprocess.Popen(
        [*program, str(seconds), str(rate)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(pickle.dumps(robot_.keys))
        process.stdin.close()
        assert process.stdout.readline() == b"floods\n"
        yield
        assert process.poll() is None, "the flood ended too soon"
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


# ---- the flood's own process ------------------------------------------------------------


class Flood:
    def __init__(self, keys: Keys, port: int) -> None:
        self.keys, self.to, self.rng = keys, (HERE, port), random.Random(1)
        self.stranger = pair_here("stranger")[1]._replace(trusted=keys.trusted)
        self.number = 0
        self.session = self.rng.getrandbits(64)
        self.echo = (0.0, 0.0)
        self.sock = self.channel = None
        self.kept: list[bytes] = []
        self.idle: list[object] = []

    def connected(self, keys: Keys | None = None) -> tuple[socket.socket, Channel]:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.settimeout(0.5)
        channel = Channel(context(keys or self.keys, server=False), server=False)
        channel.start()
        for _ in range(60):
            for datagram in channel.waiting():
                sock.sendto(datagram, self.to)
            if channel.up:
                return sock, channel
            try:
                channel.take(sock.recv(4096))
            except TimeoutError:
                channel.tick()
        raise HandshakeRefused("not let in")

    def sealed(self, data: bytes) -> None:
        """From inside, as a paired station that does not drive."""
        if self.channel is None or self.sock is None:
            self.sock, self.channel = self.connected()
            self.sock.setblocking(False)
        with contextlib.suppress(OSError):
            while True:
                self.channel.take(self.sock.recv(4096))
        for datagram in self.channel.seal(data):
            self.kept = [datagram, *self.kept[:50]]
            with contextlib.suppress(OSError):
                self.sock.sendto(datagram, self.to)

    def command(self, *requests: Request) -> bytes:
        self.number += 1
        now = time.monotonic()  # both ends read the same clock here
        header = Header(self.session, self.number, now, now - 1e-4, 1e-4)
        stick = Command(Stick(-1.0, 1.0), True, True, Device.SCRIPT)
        return encode(header, Uplink(stick, requests))

    def asks(self, *whats: RequestKind) -> None:
        now = time.monotonic()
        first = 8 * self.number
        requests = (
            Request(first + k, self.rng.choice(whats), self.rng.randrange(1, 5), now)
            for k in range(1, 9)
        )
        self.sealed(self.command(*requests))

    # ---- the kinds ----

    def garbage(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.sendto(self.rng.randbytes(self.rng.randint(0, 1400)), self.to)

    def hellos(self) -> None:
        if not self.kept:
            client = Channel(context(self.stranger, server=False), server=False)
            client.start()
            self.kept = client.waiting()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.sendto(self.kept[0], self.to)

    def half_handshakes(self) -> None:
        """Shows that it has its address, and says no more."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.settimeout(0.05)
        client = Channel(context(self.stranger, server=False), server=False)
        client.start()
        with contextlib.suppress(TimeoutError, HandshakeRefused):
            sock.sendto(client.waiting()[0], self.to)
            client.take(sock.recv(4096))
            for datagram in client.waiting():
                sock.sendto(datagram, self.to)
        self.idle = [sock, *self.idle[:50]]

    def strangers(self) -> None:
        with contextlib.suppress(HandshakeRefused, TimeoutError):
            self.connected(self.stranger)[0].close()

    def requests(self) -> None:
        self.asks(RequestKind.MODE, RequestKind.RESET, RequestKind.RECORD, RequestKind.ACKNOWLEDGE)

    def lease(self) -> None:
        self.asks(RequestKind.GIVE, RequestKind.REFUSE, RequestKind.RECORD)

    def stops(self) -> None:
        self.asks(RequestKind.STOP)

    def commands(self) -> None:
        self.sealed(self.command())

    def unknown_kinds(self) -> None:
        data = bytearray(self.command())
        data[self.rng.randrange(2)] = self.rng.randrange(2, 256)
        self.sealed(bytes(data))

    def malformed(self) -> None:
        self.sealed(mutated(self.command(), self.rng)[:1150] or b"x")

    def oversize(self) -> None:
        self.sealed(self.command() + self.rng.randbytes(1140))

    def replays(self) -> None:
        if not self.kept:
            self.sealed(self.command())
        assert self.sock is not None
        self.sock.sendto(self.rng.choice(self.kept), self.to)

    def reconnects(self) -> None:
        with contextlib.suppress(HandshakeRefused, TimeoutError):
            sock, channel = self.connected()
            self.session = self.rng.getrandbits(64)
            for datagram in channel.seal(self.command()):
                sock.sendto(datagram, self.to)
            self.idle = [sock, *self.idle[:50]]

    def sessions(self) -> None:
        self.session = self.rng.getrandbits(64)
        self.sealed(self.command(Request(1, RequestKind.MODE, 2, time.monotonic())))

    def _bulk(self, message: Waypoints | Fetch) -> None:
        if not self.idle:
            sock = socket.create_connection(self.to, 2.0)
            stream = Stream(stream_context(self.keys), sock, server=False, most=1 << 20)
            while not stream.up:
                stream.push()
                stream.pull()
                time.sleep(0.001)
            self.sealed(self.command())  # so that the robot knows whose stream it is
            self.idle = [stream]
        stream = self.idle[0]
        assert isinstance(stream, Stream)
        try:
            stream.push()
            if stream.idle:
                stream.put(encode(Header(self.session, 1, 0.0, 0.0, 0.0), message))
                stream.push()
            stream.pull()
        except (HandshakeRefused, SSL.Error):
            self.idle = []

    def proposals(self) -> None:
        self.number += 1
        points = np.cumsum(self.rng.random() * np.ones((500, 2)), axis=0)
        self._bulk(Waypoints(self.number, points, True))

    def fetches(self) -> None:
        self._bulk(Fetch(""))

    def streams(self) -> None:
        """Connections that say nothing, or nonsense."""
        with contextlib.suppress(OSError):
            sock = socket.create_connection(self.to, 0.2)
            sock.send(self.rng.randbytes(self.rng.randint(0, 400)))
            self.idle = [sock, *self.idle[:100]]


KINDS = {
    "garbage": 1.0, "hellos": 1.0, "half_handshakes": 0.1, "strangers": 0.02, "requests": 1.0,
    "lease": 1.0, "stops": 1.0, "commands": 1.0, "unknown_kinds": 1.0, "malformed": 1.0,
    "oversize": 1.0, "replays": 1.0, "reconnects": 0.02, "sessions": 1.0, "proposals": 0.1,
    "fetches": 1.0, "streams": 0.1,
}  # fmt: skip
"""Name, and which share of the rate is asked of it: a handshake is no datagram."""


def _main(kind: str, port: int, seconds: float, rate: float) -> None:
    os.nice(5)
    made = Flood(pickle.load(sys.stdin.buffer), port)
    once: Callable[[], None] = getattr(made, kind)
    once()
    print("floods", flush=True)
    end = time.monotonic() + seconds
    rate *= KINDS[kind]
    at_once = max(1, round(rate / 200.0))
    due = time.monotonic()
    while time.monotonic() < end:
        for _ in range(at_once):
            try:
                once()
            except HandshakeRefused:  # the robot has had enough of this one: it comes again
                made.channel = None
        due = max(due + at_once / rate, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    _main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4]))
