"""A bad network for tests: two network namespaces joined through this program.

As a module: `with Network() as net:`; sockets made inside `net.robot()` or `net.station()` live
on that side. As a program it is the wire itself, told by lines of JSON on stdin how bad to be.
Needs the right to make network namespaces, /dev/net/tun and the command `ip`.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import math
import os
import random
import select
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

ROBOT, STATION = "10.77.0.1", "10.77.0.2"
_CLONE_NEWNET = 0x40000000
_TUNSETIFF, _TUN_NO_PI = 0x400454CA, 0x1001
_GOOD = {
    "delay": 0.0, "jitter": 0.0, "loss": 0.0, "duplicate": 0.0, "rate": 0.0, "queue": 50_000,
    "corrupt": 0.0, "replay": 0.0, "hoard": 0.0,
}  # fmt: skip


def why_not() -> str:
    """Why there can be no such network here; empty: there can."""
    if shutil.which("ip") is None:
        return "the command `ip` is missing"
    if not Path("/dev/net/tun").exists():
        return "/dev/net/tun is missing"
    before = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    try:
        _unshare()
    except OSError as error:
        return f"network namespaces are not permitted here ({error.strerror})"
    finally:
        _enter(before)
        os.close(before)
    return ""


class Network:
    """delay, jitter (standard deviation) [s]; loss, duplicate, corrupt, replay: shares.

    rate [bit/s], with a queue [byte] that is dropped at its tail. hoard: keep everything, and
    deliver all at once and in order when that is over.
    """

    def __enter__(self) -> Network:
        self._sides = [self._side(ROBOT), self._side(STATION)]
        fds = [tun for _, tun in self._sides]
        self._wire = subprocess.Popen(
            [sys.executable, __file__, *map(str, fds)], stdin=subprocess.PIPE, pass_fds=fds,
            text=True,
        )  # fmt: skip
        self.be()
        return self

    def __exit__(self, *_: object) -> None:
        assert self._wire.stdin is not None
        self._wire.stdin.close()
        self._wire.wait(5.0)
        for namespace, tun in self._sides:
            os.close(namespace)
            os.close(tun)

    def be(self, **bad: float) -> None:
        """From now on so bad, both ways; what is not named is good."""
        assert self._wire.stdin is not None
        self._wire.stdin.write(json.dumps({**_GOOD, **bad}) + "\n")
        self._wire.stdin.flush()
        time.sleep(0.01)

    @contextmanager
    def robot(self) -> Generator[None]:
        """On the robot's side."""
        with _inside(self._sides[0][0]):
            yield

    @contextmanager
    def station(self) -> Generator[None]:
        """On the station's side."""
        with _inside(self._sides[1][0]):
            yield

    @property
    def station_side(self) -> int:
        """A descriptor of the station's namespace, for programs that are started elsewhere."""
        return self._sides[1][0]

    def _side(self, address: str) -> tuple[int, int]:
        before = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
        _unshare()
        namespace = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
        try:
            tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", b"bad", _TUN_NO_PI))
            for command in (
                f"addr add {address}/24 dev bad", "link set bad up", "link set lo up",
            ):  # fmt: skip
                subprocess.run(["ip", *command.split()], check=True)
        finally:
            _enter(before)
            os.close(before)
        return namespace, tun


def _libc() -> Any:
    return ctypes.CDLL(None, use_errno=True)


def _unshare() -> None:
    if _libc().unshare(_CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _enter(namespace: int) -> None:
    if _libc().setns(namespace, _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


@contextmanager
def _inside(namespace: int) -> Generator[None]:
    """This thread, and the threads and programs it starts, live in that namespace."""
    before = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    _enter(namespace)
    try:
        yield
    finally:
        _enter(before)
        os.close(before)


def _wire(one: int, two: int) -> None:
    """Carry packets until stdin is closed."""
    rng, bad = random.Random(1), dict(_GOOD)
    flying: list[tuple[float, int, int, bytes]] = []
    busy, count, seen = {one: 0.0, two: 0.0}, 0, b""
    waiting = select.poll()
    for fd in (one, two, 0):
        waiting.register(fd, select.POLLIN)
    while True:
        left = (flying[0][0] - time.monotonic()) * 1000.0 if flying else 100.0
        for fd, _ in waiting.poll(min(100.0, max(0.0, left))):
            if fd == 0:
                said = os.read(0, 65536)  # lines are short and written whole
                if not said:
                    return
                bad = json.loads(said.splitlines()[-1])
                if not bad["hoard"]:
                    flying = [(0.0 if math.isinf(at) else at, *rest) for at, *rest in flying]
                    heapq.heapify(flying)
                continue
            to = two if fd == one else one
            for _ in range(64):
                try:
                    packet = os.read(fd, 65536)
                except BlockingIOError:
                    break
                now = time.monotonic()
                if rng.random() < bad["loss"]:
                    continue
                leaves = math.inf if bad["hoard"] else now
                if bad["rate"]:
                    leaves = max(now, busy[to]) + len(packet) * 8.0 / bad["rate"]
                    if (leaves - now) * bad["rate"] / 8.0 > bad["queue"]:
                        continue
                    busy[to] = leaves
                copies = [packet] * (2 if rng.random() < bad["duplicate"] else 1)
                if rng.random() < bad["corrupt"]:
                    copies[0] = _corrupted(packet, rng)
                if seen and rng.random() < bad["replay"]:
                    copies.append(seen)  # an old packet, of either way, again
                if rng.random() < 0.02 or not seen:
                    seen = packet
                for copy in copies:
                    count += 1
                    wait = max(0.0, bad["delay"] + rng.gauss(0.0, 1.0) * bad["jitter"])
                    heapq.heappush(flying, (leaves + wait, count, to, copy))
        now = time.monotonic()
        while flying and flying[0][0] <= now:
            _, _, to, packet = heapq.heappop(flying)
            with suppress(OSError):
                os.write(to, packet)


def _corrupted(packet: bytes, rng: random.Random) -> bytes:
    """A forger's packet: bytes of UDP's content changed, and the checksum left out."""
    if packet[9] != 17 or len(packet) < 60:
        return packet
    forged = bytearray(packet)
    forged[26:28] = b"\0\0"
    for _ in range(3):
        forged[rng.randrange(28, len(forged))] = rng.randrange(256)
    return bytes(forged)


if __name__ == "__main__":
    _wire(int(sys.argv[1]), int(sys.argv[2]))
