"""Shows a drive live in Foxglove and Lichtblick: the topics of a record, over WebSocket.

The server is a process of its own. The loop and the gate process send it the same messages as the
recorder; they never wait for it, and it never waits for a viewer. A viewer can only subscribe, and
steer where that is allowed (`foxglove_teleop`). The protocol is Foxglove's
(https://github.com/foxglove/ws-protocol, docs/spec.md).
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import logging
import os
import pickle
import secrets
import signal
import socket
import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, cast

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from cohelm.drive.foxglove_teleop import ENCODINGS, FoxgloveTeleop, Joined, PublishedTwists
from cohelm.drive.recorder import EventSink, receive
from cohelm.link.udp import bracketed, listening, resolved
from cohelm.record.topics import IMAGE, LASTING, RecordTopics, definitions
from cohelm.robot.keep.record_pipe import ALIVE
from cohelm.robot.model import RobotModel
from cohelm.ros.foxglove_protocol import DATA, ERROR, FROM_SERVER, PROTOCOLS

PORT = 8766
"""8765 is the port of the page, and of foxglove_bridge."""
QUEUE_LIMIT = 1 << 20
"""Queue limit of a viewer, besides latched topics; beyond it, queued messages are dropped [B]."""
MAX_VIEWERS = 16
"""Viewers at once."""
STUCK_TIMEOUT = 10.0
"""A viewer that receives nothing for so long is disconnected [s]."""
_SEND_BUFFER = 1 << 18
"""Socket send buffer of each viewer [B]: what is in it can not be dropped."""
_OPEN = 10.0
_CLOSE = 1.0
"""Time limits for opening and closing a connection [s]."""
_HEARTBEAT = 0.5
"""Period of the heartbeat [s]."""
_LARGEST = 1 << 16
"""Largest message from a viewer [B]."""
_NO_TELEOP = "read-only view: to steer, start the robot with --foxglove-teleop"


@dataclass(frozen=True)
class LiveConfig:
    """Address of a live view, and what a viewer may do."""

    host: str = "127.0.0.1"
    port: int = PORT
    """0: any free port."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    """A viewer must have it."""
    teleop: bool = False
    """Whether viewers may steer, too; on loopback only."""
    joined: Joined | None = None
    """How the robot's link is joined to steer; None: there is no link yet."""

    @property
    def address(self) -> str:
        """To be opened as *Foxglove WebSocket*."""
        host = bracketed(self.host)
        if self.host in ("0.0.0.0", "::"):
            host = socket.gethostname()
        return f"ws://{host}:{self.port}/{self.token}"


class Live(EventSink):
    """A running server. `loop` and `gated` are the ends to write to, see `RecordLine`."""

    def __init__(self, config: LiveConfig, model: RobotModel) -> None:
        """Raises CohelmError if it can not listen."""
        where = resolved(config.host, config.port, socket.SOCK_STREAM)[1]
        served = listening(where, "choose another with --foxglove HOST:PORT")
        port = served.getsockname()[1]
        self.address = LiveConfig(config.host, port, config.token).address
        """Includes the token."""
        try:
            super().__init__("cohelm live", _main, served, config.token, model, config.joined)
        finally:
            served.close()

    def close(self) -> None:
        """End the server; viewers are disconnected."""
        self.close_lines()
        self._process.join(2.0 * _CLOSE + 3.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _main(
    served: socket.socket, token: str, model: RobotModel, joined: Joined | None,
    loop: socket.socket, gated: socket.socket,
) -> None:  # fmt: skip
    """Main function of the server process. It ends when both lines are closed."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    os.nice(5)  # loop, gate process and recorder come first
    teleop = None if joined is None else FoxgloveTeleop(joined)
    asyncio.run(_serve(served, LiveServer(model, token, teleop), [loop, gated]))
    if teleop is not None:
        teleop.close()


async def _serve(served: socket.socket, server: LiveServer, lines: list[socket.socket]) -> None:
    silent = logging.Logger("cohelm.live", logging.CRITICAL)  # strangers fill no terminal
    served.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
    async with serve(
        server.attend, sock=served, process_request=server.admit, subprotocols=PROTOCOLS,
        compression=None, max_size=_LARGEST, max_queue=4, open_timeout=_OPEN, close_timeout=_CLOSE,
        server_header=None, logger=silent,
    ):  # fmt: skip
        await _receive_all(server, lines)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_CLOSE):
                await server.drained()


async def _receive_all(server: LiveServer, lines: list[socket.socket]) -> None:
    """Receive until all lines are closed. lines: the first one is the loop's."""
    running, closed = asyncio.get_running_loop(), [asyncio.Event() for _ in lines]

    def on_readable(end: socket.socket, over: asyncio.Event) -> None:
        try:
            message = receive(end)
        except EOFError:
            running.remove_reader(end)
            over.set()
            return
        if message is not None:
            server.take(message)

    for end, over in zip(lines, closed, strict=True):
        running.add_reader(end, on_readable, end, over)
    signs = asyncio.create_task(_heartbeat(server, lines[0]))
    for over in closed:
        await over.wait()
    signs.cancel()


async def _heartbeat(server: LiveServer, loop: socket.socket) -> None:
    """Send heartbeats to the loop, and whether a viewer subscribes to the camera."""
    sent = False
    while True:
        with contextlib.suppress(OSError):  # the loop has ended, or does not read
            loop.send(ALIVE, socket.MSG_DONTWAIT)
            wanted = server.wanted(IMAGE)
            if wanted != sent:
                loop.send(pickle.dumps(wanted), socket.MSG_DONTWAIT)
                sent = wanted
        await asyncio.sleep(_HEARTBEAT)


class LiveServer:
    """Forwards messages to their subscribers; latched topics also to later subscribers."""

    def __init__(self, model: RobotModel, token: str, teleop: FoxgloveTeleop | None = None) -> None:
        """teleop: steers for the viewers; None: no viewer may steer."""
        self._teleop = teleop
        self._model, self._path = model, f"/{token}".encode()
        self._topics: RecordTopics | None = None
        self._viewers: set[_Viewer] = set()
        self._last: dict[str, tuple[int, bytes]] = {}
        made = definitions(model)
        self._channels = dict(enumerate(made, 1))
        info: dict[str, Any] = {
            "op": "serverInfo", "name": f"cohelm {model.name}",
            "capabilities": [] if teleop is None else ["clientPublish"],
            "supportedEncodings": [] if teleop is None else [*ENCODINGS],
            "metadata": {}, "sessionId": secrets.token_hex(8),
        }  # fmt: skip
        channels = [
            {
                "id": number, "topic": topic, "encoding": "cdr", "schemaName": made[topic].name,
                "schemaEncoding": "ros2msg", "schema": made[topic].text,
            }
            for number, topic in self._channels.items()
        ]  # fmt: skip
        advertised = {"op": "advertise", "channels": channels}
        self._greetings = [json.dumps(info), json.dumps(advertised)]

    def take(self, message: Any) -> None:
        """Take a message of loop or gate process; the first is the time stamp of t = 0 [ns]."""
        if isinstance(message, int):
            self._topics = RecordTopics(message, self.put, self._model, self.wanted)
            self._topics.begin()
        elif self._topics is not None:
            self._topics.write(message)

    def wanted(self, topic: str) -> bool:
        """Whether a topic is latched or has a subscriber."""
        return topic in LASTING or any(topic in one.subscribed for one in self._viewers)

    def put(self, topic: str, data: bytes, stamp: int, _: int | None) -> None:
        """Forward one message, in CDR. stamp: [ns]."""
        if topic in LASTING:
            self._last[topic] = stamp, data
        for one in self._viewers:
            one.give(topic, stamp, data)

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse a connection without the token."""
        if hmac.compare_digest(request.path.encode(), self._path):
            return None
        hint = "use the whole address that cohelm prints, with the token after the last /\n"
        return connection.respond(HTTPStatus.UNAUTHORIZED, hint)

    async def attend(self, connection: ServerConnection) -> None:
        """Serve one viewer until it disconnects."""
        if len(self._viewers) >= MAX_VIEWERS:
            await connection.close(1013, "too many viewers")
            return
        viewer = _Viewer(connection, self._greetings, self._teleop)
        tasks = [asyncio.create_task(viewer.send_queue())]
        if self._teleop is not None:
            tasks.append(asyncio.create_task(viewer.published.keep_alive(connection)))
        self._viewers.add(viewer)
        try:
            async for message in connection:
                self._on_message(viewer, message)
        except ConnectionClosed:
            pass
        finally:
            self._viewers.discard(viewer)
            viewer.published.gone()
            for one in tasks:
                one.cancel()

    async def drained(self) -> None:
        """Wait until all viewers' queues are empty."""
        while any(one.waits for one in self._viewers):
            await asyncio.sleep(0.02)

    def _on_message(self, viewer: _Viewer, data: str | bytes) -> None:
        """Subscribe and unsubscribe, and publish where viewers may steer."""
        try:
            if isinstance(data, bytes) and self._teleop is not None:
                viewer.published.take(data)
                return
            request: Any = json.loads(data)
            match request["op"]:
                case "subscribe":
                    for one in _listed(request["subscriptions"]):
                        topic = self._channels[one["channelId"]]
                        if viewer.subscribe(topic, one["id"]) and topic in self._last:
                            viewer.give(topic, *self._last[topic])
                case "unsubscribe":
                    for number in _listed(request["subscriptionIds"]):
                        viewer.unsubscribe(number)
                case "advertise" if self._teleop is not None:
                    for one in _listed(request["channels"]):
                        viewer.published.advertise(one)
                case "unadvertise" if self._teleop is not None:
                    for number in _listed(request["channelIds"]):
                        viewer.published.unadvertise(number)
                case "advertise" | "unadvertise":
                    viewer.report(_NO_TELEOP)
                case _:
                    viewer.report("read-only view: no publishing, parameters or services")
        except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError, struct.error):
            viewer.report("invalid message")


class _Viewer:
    """One viewer and its send queue."""

    def __init__(
        self, connection: ServerConnection, greetings: list[str],
        teleop: FoxgloveTeleop | None = None,
    ) -> None:  # fmt: skip
        self._connection = connection
        self.published = PublishedTwists(teleop, self.report)
        """The twists that this viewer publishes."""
        self._waiting: deque[tuple[str, str | bytes]] = deque(("", one) for one in greetings)
        self._size = 0
        self._waker = asyncio.Event()
        self._waker.set()
        self.subscribed: dict[str, int] = {}
        """Subscription number of each topic."""

    @property
    def waits(self) -> bool:
        """Whether messages are queued."""
        return bool(self._waiting)

    def subscribe(self, topic: str, number: int) -> bool:
        """Subscribe once to a topic; whether the subscription is new."""
        FROM_SERVER.pack(DATA, number, 0)  # struct.error: no number that can be sent
        return self.subscribed.setdefault(topic, number) == number

    def unsubscribe(self, number: int) -> None:
        """End a subscription."""
        self.subscribed = {topic: own for topic, own in self.subscribed.items() if own != number}

    def give(self, topic: str, stamp: int, data: bytes) -> None:
        """Queue a message if its topic is subscribed to. stamp: [ns]."""
        if topic in self.subscribed:
            self._put(topic, FROM_SERVER.pack(DATA, self.subscribed[topic], stamp) + data)

    def report(self, text: str) -> None:
        """Show a text in the viewer's list of problems."""
        self._put("", json.dumps({"op": "status", "level": ERROR, "message": text}))

    def _put(self, topic: str, data: str | bytes) -> None:
        self._waiting.append((topic, data))
        self._size += len(data)
        if self._size > QUEUE_LIMIT:  # too slow: keep the newest, and the latched
            newest = self._waiting.pop()
            kept = {topic: (topic, data) for topic, data in self._waiting if topic in LASTING}
            self._waiting = deque((*kept.values(), newest))
            self._size = sum(len(data) for _, data in self._waiting)
        self._waker.set()

    async def send_queue(self) -> None:
        """Send the queue until the connection ends; close a connection that is stuck."""
        with contextlib.suppress(ConnectionClosed):
            while await self._waker.wait():
                self._waker.clear()
                while self._waiting:
                    _, data = self._waiting.popleft()
                    self._size -= len(data)
                    try:
                        async with asyncio.timeout(STUCK_TIMEOUT):
                            await self._connection.send(data)
                    except TimeoutError:
                        self._connection.transport.abort()
                        return


def _listed(found: Any) -> Iterator[Any]:
    if not isinstance(found, list):
        raise TypeError
    return iter(cast("list[Any]", found))
