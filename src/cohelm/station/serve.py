"""The web server of the application: addresses, TLS, limits, timeouts."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import secrets
import signal
import socket
import ssl
import threading
from asyncio import Transport
from collections.abc import Generator
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from cohelm.link.operator import STALE
from cohelm.link.udp import bracketed, listening
from cohelm.station.app import Station
from cohelm.station.listening_socket import ListeningSocket
from cohelm.station.robot_link import Connect
from cohelm.station.tls import certified

PORT = 8765
HEAD_WITHIN = 5.0
"""Time limit of a whole request, also of the next one on a connection [s]."""
DONE_WITHIN = 20.0
"""Time limit of request and response, without a session [s]."""
LARGEST_MESSAGE = 16_384
"""Largest message from a page [B]."""
_BACKLOG = 128
_CURE = "choose another with --port (0 takes a free one), or with --host an address of this machine"
_log = logging.getLogger("cohelm.station")


def _with_time_limits(listener: ListeningSocket) -> type[H11Protocol]:
    """The class of HTTP connections with time limits, however slowly data arrives."""

    class TimeLimited(H11Protocol):
        _limit: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            listener.made(self._client, transport.abort)
            self._set_limit(HEAD_WITHIN)

        def handle_events(self) -> None:
            before = self.scope
            super().handle_events()
            if self.scope is before:
                return
            listener.served(self._client)
            upgraded = self.transport.get_protocol() is not self
            self._set_limit(None if upgraded else DONE_WITHIN)

        def on_response_complete(self) -> None:
            listener.served(self._client)
            self._set_limit(HEAD_WITHIN)  # first: a pipelined request may begin in the next line
            super().on_response_complete()

        def connection_lost(self, exc: Exception | None) -> None:
            self._set_limit(None)
            super().connection_lost(exc)

        @property
        def _client(self) -> tuple[str, int]:
            return self.client or ("", 0)

        def _set_limit(self, seconds: float | None) -> None:
            if self._limit is not None:
                self._limit.cancel()
            self._limit = None if seconds is None else self.loop.call_later(seconds, self._expire)

        def _expire(self) -> None:
            if listener.is_admitted(self._client):  # a long download
                return
            _log.info("no complete request in time; closed")
            self.transport.abort()

    return TimeLimited


class Server:
    """The web server of a station; `run` serves until it is stopped."""

    def __init__(
        self, connect: Connect, host: str = "127.0.0.1", port: int = PORT,
        certificate: tuple[Path, Path] | None = None, stale: float = STALE,
    ) -> None:  # fmt: skip
        """certificate: files of certificate and key, for TLS. Raises CohelmError."""
        self.token = secrets.token_urlsafe(16)
        # It listens from here on: a page opened as soon as the address is printed is served later.
        self._listener = ListeningSocket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        listening((host, port), _CURE, self._listener, _BACKLOG)
        self._names = frozenset[str]() if certificate is None else certified(certificate[0])
        self.station = Station(connect, self.token, self._names, self._listener.admitted, stale)
        self.secure = certificate is not None
        options: dict[str, Any] = {}
        if certificate is not None:
            options = {"ssl_certfile": certificate[0], "ssl_keyfile": certificate[1],
                       "ssl_version": ssl.PROTOCOL_TLS_SERVER}  # fmt: skip
        self.host, self.port = host, self._listener.getsockname()[1]
        config = uvicorn.Config(
            self.station.app(), http=_with_time_limits(self._listener), ws="websockets-sansio",
            loop="asyncio", backlog=_BACKLOG,
            ws_max_size=LARGEST_MESSAGE, ws_ping_interval=20.0, ws_ping_timeout=20.0,
            timeout_keep_alive=5,
            h11_max_incomplete_event_size=16_384, timeout_graceful_shutdown=1, access_log=False,
            log_config=None, log_level="warning",  # below that it logs sessions
            server_header=False,
            date_header=False, proxy_headers=False, lifespan="on", **options,
        )  # fmt: skip
        self._server = _GracefulServer(config)

    @property
    def address(self) -> str:
        """The URL to open in a browser, with the token in its fragment.

        A browser sends the fragment (after #) nowhere: not to the server, so it is in no log, and
        not to other pages as Referer.
        """
        return f"{self.origin}/#token={self.token}"

    @property
    def origin(self) -> str:
        """The URL of the page, without the token."""
        host = self.host
        if host in ("0.0.0.0", "::"):
            host = socket.gethostname()
            if self._names and host.lower() not in self._names:
                host = min(self._names)  # a name that the browser accepts
        return f"{'https' if self.secure else 'http'}://{bracketed(host)}:{self.port}"

    def run(self) -> None:
        """Serve until `stop`, or until a signal ends the process."""
        gc.freeze()  # a collection over all imports would delay the stick by 0.1 s
        with self._server.ended_with_terminal():
            asyncio.run(self._server.serve(sockets=[self._listener]))

    def stop(self) -> None:
        """Make `run` return; from any thread."""
        self._server.should_exit = True

    @property
    def interrupted(self) -> bool:
        """Whether a signal to this process, such as Ctrl-C, has ended `run`."""
        return self._server.interrupted

    @property
    def started(self) -> bool:
        """Whether pages are served."""
        return self._server.started


class _GracefulServer(uvicorn.Server):
    """A server that ignores a second Ctrl-C: it ends within a second anyway, and to abort that
    would only print a traceback."""

    interrupted = False

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        if not self.should_exit:
            self.interrupted = True
            super().handle_exit(sig, frame)

    @contextlib.contextmanager
    def ended_with_terminal(self) -> Generator[None]:
        """Take the end of the terminal as SIGTERM, which uvicorn handles; not where it is ignored,
        as under `nohup`."""
        main = threading.current_thread() is threading.main_thread()
        if not main or signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
            yield
            return
        before = signal.signal(
            signal.SIGHUP, lambda _, frame: self.handle_exit(signal.SIGTERM, frame)
        )
        try:
            yield
        finally:
            signal.signal(signal.SIGHUP, before)
