"""Fuzzes a driven robot: floods, damaged datagrams and streams, hostile stations.

As a program: python -m tests.link.fuzz [SECONDS [SEED [FILE]]]; ends with 1 if anything was wrong.
FILE gets a line a minute: seconds since the start, memory of this process [kB], what was sent.
"""

from __future__ import annotations

import contextlib
import random
import socket
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
from OpenSSL import SSL

from cohelm.core.types import Stick
from cohelm.link.bulk_messages import Fetch, Waypoints
from cohelm.link.dtls import Channel, HandshakeRefused, context, stream_context
from cohelm.link.keys import Keys, pair_here
from cohelm.link.messages import Command, Device, Request, RequestKind, Uplink
from cohelm.link.robot_bulk import both_ends
from cohelm.link.station_end import StationEnd
from cohelm.link.stream import Stream
from cohelm.link.wire import Header, encode
from cohelm.loop.stick import ArmingParams, current
from tests.link.ends import STATUS, answered, until

HERE = "127.0.0.1"
STICK = Stick(0.25, 0.0)
"""Where the driver holds the stick: any other deflection that is heard came from the fuzzer."""


def mutated(data: bytes, rng: random.Random) -> bytes:
    """The same with some damage."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(out) + 1)
        how = rng.randrange(5)
        if how == 0 and at < len(out):
            out[at] = rng.randrange(256)
        elif how == 1:
            out[at:at] = rng.randbytes(rng.randint(1, 40))
        elif how == 2:
            del out[at : at + rng.randint(1, 40)]
        elif how == 3 and at + 8 <= len(out):
            out[at : at + 8] = rng.choice([b"\xff" * 8, bytes(8), b"\x7f" * 8])
        elif at + 4 <= len(out):
            special = rng.choice([np.nan, np.inf, -np.inf, 1e38, -1e-38])
            out[at : at + 4] = np.float32(special).tobytes()
    return bytes(out)


def resident() -> int:
    """Memory of this process that is in use [kB]."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


class Attack:
    """A robot, its driver, and those who are neither."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        robot_keys, self.keys = pair_here()
        self.stranger = pair_here("stranger")[1]._replace(trusted=self.keys.trusted)
        self.robot, self.bulk = both_ends(robot_keys, HERE)
        self.port = self.robot.address[1]
        self.to = (HERE, self.port)
        self.driver = StationEnd(self.keys, HERE, self.port)
        self.sent: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.ages: Counter[int] = Counter()
        """How often the driver's command was so old [ms]; a list would grow with the hours."""
        self._open = True
        self._thread = threading.Thread(target=self._drive)
        self._thread.start()
        until(self.driver.status)
        answered(self.driver, RequestKind.TAKE)
        until(lambda: self.robot.receive().command)

    def close(self) -> None:
        self._open = False
        self._thread.join()
        for part in (self.driver, self.bulk, self.robot):
            part.close()

    def _drive(self) -> None:
        while self._open:
            self.driver.steer(Command(STICK, True, True, Device.SCRIPT))
            time.sleep(0.02)
            self.robot.send_status(STATUS)
            heard = current(self.robot.receive(), ArmingParams())
            if heard.command is not None:
                self.ages[round(1e3 * heard.age)] += 1
                # a beat that says "no stick" is the driver's own, when this machine was busy
                if heard.command.valid and heard.command.stick != STICK:
                    self.wrong.append(f"a stick nobody held: {heard.command}")
            for asked in heard.requests:
                if asked.request.what not in (RequestKind.STOP, RequestKind.ACKNOWLEDGE):
                    self.wrong.append(f"a request of who does not drive: {asked}")
                self.robot.answer(asked.client, asked.request.number, False, "fuzzed")

    def attack(self, seconds: float, memory: Path | None = None) -> None:
        """Everything, in turn, for so long."""
        began = minute = time.monotonic()
        end = began + seconds
        with contextlib.ExitStack() as stack:
            inside = stack.enter_context(contextlib.closing(_Inside(self, self.keys)))
            while time.monotonic() < end:
                self._strangers_datagrams()
                inside.datagrams()
                self._strangers_stream()
                self._station_stream()
                if memory is not None and time.monotonic() >= minute:
                    minute += 60.0
                    with memory.open("a") as file:
                        print(round(time.monotonic() - began), resident(), self.sent.total(),
                              file=file)  # fmt: skip
        used = lambda: current(self.robot.receive(), ArmingParams()).command  # noqa: E731
        lost = used() is None
        until(used, within=5.0)
        if lost:
            self.sent["driver was lost for a moment at the end"] += 1

    def _strangers_datagrams(self) -> None:
        """Junk, damaged hellos, and whole handshakes with a certificate that is not let in."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.settimeout(0.02)
            client = Channel(context(self.stranger, server=False), server=False)
            client.start()
            hello = client.waiting()[0]
            for _ in range(20):
                junk = self.rng.randbytes(self.rng.randint(0, 1400))
                sock.sendto(self.rng.choice([mutated(hello, self.rng), junk]), self.to)
                self.sent["strangers' datagrams"] += 1
            sock.sendto(hello, self.to)
            try:
                for _ in range(8):
                    client.take(sock.recv(4096))
                    for datagram in client.waiting():
                        if self.rng.random() < 0.2:
                            datagram = mutated(datagram, self.rng)
                        sock.sendto(datagram, self.to)
                if client.up:
                    self.sent["handshakes finished by strangers, as they see it"] += 1
            except (HandshakeRefused, TimeoutError):
                self.sent["handshakes of strangers"] += 1

    def _strangers_stream(self) -> None:
        with contextlib.suppress(OSError), socket.create_connection(self.to, 1.0) as sock:
            sock.send(self.rng.randbytes(self.rng.randint(1, 2000)))
            self.sent["strangers' streams"] += 1

    def _station_stream(self) -> None:
        """A paired station whose bulk is damaged, in its frames too."""
        sock = socket.create_connection(self.to, 1.0)
        stream = Stream(stream_context(self.keys), sock, server=False, most=1 << 20)
        header = Header(self.rng.getrandbits(64), 1, 0.0, 0.0, 0.0)
        try:
            for _ in range(40):
                stream.push()
                stream.pull()
                if stream.up:
                    break
                time.sleep(0.002)
            for message in (
                Waypoints(1, np.ones((3, 2)), True),
                Fetch("../../etc/passwd", 0, 2**32 - 1),
            ):
                data = encode(header, message)
                stream.put(mutated(data, self.rng) if self.rng.random() < 0.8 else data)
                stream.push()
                self.sent["damaged bulk"] += 1
            if self.rng.random() < 0.3:
                stream._ssl.send(self.rng.randbytes(2000))
                stream.push()
        except (HandshakeRefused, SSL.Error):
            pass
        finally:
            stream.close()


class _Inside:
    """A paired station, let in, that sends what nobody should."""

    def __init__(self, attack: Attack, keys: Keys) -> None:
        self.attack, self.keys = attack, keys
        self.session = attack.rng.getrandbits(64)
        self.number = 0
        self._connect()

    def _connect(self) -> None:
        self.sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sock.settimeout(0.3)
        self.channel = Channel(context(self.keys, server=False), server=False)
        self.channel.start()
        for _ in range(30):
            for datagram in self.channel.waiting():
                self.sock.sendto(datagram, self.attack.to)
            if self.channel.up:
                return
            try:
                self.channel.take(self.sock.recv(4096))
            except TimeoutError:
                self.channel.tick()
        raise AssertionError("a paired station was not let in")

    def datagrams(self) -> None:
        """Damaged commands, and commands of somebody who does not drive, sealed as they must be."""
        rng = self.attack.rng
        for _ in range(20):
            self.number += 1
            now = time.monotonic()
            requests = tuple(
                Request(self.number + n, rng.choice(list(RequestKind)), rng.randrange(65536), now)
                for n in range(rng.randint(0, 8))
                if rng.choice(list(RequestKind)) is not RequestKind.GIVE
            )
            # Taking the lease is not hostile: somebody who is let in may ask for it.
            requests = tuple(r for r in requests if r.what is not RequestKind.TAKE)
            command = Command(Stick(-1.0, 1.0), True, True, Device.SCRIPT)
            header = Header(self.session, self.number, now, rng.choice([now, 0.0, 1e300]), 0.0)
            data = encode(header, Uplink(command, requests))
            if rng.random() < 0.9:
                data = mutated(data, rng)
                if len(data) > 35 and any(data[35:]) and _asks_for_the_lease(data):
                    continue
            try:
                sealed = self.channel.seal(data[:1150] or b"x")
            except HandshakeRefused:  # the robot has had enough of this one
                self.close()
                self._connect()
                return
            with contextlib.suppress(OSError):
                for datagram in sealed:
                    if rng.random() < 0.1:
                        datagram = mutated(datagram, rng)
                    self.sock.sendto(datagram, self.attack.to)
                    if rng.random() < 0.2:
                        self.sock.sendto(datagram, self.attack.to)  # replayed
                    self.attack.sent["damaged commands"] += 1

    def close(self) -> None:
        self.sock.close()


def _asks_for_the_lease(data: bytes) -> bool:
    from cohelm.link.codec import Malformed
    from cohelm.link.wire import from_operator

    try:
        message = from_operator(data)[1]
    except Malformed:
        return False
    return isinstance(message, Uplink) and any(r.what is RequestKind.TAKE for r in message.requests)


def main(seconds: float, seed: int, memory: Path | None = None) -> list[str]:
    """What was wrong; nothing, if all is well."""
    attack = Attack(seed)
    try:
        attack.attack(seconds, memory)
        attack.wrong += [
            f"{what}: {count}"
            for what, count in attack.robot.counts.items()
            if what.startswith(("mistakes", "could not"))
        ]
        alive = {thread.name for thread in threading.enumerate()}
        attack.wrong += [
            f"the thread of {name} died"
            for name in ("link robot", "link bulk", "link station")
            if name not in alive
        ]
        print(dict(attack.sent), dict(attack.robot.counts), dict(attack.robot._listener.counts))
        ages = sorted(attack.ages.elements())
        print(f"{len(ages)} steps heard the driver, age 99 %: {ages[int(0.99 * len(ages))]} ms")
        return attack.wrong
    finally:
        attack.close()


if __name__ == "__main__":
    arguments = sys.argv[1:]
    found = main(
        float(arguments[0]) if arguments else 600.0,
        int(arguments[1]) if arguments[1:] else 1,
        Path(arguments[2]) if arguments[2:] else None,
    )
    print("\n".join(found) or "nothing was wrong")
    sys.exit(bool(found))
