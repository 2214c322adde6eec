"""The web application: the page, the login, the WebSocket of each operator, records to fetch."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import time
from collections.abc import AsyncGenerator
from importlib.resources import files
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from cohelm.core.errors import CohelmError
from cohelm.station.doors import COOKIE, Doorkeeper, own_name, same_origin
from cohelm.station.operator import Operator
from cohelm.station.records import pieces
from cohelm.station.robot_link import Connect

STALE = 0.25
"""A stick that was not heard of for so long is gone [s]."""
MOST_OPERATORS = 12
GRACE = 5.0
"""How long an operator without a page is kept, so that it can be loaded again [s]."""
_WATCH = 0.02
_TOKEN_BYTES = 256
_BODY_WITHIN = 5.0
_log = logging.getLogger("cohelm.station")

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


def pages() -> Path:
    """Where the built pages are. CohelmError where they were not built."""
    folder = Path(str(files("cohelm.station") / "static"))
    if not (folder / "index.html").is_file():
        raise CohelmError("the station's pages are not built in this checkout; run: tools/web.sh")
    return folder


class Station:
    """All operators of one station."""

    def __init__(self, connect: Connect, token: str | None = None, stale: float = STALE) -> None:
        self.connect, self.stale = connect, stale
        self.doors = Doorkeeper(token)
        self.operators: dict[str, Operator] = {}
        self._count = 0
        self._leaving: set[asyncio.Task[None]] = set()

    def app(self) -> ASGIApp:
        """What a web server serves."""
        folder = pages()

        async def index(_: Request) -> Response:
            return FileResponse(folder / "index.html", headers={"cache-control": "no-cache"})

        async def icon(_: Request) -> Response:
            return FileResponse(folder / "icon.svg")

        return Starlette(
            routes=[
                Route("/", index),
                Route("/icon.svg", icon),
                Route("/session", self._session, methods=["GET", "POST"]),
                Route("/records/{name}", self._record),
                WebSocketRoute("/ws", self._socket),
                Mount("/assets", StaticFiles(directory=folder / "assets")),
            ],
            middleware=[Middleware(_Guarded)],
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
                *self._leaving, *(asyncio.to_thread(o.link.close) for o in self.operators.values())
            )
            self.operators.clear()

    async def _watch(self) -> None:
        """50 times a second: sticks that are gone, operators that are gone."""
        while True:
            await asyncio.sleep(_WATCH)
            now = time.monotonic()
            here = [o.name for o in self.operators.values() if o.socket is not None]
            names = {o.client: o.name for o in self.operators.values() if o.client}
            for operator in list(self.operators.values()):
                operator.others, operator.names = here, names
                operator.watch(now)
                if operator.socket is None and now - operator.left > GRACE:
                    del self.operators[operator.key]
                    # closing waits for threads, and nobody's stick may wait for that
                    leaving = asyncio.create_task(asyncio.to_thread(operator.link.close))
                    self._leaving.add(leaving)
                    leaving.add_done_callback(self._leaving.discard)
                    _log.info("%s left", operator.name)

    def _authorised(self, connection: HTTPConnection) -> bool:
        return self.doors.knows(connection.cookies.get(COOKIE))

    async def _session(self, request: Request) -> Response:
        """GET: whether the page may come in. POST: the token, for a cookie."""
        if request.method == "GET":
            return Response(status_code=204 if self._authorised(request) else 401)
        address = request.client.host if request.client else ""
        secure = request.url.scheme == "https"
        if not same_origin(request.headers.get("origin"), request.headers.get("host", ""), secure):
            return PlainTextResponse("from another page", 403)
        if not self.doors.may_try(address):
            return PlainTextResponse("too many attempts", 429)
        token = await _body(request)
        cookie = None if token is None else self.doors.shown(token, address)
        if cookie is None:
            _log.warning("a wrong token from %s", address)
            return PlainTextResponse("wrong token", 403)
        answer = Response(status_code=204)
        answer.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", secure=secure)
        return answer

    async def _record(self, request: Request) -> Response:
        """A record of the robot, in pieces as they come."""
        if not self._authorised(request):
            return PlainTextResponse("log in first", 401)
        name = request.path_params["name"]
        stream = pieces(self.connect, name)
        try:
            first = await anext(stream)
        except StopAsyncIteration:
            return PlainTextResponse(f"the robot has no record called {name!r}", 404)
        except TimeoutError:
            return PlainTextResponse("the robot does not send it; try again", 504)

        async def whole() -> AsyncGenerator[bytes]:
            yield first
            async for piece in stream:
                yield piece

        return StreamingResponse(
            whole(), media_type="application/octet-stream",
            headers={"content-disposition": "attachment"},
        )  # fmt: skip

    async def _socket(self, socket: WebSocket) -> None:
        host = socket.headers.get("host", "")
        origin = socket.headers.get("origin")
        if not same_origin(origin, host, socket.url.scheme == "wss"):
            _log.warning("a WebSocket from %r is refused", origin)
            await socket.close(1008)
            return
        if not self._authorised(socket):
            await socket.close(1008)
            return
        operator = self._operator(socket.query_params.get("key"))
        if operator is None:
            await socket.accept()
            await socket.close(1013, "too many operators")
            return
        await socket.accept()
        try:
            await operator.attend(socket)
        except Exception:
            _log.exception("the page of %s broke down", operator.name)

    def _operator(self, key: str | None) -> Operator | None:
        """Who comes again is who it was, unless that one is here already: a second tab."""
        known = self.operators.get(key or "")
        if known is not None and known.socket is None:
            return known
        if len(self.operators) >= MOST_OPERATORS:
            return None
        self._count += 1
        key = secrets.token_urlsafe(16)
        operator = Operator(key, f"operator {self._count}", self.connect, self.stale)
        self.operators[key] = operator
        _log.info("%s is here", operator.name)
        return operator


async def _body(request: Request) -> str | None:
    """A short body that comes soon, or None."""
    body = b""
    try:
        async with asyncio.timeout(_BODY_WITHIN):
            async for chunk in request.stream():
                body += chunk
                if len(body) > _TOKEN_BYTES:
                    return None
    except TimeoutError:
        return None
    return body.decode(errors="replace")


class _Guarded:
    """Refuses what calls this machine by a name it does not have; adds the headers."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        host = HTTPConnection(scope).headers.get("host", "")
        if not own_name(host):
            _log.warning("refused: called by the name %r", host)
            if scope["type"] == "http":
                await PlainTextResponse("unknown host name", 421)(scope, receive, send)
            else:
                await send({"type": "websocket.close", "code": 1008})
            return

        async def headed(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = [(k.encode(), v.encode()) for k, v in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        await self.app(scope, receive, headed)
