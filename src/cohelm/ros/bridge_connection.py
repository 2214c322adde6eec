"""Connects to a `foxglove_bridge`, with or without TLS, and checks its capabilities."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import ssl
import threading
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import SplitResult, urlsplit

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from cohelm.core.errors import CohelmError
from cohelm.ros.foxglove_protocol import PROTOCOLS

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


URL = "ws://localhost:8765"
"""Of a bridge on this machine, as it is started by default."""
_NEEDED = ("clientPublish", "connectionGraph")
OPENS = 5.0
"""So long may a connection take to begin [s]."""
_SILENT = 2.0
"""A bridge that does not answer a ping for so long is gone [s]."""
_LARGEST = 1 << 26
_NO_TLS = ("WRONG_VERSION_NUMBER", "RECORD_LAYER_FAILURE")
"""As OpenSSL, and 3.4 and later, calls what is no answer of TLS."""
_NOT_SENT_LOWEST = 25
"""TCP_NOTSENT_LOWAT of Linux: a socket that still holds what it did not send is not writable."""


def opened(url: str) -> tuple[ClientConnection, str]:
    """A new connection, after the bridge has sent its capabilities, and the bridge's name. Raises
    CohelmError where none answers, or a capability is missing."""
    at = _address(url)
    clear = at._replace(scheme="ws").geturl()
    try:
        # In clear, over a socket that does TLS where the address says so. legacy: websockets
        # 17.1 and later warn without it; earlier ones do not look at it, as there is a socket.
        there = connect(
            clear, sock=_reached(at), subprotocols=PROTOCOLS,
            compression=None, open_timeout=OPENS, close_timeout=0.5, ping_interval=1.0,
            ping_timeout=_SILENT, max_size=_LARGEST, proxy=None, legacy=True,
        )  # fmt: skip
        with contextlib.suppress(OSError):
            there.socket.setsockopt(socket.IPPROTO_TCP, _NOT_SENT_LOWEST, 1)
        info = understood(there.recv(OPENS))
    except ssl.SSLCertVerificationError as error:
        raise CohelmError(
            f"the certificate of {url} is not accepted (certificate verify failed: "
            f"{error.verify_message}): name the file of who signed it in SSL_CERT_FILE, and the "
            "bridge by the name in its certificate"
        ) from error
    except (OSError, ValueError, WebSocketException) as error:
        if isinstance(error, ssl.SSLError) and error.reason in _NO_TLS:
            raise CohelmError(
                f"{url} does no TLS: write {clear}, or give the bridge a certificate (its "
                "parameters tls, certfile and keyfile)"
            ) from error
        raise CohelmError(
            f"no foxglove_bridge answers at {url} ({error}): start it on the robot (ros2 "
            "launch foxglove_bridge foxglove_bridge_launch.xml), or name its address with --url"
        ) from error
    abilities = listed(info.get("capabilities"))
    lacking = [one for one in _NEEDED if one not in abilities]
    if lacking:
        there.close()
        raise CohelmError(
            f"the bridge at {url} offers no {' and no '.join(lacking)}: add that to its "
            "parameter capabilities, and start it again"
        )
    if "cdr" not in listed(info.get("supportedEncodings")):
        there.close()
        raise CohelmError(f"the bridge at {url} takes no CDR: it is none of ROS 2")
    there.send(json.dumps({"op": "subscribeConnectionGraph"}))
    return there, str(info.get("name", ""))


def _address(url: str) -> SplitResult:
    """Parses an address. Raises CohelmError for an invalid one."""
    with contextlib.suppress(ValueError):  # half an IPv6 address, or a port that there is not
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
        if host and parts.scheme in ("ws", "wss"):
            return parts
    raise CohelmError(f"--url {url!r}: give the bridge's address, such as {URL}")


def _reached(at: SplitResult) -> socket.socket:
    """A socket to an address, with TLS where the scheme asks for it. Raises OSError, or
    ValueError."""
    host, sealed = at.hostname or "", at.scheme == "wss"
    there = socket.create_connection((host, at.port or (443 if sealed else 80)), OPENS)
    if sealed:
        return TlsSocket(there, host)
    there.settimeout(None)
    return there


def listed(data: object) -> list[Any]:
    """A list; an empty one for what is none."""
    return cast("list[Any]", data) if isinstance(data, list) else []


def understood(data: str | bytes) -> dict[str, Any]:
    """A JSON object; an empty one for what is none."""
    try:
        made: Any = json.loads(data)
    except ValueError:
        return {}
    return cast("dict[str, Any]", made) if isinstance(made, dict) else {}


# A TLS connection that one thread reads while others write to it.
#
# OpenSSL lets only one thread at a time into a connection, and the sockets of `ssl` do not ensure
# it: an answer is lost now and then. Here TLS works between two buffers under a lock, and no thread
# waits for the network while it holds that.


_MOST = 1 << 16
"""Bytes that are taken from the network, or out of TLS, at once."""
_LOOK = 0.2
"""A reader waiting for the rest of a record checks this often whether the socket is closed [s]."""


class TlsSocket(socket.socket):
    """A client's end. It is read by one thread, and written to by any."""

    def __init__(self, connected: socket.socket, host: str) -> None:
        """connected: a TCP socket, which is taken over; its timeout holds for the handshake. host:
        the name that the certificate must have. Raises OSError, which ssl.SSLError is one of."""
        within, here = connected.gettimeout(), connected.detach()
        super().__init__(fileno=here)
        self.settimeout(within)
        self._came, self._leaves = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._over = False
        """The peer has closed."""
        self._turn, self._order = threading.Lock(), threading.Lock()
        context = ssl.create_default_context()
        context.options |= ssl.OP_NO_RENEGOTIATION  # it would have writers wait for what comes
        self._tls = context.wrap_bio(self._came, self._leaves, server_hostname=host)
        try:
            while not self._shaken():
                self._feed(super().recv(_MOST))
        except OSError:
            self.close()
            raise
        self.settimeout(None)

    def recv(self, bufsize: int, flags: int = 0, /) -> bytes:
        """All that has come, however much: `select` on this socket does not see what is buffered
        here. Waits for something; empty: the peer has closed."""
        while True:
            data = super().recv(bufsize, flags)
            with self._turn:
                self._feed(data)
                plain = self._plain()
            if plain or self._over:
                return plain
            while not select.select([self], [], [], _LOOK)[0]:
                pass

    def sendall(self, data: ReadableBuffer, flags: int = 0, /) -> None:
        """Waits until the network has taken it all."""
        left = memoryview(data)
        with self._order:
            with self._turn:
                while left:
                    left = left[self._tls.write(left) :]
                sealed = self._leaves.read()
            super().sendall(sealed, flags)

    def _shaken(self) -> bool:
        """Whether the handshake is done; its next bytes are sent."""
        try:
            self._tls.do_handshake()
            done = True
        except ssl.SSLWantReadError:
            done = False
        super().sendall(self._leaves.read())
        return done

    def _feed(self, data: bytes) -> None:
        if data:
            self._came.write(data)
        else:
            self._came.write_eof()

    def _plain(self) -> bytes:
        """What can be read of what has come. What TLS answers by itself leaves with the next that
        is sent."""
        plain = bytearray()
        try:
            while piece := self._tls.read(_MOST):
                plain += piece
            self._over = True
            with contextlib.suppress(OSError):
                self.shutdown(socket.SHUT_RD)  # so that `select` sees it
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLEOFError:  # without a farewell
            self._over = True
        return bytes(plain)
