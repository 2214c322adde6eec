"""The web server around the application: addresses, TLS, limits, time-outs."""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
import ssl
from asyncio import Transport
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from cohelm.core.errors import CohelmError
from cohelm.station.app import Station
from cohelm.station.doors import is_loopback
from cohelm.station.robot_link import Connect

PORT = 8765
HEAD_WITHIN = 5.0
"""Who has not sent a whole request by then is let go: slow-loris [s]."""
MOST_CONNECTIONS = 64
LARGEST_MESSAGE = 16_384
"""Of a page, in bytes."""
_log = logging.getLogger("cohelm.station")


class _Patient(H11Protocol):
    """HTTP with an end to its patience: the head of a request must come soon."""

    _limit: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._limit = self.loop.call_later(HEAD_WITHIN, self._too_slow)

    def handle_events(self) -> None:
        super().handle_events()
        if self.scope is not None and self._limit is not None:  # pyright: ignore[reportUnnecessaryComparison]
            self._limit.cancel()
            self._limit = None

    def connection_lost(self, exc: Exception | None) -> None:
        if self._limit is not None:
            self._limit.cancel()
        super().connection_lost(exc)

    def _too_slow(self) -> None:
        _log.warning("no request within %g s; let go", HEAD_WITHIN)
        self.transport.abort()


class Server:
    """A station that listens; `run` serves until it is stopped."""

    def __init__(
        self, connect: Connect, host: str = "127.0.0.1", port: int = PORT,
        certificate: tuple[Path, Path] | None = None, stale: float | None = None,
    ) -> None:  # fmt: skip
        """certificate: files of certificate and key, for TLS. Raises CohelmError."""
        self.token = None if is_loopback(host) else secrets.token_urlsafe(16)
        self.station = Station(connect, self.token, **({} if stale is None else {"stale": stale}))
        self.secure = certificate is not None
        options: dict[str, Any] = {}
        if certificate is not None:
            options = {"ssl_certfile": certificate[0], "ssl_keyfile": certificate[1],
                       "ssl_version": ssl.PROTOCOL_TLS_SERVER}  # fmt: skip
        self._socket = _listening(host, port)
        self.host, self.port = host, self._socket.getsockname()[1]
        config = uvicorn.Config(
            self.station.app(), http=_Patient, ws="websockets-sansio", loop="asyncio",
            ws_max_size=LARGEST_MESSAGE, ws_ping_interval=20.0, ws_ping_timeout=20.0,
            limit_concurrency=MOST_CONNECTIONS, timeout_keep_alive=5,
            h11_max_incomplete_event_size=16_384, timeout_graceful_shutdown=1, access_log=False,
            log_config=None, server_header=False,
            date_header=False, proxy_headers=False, lifespan="on", **options,
        )  # fmt: skip
        self._server = uvicorn.Server(config)

    @property
    def address(self) -> str:
        """What to open in a browser; with the token in it where one is needed."""
        host = self.host
        if host in ("0.0.0.0", "::"):
            host = socket.gethostname()
        elif ":" in host:
            host = f"[{host}]"
        token = "" if self.token is None else f"#token={self.token}"
        return f"{'https' if self.secure else 'http'}://{host}:{self.port}/{token}"

    def run(self) -> None:
        """Serve until `stop`, or until a signal to the process says so."""
        asyncio.run(self._server.serve(sockets=[self._socket]))

    def stop(self) -> None:
        """Let `run` return; from any thread."""
        self._server.should_exit = True

    @property
    def started(self) -> bool:
        """Whether pages are served by now."""
        return self._server.started


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen()  # who opens the address as soon as it is printed waits, and is served
    except (OSError, OverflowError) as error:
        listening.close()
        cure = "choose another with --port (0 takes a free one)"
        raise CohelmError(f"can not listen on {host} port {port}: {error}; {cure}") from None
    return listening
