"""Records of the robot, downloaded whole or not at all, over a link of their own.

The robot sends a record's length and SHA-256, then the requested pieces. At most `AHEAD` is
requested beyond what the browser has read: a slow browser slows the robot down and fills no memory.
The last piece is only passed on when the whole has the hash. An error after the first byte closes
the connection before the announced length, so that no browser takes it for the whole.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hashlib
import logging
import math
import re
import time
from collections.abc import AsyncGenerator

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from cohelm.core.errors import CohelmError
from cohelm.link.bulk_messages import Digest, Piece
from cohelm.station.robot_link import Connect, ReplayLink, RobotLink

WINDOW = 131_072
"""Size of one request [byte]."""
AHEAD = 1_048_576
"""Largest amount requested and not read yet [byte]: 7 MB/s over a round trip of 150 ms."""
PIECE_WITHIN = 20.0
"""A robot that sends nothing for so long has given up; at its slowest a piece takes 3 s [s]."""
AGAIN_AFTER = 6.0
"""What has not arrived by then was lost with a connection, and is requested again [s]."""
TAKEN_WITHIN = 60.0
"""A browser that reads nothing for so long is disconnected [s]."""
DIGEST_WITHIN = 300.0
"""The robot reads all of a record for its hash; 10 GB at 40 MB/s, from a slow card [s]."""
MOST_AT_ONCE = 3
"""Each is a client of the robot, which has 16 in all; the operators have 12 of them."""
_POLL = 0.01
_RANGE = re.compile(r"bytes=(\d*)-(\d*)")
_log = logging.getLogger("cohelm.station")


class Broken(Exception):
    """A download can not continue, and why."""


class Downloads:
    """All downloads of a station."""

    def __init__(self, connect: Connect) -> None:
        self._connect = connect
        self._going = 0

    async def about(self, name: str) -> Digest:
        """Size and hash of a record. HTTPException with the reason why not."""
        async with self._link() as link:
            return await _about(link, name)

    async def response(self, request: Request, name: str) -> Response:
        """The record, or the part of it that a Range header asks for. HTTPException as above."""
        stack = contextlib.AsyncExitStack()
        try:
            link = await stack.enter_async_context(self._link())
            about = await _about(link, name)
            headers = {
                "accept-ranges": "bytes", "etag": f'"{about.sha256.hex()}"',
                "repr-digest": f"sha-256=:{base64.b64encode(about.sha256).decode()}:",
                "content-disposition": "attachment", "content-type": "application/octet-stream",
                "cache-control": "no-store",
            }  # fmt: skip
            part = _part(request, about.size, headers["etag"])
            if part is None:
                return Response(status_code=416, headers={"content-range": f"bytes */{about.size}"})
            first, end = part
            headers["content-length"] = str(end - first)
            if part == (0, about.size):
                status = 200
            else:
                status = 206
                headers["content-range"] = f"bytes {first}-{end - 1}/{about.size}"
            if request.method == "HEAD":
                return Response(status_code=status, headers=headers)
            return _Streamed(status, headers, pieces(link, about, first, end), stack.pop_all())
        finally:
            await stack.aclose()

    @contextlib.asynccontextmanager
    async def _link(self) -> AsyncGenerator[RobotLink]:
        if self._going >= MOST_AT_ONCE:
            raise HTTPException(
                503,
                f"{MOST_AT_ONCE} downloads are running: wait for one of them, then click again",
                {"retry-after": "5"},
            )
        self._going += 1
        try:
            try:
                link = await asyncio.to_thread(self._connect, "a download")
            except CohelmError as error:
                raise HTTPException(503, str(error)) from error
            try:
                yield link
            finally:
                await asyncio.to_thread(link.close)
        finally:
            self._going -= 1


def _part(request: Request, size: int, tag: str) -> tuple[int, int] | None:
    """First byte, and the one after the last, of the requested range; None: invalid."""
    match = _RANGE.fullmatch(request.headers.get("range", ""))
    if match is None or request.headers.get("if-range", tag) != tag or match[0] == "bytes=-":
        return 0, size
    if not match[1]:
        first, end = max(size - int(match[2]), 0), size
    else:
        first = int(match[1])
        end = min(int(match[2]) + 1, size) if match[2] else size
    return (first, end) if first < end else None


async def _about(link: RobotLink, name: str) -> Digest:
    if isinstance(link, ReplayLink):
        raise HTTPException(404, "this is a replay: there is no robot with other records")
    began = time.monotonic()
    again = -math.inf
    while (now := time.monotonic()) - began < DIGEST_WITHIN:
        if now - again > AGAIN_AFTER:  # also where a connection was lost meanwhile
            link.fetch(name)
            again = now
        for news in link.news():
            if isinstance(news.message, Digest) and news.message.name == name:
                if news.message.why:
                    raise HTTPException(404, news.message.why)
                return news.message
        if not link.state().connected and now - began > PIECE_WITHIN:
            break
        await asyncio.sleep(_POLL)
    raise HTTPException(504, "the robot does not send it; try again")


async def pieces(link: RobotLink, about: Digest, first: int, end: int) -> AsyncGenerator[bytes]:
    """The bytes of a record from `first` to before `end`.

    Raises Broken where they do not come, or not as they were.
    """
    at = requested = first
    whole = (first, end) == (0, about.size)
    hasher, held = hashlib.sha256(), b""
    since = requested_at = time.monotonic()
    while at < end:
        while requested < end and requested - at < AHEAD:
            size = min(WINDOW, end - requested)
            link.fetch(about.name, requested, size)
            requested += size
        for news in link.news():
            piece = news.message
            if not isinstance(piece, Piece) or piece.name != about.name or piece.offset != at:
                continue  # of before a connection was lost
            if not piece.data or at + len(piece.data) > end:
                raise Broken(f"the robot sends {about.name} with another size")
            at += len(piece.data)
            hasher.update(piece.data)
            if held:
                yield held
            held = piece.data
            since = requested_at = time.monotonic()  # also after a browser took its time
        now = time.monotonic()
        if now - since > PIECE_WITHIN:
            raise Broken(f"the robot stopped sending {about.name}")
        if now - requested_at > AGAIN_AFTER:
            requested, requested_at = at, now
        if at < end:
            await asyncio.sleep(_POLL)
    if whole and hasher.digest() != about.sha256:
        raise Broken(f"{about.name} is damaged: its SHA-256 is not the robot's")
    if held:
        yield held


class _Streamed(Response):
    """A body of known length that is broken off where it can not be whole."""

    def __init__(
        self, status: int, headers: dict[str, str], body: AsyncGenerator[bytes],
        stack: contextlib.AsyncExitStack,
    ) -> None:  # fmt: skip
        self.status_code, self.background = status, None
        self.init_headers(headers)
        self._pieces, self._stack = body, stack

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        gone = asyncio.create_task(_gone(receive))
        try:
            start = {"type": "http.response.start", "status": self.status_code}
            await send({**start, "headers": self.raw_headers})
            async for piece in self._pieces:
                if gone.done():
                    return
                body = {"type": "http.response.body", "body": piece, "more_body": True}
                await asyncio.wait_for(send(body), TAKEN_WITHIN)
            await send({"type": "http.response.body", "body": b""})
        except Broken as broken:  # the server breaks off a response that is left unfinished
            _log.warning("download aborted: %s", broken)
        except TimeoutError:
            _log.warning("download aborted: the browser does not read")
        except asyncio.CancelledError:
            _log.warning("download aborted: the station shuts down")
        finally:
            gone.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._pieces.aclose()
                await self._stack.aclose()


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
