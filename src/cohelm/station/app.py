"""The web application: the page, the login, the WebSocket of each operator, record downloads.

A page sends its session with each request: as `Authorization: Bearer SESSION`, for a WebSocket as
its second subprotocol, and for a download as a ticket for that record. So a request that another
page, or another program on this machine, makes a browser send carries no session.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import time
from collections.abc import AsyncGenerator, Callable, Collection
from importlib.resources import files
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from cohelm.core.errors import CohelmError
from cohelm.link.operator import STALE
from cohelm.station.access_control import AccessControl, is_cross_site, is_own_host, same_origin
from cohelm.station.operator import PageOperator
from cohelm.station.records import Downloads
from cohelm.station.robot_link import Connect

MOST_OPERATORS = 12
PROTOCOL = "cohelm"
"""First subprotocol of the WebSocket; the second is the session."""
GRACE = 5.0
"""How long an operator without a page is kept, so that the page can be reloaded [s]."""
_WATCH = 0.1
_TOKEN_BYTES = 256
_BODY_WITHIN = 5.0
_LONGEST_REASON = 120  # of a closed WebSocket (RFC 6455 5.5.1)
_log = logging.getLogger("cohelm.station")

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "connection": "close",
}
"""Headers of all responses. One request per connection: a page needs three, and no client holds a
connection or sends a thousand requests on one."""


def pages() -> Path:
    """Folder of the built pages. Raises CohelmError if they are not built."""
    folder = Path(str(files("cohelm.station") / "static"))
    if not (folder / "index.html").is_file():
        raise CohelmError("the station's pages are not built in this checkout; run: tools/web.sh")
    return folder


class Station:
    """All operators of one station."""

    def __init__(
        self, connect: Connect, token: str, names: Collection[str] = (),
        admitted: Callable[[tuple[str, int]], None] = lambda _: None, stale: float = STALE,
    ) -> None:  # fmt: skip
        """names: further host names of this machine. admitted: called with authorised clients."""
        self.connect, self.stale = connect, stale
        self._access = AccessControl(token)
        self._names, self._admitted = names, admitted
        self._downloads = Downloads(connect)
        self.operators: dict[str, PageOperator] = {}
        self._count = self._connecting = 0
        self._closing: set[asyncio.Task[None]] = set()

    def app(self) -> ASGIApp:
        """The ASGI application."""
        folder = pages()
        html, svg = (folder / "index.html").read_bytes(), (folder / "icon.svg").read_bytes()

        async def index(_: Request) -> Response:  # from memory: no file, no thread for strangers
            return Response(html, media_type="text/html", headers={"cache-control": "no-cache"})

        async def icon(_: Request) -> Response:
            return Response(svg, media_type="image/svg+xml")

        return Starlette(
            routes=[
                Route("/", index),
                Route("/icon.svg", icon),
                Route("/session", self._session, methods=["GET", "POST"]),
                Route("/records/{name}", self._record, methods=["GET", "POST"]),
                WebSocketRoute("/ws", self._socket),
                Mount("/assets", StaticFiles(directory=folder / "assets")),
            ],
            middleware=[Middleware(_Guarded, names=self._names)],
            lifespan=self._life,
        )

    @contextlib.asynccontextmanager
    async def _life(self, _: Starlette) -> AsyncGenerator[None]:
        watch = asyncio.create_task(self._watch())
        try:
            yield
        finally:
            watch.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await watch
            await asyncio.gather(
                *self._closing, *(asyncio.to_thread(o.link.close) for o in self.operators.values())
            )
            self.operators.clear()

    async def _watch(self) -> None:
        """Tell all operators of each other, and remove those that have gone."""
        while True:
            await asyncio.sleep(_WATCH)
            now = time.monotonic()
            present = [o.name for o in self.operators.values() if o.socket is not None]
            names = {o.client: o.name for o in self.operators.values() if o.client}
            for operator in list(self.operators.values()):
                operator.others, operator.names = present, names
                if operator.socket is None and now - operator.left > GRACE:
                    del self.operators[operator.key]
                    # closing waits for threads, and no stick may wait for that
                    closing = asyncio.create_task(asyncio.to_thread(operator.link.close))
                    self._closing.add(closing)
                    closing.add_done_callback(self._closing.discard)
                    _log.info("%s left", operator.name)

    def _authorised(self, connection: HTTPConnection, session: str | None) -> bool:
        """Whether this session is valid; its connection is then kept, however many others come."""
        if not self._access.has_session(session):
            return False
        self._admit(connection)
        return True

    def _admit(self, connection: HTTPConnection) -> None:
        if connection.client is not None:
            self._admitted((connection.client.host, connection.client.port))

    async def _session(self, request: Request) -> Response:
        """GET: whether the session is valid. POST: a session for the token."""
        if request.method != "POST":
            inside = self._authorised(request, _bearer(request))
            return Response(status_code=204 if inside else 401)
        address = request.client.host if request.client else ""
        token = await _body(request)
        session = None if token is None else self._access.login(token, address)
        if session is not None:
            return PlainTextResponse(session, headers={"cache-control": "no-store"})
        if self._access.too_many_attempts(address):
            return PlainTextResponse("too many attempts", 429)
        _log.warning("a wrong token from %s", address)
        return PlainTextResponse("wrong token", 403)

    async def _record(self, request: Request) -> Response:
        """POST: a ticket for a record of the robot, and its size and hash. GET: the record."""
        name = request.path_params["name"]
        admitted = self._authorised(request, _bearer(request))
        if request.method == "POST":
            if not admitted:
                return PlainTextResponse("log in first", 401)
            about = await self._downloads.about(name)
            ticket = self._access.ticket(name)
            described = {"ticket": ticket, "bytes": about.size, "sha256": about.sha256.hex()}
            return JSONResponse(described, headers={"cache-control": "no-store"})
        if not admitted and not self._access.ticket_valid(request.query_params.get("ticket"), name):
            return PlainTextResponse("log in first", 401)
        self._admit(request)
        return await self._downloads.response(request, name)

    async def _socket(self, socket: WebSocket) -> None:
        host = socket.headers.get("host", "")
        origin = socket.headers.get("origin")
        if not same_origin(origin, host, socket.url.scheme == "wss"):
            _log.warning("a WebSocket from %r is refused", origin)
            await socket.close(1008)
            return
        offered: list[str] = socket.scope.get("subprotocols", [])
        if len(offered) != 2 or offered[0] != PROTOCOL or not self._authorised(socket, offered[1]):
            await socket.close(1008)
            return
        await socket.accept(PROTOCOL)
        try:
            operator = await self._operator(socket.query_params.get("key"))
        except CohelmError as error:
            await socket.close(1013, str(error)[:_LONGEST_REASON])
            return
        try:
            await operator.attend(socket)
        except Exception:
            _log.exception("the page of %s failed", operator.name)

    async def _operator(self, key: str | None) -> PageOperator:
        """The operator of a key; a new one if there is none, or its page is open: a second tab.

        Raises CohelmError where there are too many, or the robot's host is not known.
        """
        known = self.operators.get(key or "")
        if known is not None and not known.is_there:
            if known.socket is not None:
                await known.leave()
            if known.socket is None:
                return known
        if len(self.operators) + self._connecting >= MOST_OPERATORS:
            raise CohelmError("too many operators")
        self._count += 1
        self._connecting += 1
        key, name = secrets.token_urlsafe(16), f"operator {self._count}"
        try:  # looking up a host may take seconds, and no stick may wait for that
            link = await asyncio.to_thread(self.connect, name)
        finally:
            self._connecting -= 1
        operator = self.operators[key] = PageOperator(key, name, link, self.stale)
        _log.info("%s connected", operator.name)
        return operator


def _bearer(request: Request) -> str | None:
    kind, _, session = request.headers.get("authorization", "").partition(" ")
    return session if kind.lower() == "bearer" else None


async def _body(request: Request) -> str | None:
    """The body, or None if it is too long or too late."""
    body = b""
    try:
        async with asyncio.timeout(_BODY_WITHIN):
            async for chunk in request.stream():
                body += chunk
                if len(body) > _TOKEN_BYTES:
                    return None
    except (TimeoutError, ClientDisconnect):
        return None
    return body.decode(errors="replace")


class _Guarded:
    """Refuses requests with an unknown host name, and from another page; adds the headers. The page
    itself holds no secret, so a link to it may be followed."""

    def __init__(self, app: ASGIApp, names: Collection[str]) -> None:
        self.app, self.names = app, names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        status, why = self._refusal(scope)
        if why:
            _log.warning("refused: %s", why)
            if scope["type"] == "http":
                await PlainTextResponse(why, status)(scope, receive, send)
            else:
                await send({"type": "websocket.close", "code": 1008})
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = [(k.encode(), v.encode()) for k, v in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        await self.app(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> tuple[int, str]:
        headers = HTTPConnection(scope).headers
        host = headers.get("host", "")
        if not is_own_host(host, self.names):
            return 421, f"unknown host name {host[:64]!r}"
        origin, site = headers.get("origin"), headers.get("sec-fetch-site")
        secure = scope["scheme"] in ("https", "wss")
        followed_link = scope["path"] == "/" and scope.get("method") == "GET" and origin is None
        if not followed_link and is_cross_site(origin, site, host, secure):
            return 403, f"from another page, {(origin or site or '')[:64]!r}"
        return 200, ""
