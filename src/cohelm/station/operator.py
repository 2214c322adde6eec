"""One operator: a page, its link to the robot, and the check that its stick is fresh.

An operator outlives its WebSocket by a few seconds, so that a reloaded page keeps its identity;
meanwhile its stick counts as lost.
"""

from __future__ import annotations

import asyncio
import json
import logging
import math
import time
from collections.abc import Hashable

from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from cohelm.link import bulk_messages as bulk, messages as robot
from cohelm.link.operator import is_current
from cohelm.link.rate import TokenBucket
from cohelm.station import messages as page, view
from cohelm.station.robot_link import News, ReplayLink, RobotLink, StartingLink

BEAT = 0.04
"""Between two beats to a page [s]."""
FRAME_RATE = 1 / 30
"""Least time between two states to a page [s]."""
LINK_EVERY = 0.25
"""[s]"""
SEND_WITHIN = 5.0
"""A page that reads nothing for this long is disconnected [s]."""
SILENT = 5.0
"""A driver's page that says nothing for this long is disconnected [s]: a connection may stay whole
for minutes while the tablet sleeps, and in automatic mode the robot would drive on."""
ROUTE_WITHIN = 15.0
"""A route to follow is answered by then, or was lost with a connection [s]: it waits for the robot
for 5 s at most, and its check takes as long."""
DEAD = 1.0
"""A page says something many times a second, a hidden one too: where one that was silent for this
long connects anew, its connection before is dead, as when a network was gone [s]."""
_POLL = 0.01
_GOT = frozenset(
    json.dumps({"type": "got", "stream": stream}, separators=(",", ":"))
    for stream in ("state", "scan", "frame")
)
"""As pages write them."""
_OTHER = "if the page is of another version, reload it; in a checkout, run make again first"
_log = logging.getLogger("cohelm.station")


class PageOperator:
    """All calls come from the event loop's thread."""

    def __init__(self, key: str, name: str, link: RobotLink, stale: float) -> None:
        self.key, self.name, self.link, self.stale = key, name, link, stale
        self.client = 0
        """The client number assigned by the robot; 0 before its first status."""
        self.socket: WebSocket | None = None
        self.left = time.monotonic()
        """When its last page went away."""
        self.names: dict[int, str] = {}
        self.others: list[str] = []
        self._outbox = Outbox()
        self._published: dict[object, str | bytes] = {}
        self._status: robot.Status | None = None
        self._alarms: tuple[robot.Alarm, ...] = ()
        """All alarms, whole, as they were told last."""
        self._stamp = self._status_at = 0.0
        """The robot's clock, and ours, when the newest status was true [s]."""
        self._shown: object = None
        self._stick_n = -1
        self._state_at = self._link_at = self._beat_at = self._received_at = -math.inf
        self._page_ms: float | None = None
        self._speed_scale = 1.0  # the newest: it counts on while the page is away
        self._leave, self._left = asyncio.Event(), asyncio.Event()
        self._requested: dict[int, page.Request] = {}
        self._proposed: dict[int, tuple[bool, float]] = {}
        """Routes without an answer: whether only to be checked, and when they were sent [s]."""

    # ---- the robot's side --------------------------------------------------------------

    def _poll_link(self) -> None:
        """Convert the robot's messages for the page."""
        for news in self.link.news():
            self._on_news(news)
        for number, what in list(self._requested.items()):
            answer = self.link.answer(number)
            if answer is None:
                continue
            del self._requested[number]
            waits = what == "take" and self._waits  # which the page shows, with its time
            if not answer.granted and not waits:
                why = view.persons(answer.reason, self.client, self.names)
                refused = page.Refused(what=what, why=why)
                self._send(refused, number)
        for number, (only_check, sent) in list(self._proposed.items()):
            if not only_check and time.monotonic() - sent > ROUTE_WITHIN:
                why = "the robot did not answer: send it again"
                self._checked(bulk.Checked(robot.Answer(number, False, why), 65535))
        if isinstance(self.link, StartingLink):
            self.link = self.link.ready() or self.link

    def _on_news(self, news: News) -> None:
        message, stamp, age = news
        match message:
            case robot.Status():
                self._status, self._stamp = message, stamp
                self._status_at = time.monotonic() - (0.0 if math.isnan(age) else age)
                if self.client != message.lease.you:
                    self.client = message.lease.you
                    _log.info("%s is client %d of the robot", self.name, self.client)
            case robot.ScanPart():
                self._outbox.put(f"scan/{message.lidar}", view.scan(message, age))
            case bulk.Picture():
                self._outbox.put("frame", view.frame(message, age))
            case bulk.Map():
                self._publish(message, view.map_part(message))
            case bulk.ZoneMap():
                self._publish(message, view.zones(message))
            case bulk.Checked():
                self._checked(message)
            case bulk.Alarms():
                self._alarms = tuple(one.alarm._replace(text=one.text) for one in message.all)
                self._shown = None
            case _:
                if isinstance(message, page.FROM_ROBOT):
                    self._publish(message, view.shown(message))

    def _publish(self, of: object, shown: str | bytes) -> None:
        """Send what is shown of a message to the page, and to pages that connect later."""
        slot = bulk.slot_of(of)
        self._published[slot] = shown
        self._outbox.put(slot, shown)

    def _checked(self, message: bulk.Checked) -> None:
        number, ok, why = message.answer
        worst = None if message.worst == 65535 else message.worst
        only, _ = self._proposed.pop(number, (True, 0.0))
        self._send(page.Checked(ok=ok, only_check=only, why=why, worst=worst), number)

    def _send(self, message: page.ToPage, number: int = 0) -> None:
        """number: of the answer; none replaces another."""
        self._outbox.put((message.type, number), message.model_dump_json())

    # ---- the page's side ---------------------------------------------------------------

    @property
    def is_there(self) -> bool:
        """Whether its page is connected, and has said something lately."""
        return self.socket is not None and time.monotonic() - self._received_at < DEAD

    async def leave(self) -> None:
        """Serve the page no longer, whose connection is dead, or will be found to be."""
        self._leave.set()
        await self._left.wait()

    async def attend(self, socket: WebSocket) -> None:
        """Serve a page until it disconnects, or `leave`."""
        self._leave, self._left = asyncio.Event(), asyncio.Event()
        self.socket = socket
        self._outbox = Outbox()
        self._stick_n = -1
        self._state_at = self._link_at = self._beat_at = -math.inf
        self._received_at = time.monotonic()
        self._shown = None
        both = set[asyncio.Task[None]]()
        try:
            welcome = view.welcome(self.name, self.key, self.stale, self.link)
            await socket.send_text(welcome.model_dump_json())
            for slot, message in self._published.items():
                self._outbox.put(slot, message)
            both |= {asyncio.create_task(do(socket)) for do in (self._read, self._write)}
            both.add(asyncio.create_task(self._told_to_leave()))
            done, _ = await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except WebSocketDisconnect:
            pass
        finally:
            for task in both:
                task.cancel()
            await asyncio.gather(*both, return_exceptions=True)
            if self.socket is socket:
                self.socket, self.left = None, time.monotonic()
                self.link.steer(robot.NO_STICK._replace(speed_scale=self._speed_scale))
            self._left.set()

    async def _told_to_leave(self) -> None:
        await self._leave.wait()

    async def _read(self, socket: WebSocket) -> None:
        now = time.monotonic()
        rate = TokenBucket(per_second=200.0, at_once=200.0, now=now)
        shown = TokenBucket(per_second=1000.0, at_once=1000.0, now=now)
        while _open(socket):
            text = await socket.receive_text()
            self._received_at = time.monotonic()
            # what a page acknowledges is as much as it is sent: of several LiDARs, many scans
            if not (shown if text in _GOT else rate).take(self._received_at):
                _log.warning("%s sends too many messages; closed", self.name)
                await _disconnect(socket, 1008, "too many messages")
                return
            try:
                message = page.from_page(text)
            except ValidationError as error:
                where = error.errors(include_url=False, include_input=False)[0]
                _log.warning("%s sent an invalid message (%s): %s", self.name, where["msg"], _OTHER)
                await _disconnect(socket, 1008, _OTHER)
                return
            self._on_message(message)

    def _on_message(self, message: page.FromPage) -> None:
        match message:
            case page.Steer():
                self._on_steer(message)
            case page.Do():
                what, value = message.request()
                made = None if message.echo_ms is None else message.echo_ms / 1e3
                self._requested[self.link.ask(what, value, made)] = message.what
                while len(self._requested) > 32:
                    self._requested.pop(next(iter(self._requested)))
                if what is robot.RequestKind.RECORD:
                    self.link.fetch("")
            case page.Waypoints():
                number = self.link.propose(message.points, message.only_check)
                self._proposed = {**dict(list(self._proposed.items())[-8:])}
                self._proposed[number] = message.only_check, time.monotonic()
            case page.Got():
                self._outbox.credit(message.stream)
            case page.Play():
                if isinstance(self.link, ReplayLink):
                    self.link.play(message.playing, message.speed, message.seek_s)

    def _on_steer(self, message: page.Steer) -> None:
        now = time.monotonic()
        age = now - message.echo_ms / 1e3
        if message.n <= self._stick_n or not is_current(age, self.stale):
            return
        self._stick_n = message.n
        before = self._page_ms
        self._page_ms = age * 1e3 if before is None else 0.9 * before + 0.1 * age * 1e3
        self._speed_scale = message.command.speed_scale
        self.link.steer(message.command, now - max(age, 0.0) + self.stale)

    async def _write(self, socket: WebSocket) -> None:
        while True:
            await asyncio.sleep(_POLL)
            self._poll_link()
            now = time.monotonic()
            if self._drives and now - self._received_at > SILENT:
                _log.warning("%s drives, and its page says nothing; closed", self.name)
                return  # without a goodbye, for which a silent page would be waited for
            self._send_due(now)
            for message in self._outbox.take():
                sent = socket.send_text if isinstance(message, str) else socket.send_bytes
                try:
                    await asyncio.wait_for(sent(message), SEND_WITHIN)  # type: ignore[arg-type]
                except TimeoutError:
                    _log.warning("%s does not read; closed", self.name)
                    await _disconnect(socket, 1013, "too slow")
                    return
                except (WebSocketDisconnect, RuntimeError):  # it is closed, or closing
                    return

    @property
    def _drives(self) -> bool:
        """Whether this operator has the lease, by the newest status."""
        return self._status is not None and 0 != self._status.lease.driver == self.client

    @property
    def _waits(self) -> bool:
        """Whether its request for the lease waits for the driver's answer."""
        return self._status is not None and 0 != self._status.lease.requester == self.client

    def _send_due(self, now: float) -> None:
        """Send what is due periodically."""
        if now - self._beat_at >= BEAT:
            self._beat_at = now
            self._send(page.Beat(at_ms=now * 1e3, page_ms=self._page_ms))
        # before the first state, which without a link would be an old one
        first = self._status is not None and self._shown is None
        if first or now - self._link_at >= LINK_EVERY:
            self._link_at = now
            self._outbox.put("link", view.shown(self.link.state()))
            if isinstance(self.link, ReplayLink):
                self._outbox.put("place", view.shown(self.link.place))
        if self._status is not None and now - self._state_at >= FRAME_RATE:
            self._send_state(self._status, now)

    def _send_state(self, status: robot.Status, now: float) -> None:
        if status is not self._shown:
            self._shown, self._state_at = status, now
            age = now - self._status_at
            named = view.named(view.whole(status, self._alarms), self.names)
            self._outbox.put("state", view.shown(named, stamp=self._stamp, age=age))
        everybody = view.who(status.lease, self.names, self.others)
        self._outbox.put("who", everybody.model_dump_json(), changed_only=True)


def _open(socket: WebSocket) -> bool:
    """Whether the socket is still connected."""
    return socket.application_state is WebSocketState.CONNECTED


async def _disconnect(socket: WebSocket, code: int, why: str) -> None:
    if _open(socket):
        await socket.close(code, why)


CREDIT = {"state": 4, "scan": 2, "frame": 2}
"""How many messages of a stream may be in flight; the page reports those it has shown."""


class Outbox:
    """Send queue of one page: a message replaces one of its slot that is not sent yet.

    A message of a stream in `CREDIT` waits until the page has shown earlier ones; slots of their
    own within a stream, as `scan/1`, share its credit.
    """

    def __init__(self) -> None:
        self._waiting: dict[Hashable, str | bytes] = {}
        self._sent: dict[Hashable, str | bytes] = {}
        self._credit = dict(CREDIT)

    def put(self, slot: Hashable, message: str | bytes, *, changed_only: bool = False) -> None:
        """Queue a message. changed_only: not if it equals the last one of its slot."""
        if changed_only and slot not in self._waiting and self._sent.get(slot) == message:
            return
        if changed_only:
            self._sent[slot] = message
        self._waiting[slot] = message

    def credit(self, stream: str) -> None:
        """The page has shown one message of this stream."""
        self._credit[stream] = min(self._credit[stream] + 1, CREDIT[stream])

    def take(self) -> list[str | bytes]:
        """The messages that can be sent now."""
        out: list[str | bytes] = []
        for slot in list(self._waiting):
            stream = slot.partition("/")[0] if isinstance(slot, str) else ""
            if stream in self._credit:
                if self._credit[stream] == 0:
                    continue
                self._credit[stream] -= 1
            out.append(self._waiting.pop(slot))
        return out
