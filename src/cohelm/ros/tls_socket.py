"""A TLS connection that one thread reads while others write to it.

OpenSSL lets only one thread at a time into a connection, and the sockets of `ssl` do not ensure it:
an answer is lost now and then. Here TLS works between two buffers under a lock, and no thread waits
for the network while it holds that.
"""

from __future__ import annotations

import contextlib
import select
import socket
import ssl
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

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
