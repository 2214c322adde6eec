"""Bulk messages on a TLS 1.3 stream that never blocks: each as its length and its bytes."""

from __future__ import annotations

import contextlib
import socket

from OpenSSL import SSL

from cohelm.link.dtls import HandshakeRefused, Secured, reason_of

_PIECE = 16_000  # about a TLS record
_READ = 65536


class Stream(Secured):
    """One end of a stream over a TCP socket, which it owns."""

    def __init__(self, made: SSL.Context, sock: socket.socket, server: bool, most: int) -> None:
        """most: bytes of the largest message that is accepted."""
        super().__init__(made, server)
        self.socket = sock
        sock.setblocking(False)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # Bytes in the kernel can not be held back any more, and datagrams wait behind them.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 32_768)
            # A path that died silently is noticed within seconds, and connected anew.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 5)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 2)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 10_000)
        self._most = most
        self._in = bytearray()
        self._plain = memoryview(b"")
        self._out = bytearray()

    @property
    def idle(self) -> bool:
        """Whether all that was put in has been sent."""
        return not self._plain and not self._out

    @property
    def blocked(self) -> bool:
        """Whether bytes wait for the socket to become writable."""
        return bool(self._out)

    def put(self, message: bytes) -> None:
        """Begin to send a message; only when `idle`."""
        self._plain = memoryview(len(message).to_bytes(4, "little") + message)

    def push(self, most: int = 1 << 30) -> int:
        """Send up to about `most` bytes; returns how many were sent. Raises HandshakeRefused."""
        left = 0
        try:
            if not self.up:
                self._handshake()
            while left < most:
                if not self._out and self.up and self._plain:
                    piece = self._plain[: min(_PIECE, most - left)]
                    self._plain = self._plain[len(piece) :]
                    self._ssl.send(bytes(piece))
                self._drain()
                if not self._out:
                    break
                count = self.socket.send(self._out[: most - left])
                del self._out[:count]
                left += count
        except (BlockingIOError, InterruptedError):
            pass
        except OSError as error:
            raise HandshakeRefused(error.strerror or "the connection broke") from None
        except SSL.Error as error:
            raise HandshakeRefused(reason_of(error)) from None
        return left

    def pull(self) -> list[bytes]:
        """The complete messages received. Raises HandshakeRefused when the stream has ended."""
        try:
            data = self.socket.recv(_READ)
        except (BlockingIOError, InterruptedError):
            return []
        except OSError as error:
            raise HandshakeRefused(error.strerror or "the connection broke") from None
        if not data:
            raise HandshakeRefused("the other end closed the connection")
        try:
            self._ssl.bio_write(data)
            if not self.up:
                self._handshake()
            while self.up:
                self._in += self._ssl.recv(_READ)
        except SSL.WantReadError:
            pass
        except SSL.ZeroReturnError:
            raise HandshakeRefused("the other end closed the connection") from None
        except SSL.Error as error:
            self._send_rest()
            raise HandshakeRefused(reason_of(error)) from None
        return self._messages()

    def close(self) -> None:
        """Shut the stream down, and close the socket."""
        with contextlib.suppress(SSL.Error):
            if self.up:
                self._ssl.shutdown()
        self._send_rest()
        self.socket.close()

    def _drain(self) -> None:
        with contextlib.suppress(SSL.Error):
            while True:
                self._out += self._ssl.bio_read(_READ)

    def _send_rest(self) -> None:
        self._drain()
        with contextlib.suppress(OSError):
            self.socket.send(self._out)

    def _messages(self) -> list[bytes]:
        messages: list[bytes] = []
        while len(self._in) >= 4:
            size = int.from_bytes(self._in[:4], "little")
            if size > self._most:
                raise HandshakeRefused(f"a message of {size} bytes")
            if len(self._in) < 4 + size:
                break
            messages.append(bytes(self._in[4 : 4 + size]))
            del self._in[: 4 + size]
        return messages
