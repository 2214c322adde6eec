"""The sockets of the link, and of the other servers here."""

from __future__ import annotations

import contextlib
import socket
from typing import Any
from urllib.parse import urlsplit

from cohelm.core.errors import CohelmError

Address = tuple[Any, ...]
PORT = 7660
"""UDP for messages that must be fresh, TCP for those that must be complete."""
_EXPEDITED = 0xB8  # DSCP EF: before bulk, where a router cares (RFC 3246)
_LARGEST = 2048


def address(text: str, port: int) -> tuple[str, int]:
    """Host and port of HOST, HOST:PORT or [HOST]:PORT. CohelmError for anything else."""
    try:
        parts = urlsplit(f"//{text}" if text.count(":") < 2 or "[" in text else f"//[{text}]")
        if not parts.hostname or parts.path or parts.username is not None:
            raise ValueError
        return parts.hostname, parts.port or port
    except ValueError:
        raise CohelmError(
            f"{text!r} is no HOST[:PORT], as in robot.local or 10.0.0.5:7447"
        ) from None


def bracketed(host: str) -> str:
    """The host as it stands before :PORT, an address of IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def resolved(host: str, port: int, kind: socket.SocketKind) -> tuple[int, Address]:
    """Address family and address of a host."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except (OSError, UnicodeError):
        raise CohelmError(f"the host {host!r} can not be found: check its name") from None
    return found[0][0], found[0][4]


def opened(family: int, bind: Address | None = None, shared: bool = False) -> socket.socket:
    """A socket that never blocks, and buffers few datagrams: those that wait are old.

    shared: others may be bound to the same address; a connected one gets its peer's datagrams.
    """
    made = socket.socket(family, socket.SOCK_DGRAM)
    made.setblocking(False)
    if shared:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65536)
    with contextlib.suppress(OSError):  # optional: some systems do not support it
        if family == socket.AF_INET6:
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_TCLASS, _EXPEDITED)
        else:
            made.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, _EXPEDITED)
    if bind is not None:
        try:
            made.bind(bind)
        except OSError as error:
            made.close()
            raise CohelmError(
                f"can not listen on {bind[0]} port {bind[1]} ({error.strerror}): choose another "
                "with --listen HOST:PORT"
            ) from None
    return made


def listening(
    where: Address, cure: str, made: socket.socket | None = None, backlog: int = 128
) -> socket.socket:
    """A TCP socket that listens. made: one to use. cure: what to do where that is not possible, as
    CohelmError says."""
    host, port = where[:2]
    if made is None:
        made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
        made.listen(backlog)
    except (OSError, OverflowError) as error:
        made.close()
        why = getattr(error, "strerror", None) or error
        raise CohelmError(f"can not listen on {host} port {port} ({why}): {cure}") from None
    return made


def receive(sock: socket.socket, most: int) -> list[tuple[bytes, Address]]:
    """Up to `most` waiting datagrams."""
    came: list[tuple[bytes, Address]] = []
    for _ in range(most):
        try:
            came.append(sock.recvfrom(_LARGEST))
        except (BlockingIOError, InterruptedError):
            break
        except OSError:
            continue  # an ICMP message: "port unreachable", which anyone can forge
    return came


def send(sock: socket.socket, datagrams: list[bytes], to: Address | None = None) -> None:
    """Send, or drop: a datagram that can not be sent now is not worth waiting for."""
    for datagram in datagrams:
        with contextlib.suppress(OSError):
            if to is None:
                sock.send(datagram)
            else:
                sock.sendto(datagram, to)


class Waker:
    """Wakes a thread that waits in `select`; two calls wake it once."""

    def __init__(self) -> None:
        self._read, self._write = socket.socketpair()
        self._read.setblocking(False)
        self._write.setblocking(False)

    def fileno(self) -> int:
        """For `select`."""
        return self._read.fileno()

    def wake(self) -> None:
        """Wake it; from any thread."""
        with contextlib.suppress(OSError):
            self._write.send(b"!")

    def drain(self) -> None:
        """Clear the wake-up."""
        with contextlib.suppress(OSError):
            self._read.recv(4096)

    def close(self) -> None:
        """Close both sockets."""
        self._read.close()
        self._write.close()
