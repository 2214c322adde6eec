"""One operator: a page, its own link to the robot, and the watch over its stick.

An operator outlives its WebSocket by a few seconds, so that a page that is loaded again is still
who it was; meanwhile its stick counts as gone.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from cohelm.core.types import Stick
from cohelm.link import messages as robot
from cohelm.station import binary, messages as page, view
from cohelm.station.doors import Rate
from cohelm.station.outbox import Outbox
from cohelm.station.robot_link import Connect, Replayed

BEAT = 0.04
"""Between two beats to a page [s]."""
FRAME_RATE = 1 / 30
"""Least time between two states to a page [s]."""
LINK_EVERY = 0.25
"""[s]"""
SEND_WITHIN = 5.0
"""A page that takes nothing for so long is let go [s]."""
_CENTRED = Stick(0.0, 0.0)
_log = logging.getLogger("cohelm.station")


class Operator:
    """All calls from the event loop's thread, but for `_hear`."""

    def __init__(self, key: str, name: str, connect: Connect, stale: float) -> None:
        self.key, self.name, self.stale = key, name, stale
        self.client = 0
        """The number the robot gave it; 0 before the robot was heard."""
        self.socket: WebSocket | None = None
        self.left = time.monotonic()
        """When its last page went away."""
        self.names: dict[int, str] = {}
        self.others: list[str] = []
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._heard: dict[object, tuple[Any, float, float]] = {}
        """Message, the robot's clock then, our clock then; by slot."""
        self._news = asyncio.Event()
        self._outbox = Outbox()
        self._kept: dict[object, str | bytes] = {}
        self._scan: tuple[int, NDArray[np.uint16], int] = (-1, np.empty(0, np.uint16), 0)
        self._status: tuple[robot.Status, float, float] | None = None
        """The newest, the robot's clock and ours when it was so."""
        self._shown: object = None
        self._health: robot.Health | None = None
        self._stick_at = -math.inf
        self._stick_n = -1
        self._state_at = self._link_at = self._beat_at = -math.inf
        self._page_ms: float | None = None
        self._answered = 0
        self._asked: dict[int, str] = {}
        self._proposed: dict[int, bool] = {}
        self.link = connect(name, self._hear)

    # ---- the robot's side --------------------------------------------------------------

    def _hear(self, message: robot.FromRobot, stamp: float, age: float) -> None:
        """From the link's thread: keep the newest of each kind, and wake the writer."""
        slot: object = type(message)
        if isinstance(message, robot.ScanPart):
            slot = (robot.ScanPart, message.start)
        elif isinstance(message, robot.Polyline):
            slot = (robot.Polyline, message.what)
        elif isinstance(message, robot.Map):
            slot = (robot.Map, message.column, message.row)
        elif isinstance(message, robot.Checked):
            slot = (robot.Checked, message.answer.number)
        with self._lock:
            self._heard[slot] = (message, stamp, time.monotonic() - age)
        with contextlib.suppress(RuntimeError):  # the loop is closed: the station is going down
            self._loop.call_soon_threadsafe(self._news.set)

    def _digest(self) -> None:
        """What was heard, into what the page is to be sent."""
        with self._lock:
            heard, self._heard = self._heard, {}
        now = time.monotonic()
        for slot, (message, stamp, at) in heard.items():
            self._take(slot, message, stamp, now - at)

    def _take(self, slot: object, message: Any, stamp: float, age: float) -> None:
        match message:
            case robot.Status():
                self._status = (message, stamp, time.monotonic() - age)
                self.client = message.lease.you
                self._answers(message.answers)
            case robot.ScanPart():
                self._part(message, age)
            case robot.Picture():
                self._outbox.put("frame", binary.frame(message, age))
            case robot.Discs():
                self._keep("discs", view.discs(message).model_dump_json())
            case robot.Hello():
                self._keep("robot", view.hello(message).model_dump_json())
            case robot.Polyline():
                self._keep(slot, view.line(message).model_dump_json())
            case robot.Map():
                self._keep(slot, binary.map_part(message))
            case robot.Records():
                self._keep("records", view.records(message).model_dump_json())
            case robot.Health():
                self._health = message
            case robot.Checked():
                self._checked(message)
            case _:
                pass

    def _keep(self, slot: object, message: str | bytes) -> None:
        """What a page that comes later must be told too."""
        self._kept[slot] = message
        self._outbox.put(slot, message)

    def _part(self, part: robot.ScanPart, age: float) -> None:
        """Put the parts of a scan together; beams of a lost part stay without return."""
        number, ranges, have = self._scan
        if part.number != number or part.beams != len(ranges):
            number, ranges, have = part.number, np.full(part.beams, 65535, np.uint16), 0
        end = min(part.start + len(part.ranges), part.beams)
        ranges[part.start : end] = part.ranges[: end - part.start]
        have += end - part.start
        self._scan = (number, ranges, have)
        if have >= part.beams:
            self._outbox.put("scan", binary.scan(part, ranges, age))

    def _answers(self, answers: tuple[robot.Answer, ...]) -> None:
        for answer in answers:
            if answer.number <= self._answered:
                continue
            self._answered = answer.number
            what = self._asked.pop(answer.number, "")
            if not answer.granted and what:
                self._say(page.Refused(what=what.replace("_", " "), why=answer.reason))

    def _checked(self, message: robot.Checked) -> None:
        number, ok, why = message.answer
        worst = None if message.worst == 65535 else message.worst
        only = self._proposed.pop(number, True)
        self._say(page.Checked(ok=ok, only_check=only, why=why, worst=worst))

    def _say(self, message: page.ToPage) -> None:
        self._outbox.put(message.type, message.model_dump_json())

    # ---- the page's side ---------------------------------------------------------------

    async def attend(self, socket: WebSocket) -> None:
        """Speak with a page until it goes away."""
        self.socket = socket
        self._outbox = Outbox()
        self._stick_n, self._stick_at = -1, -math.inf
        self._state_at = self._link_at = self._beat_at = -math.inf
        self._shown = None
        await socket.send_text(
            view.welcome(self.name, self.key, self.stale, self.link).model_dump_json()
        )
        for slot, message in self._kept.items():
            self._outbox.put(slot, message)
        both = {asyncio.create_task(self._read(socket)), asyncio.create_task(self._write(socket))}
        try:
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
                self._stick_at = -math.inf
                self.watch(time.monotonic())

    async def _read(self, socket: WebSocket) -> None:
        rate = Rate(per_second=200.0, at_once=200.0)
        while True:
            text = await socket.receive_text()
            if not rate.allows():
                _log.warning("%s says too much; let go", self.name)
                await socket.close(1008, "too many messages")
                return
            try:
                message = page.from_page(text)
            except ValidationError as error:
                where = error.errors(include_url=False, include_input=False)[0]
                _log.warning("%s sent what is no message: %s", self.name, where["msg"])
                await socket.close(1008, "not a message")
                return
            self._said(message)

    def _said(self, message: page.FromPage) -> None:
        match message:
            case page.Stick():
                self._stick(message)
            case page.Do():
                what, value = view.asked(message)
                self._asked[self.link.ask(what, value)] = message.what
                while len(self._asked) > 32:
                    self._asked.pop(next(iter(self._asked)))
                if what is robot.Ask.RECORD:
                    self.link.fetch("")
            case page.Waypoints():
                number = self.link.propose(message.points, message.only_check)
                self._proposed = {**dict(list(self._proposed.items())[-8:])}
                self._proposed[number] = message.only_check
            case page.Got():
                self._outbox.credit(message.stream)
                self._news.set()
            case page.Play():
                if isinstance(self.link, Replayed):
                    self.link.play(message.playing, message.speed, message.seek_s)

    def _stick(self, stick: page.Stick) -> None:
        now = time.monotonic()
        age = now - stick.heard_ms / 1e3
        if stick.n <= self._stick_n or not -BEAT <= age <= self.stale:
            return  # the watch says that it is gone, if nothing better comes
        self._stick_n, self._stick_at = stick.n, now
        before = self._page_ms
        self._page_ms = age * 1e3 if before is None else 0.9 * before + 0.1 * age * 1e3
        self.link.steer(
            Stick(stick.x, stick.psi), stick.valid, stick.armed, view.DEVICES[stick.device],
            stick.speed_scale,
        )  # fmt: skip

    def watch(self, now: float) -> None:
        """Called at 50 Hz: a stick that is not heard of any more is gone."""
        if now - self._stick_at > self.stale:
            self.link.steer(_CENTRED, False, False, robot.Device.NONE, 1.0)

    async def _write(self, socket: WebSocket) -> None:
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), BEAT / 2)
            self._news.clear()
            self._digest()
            self._due(time.monotonic())
            for message in self._outbox.take():
                sent = socket.send_text if isinstance(message, str) else socket.send_bytes
                try:
                    await asyncio.wait_for(sent(message), SEND_WITHIN)  # type: ignore[arg-type]
                except TimeoutError:
                    _log.warning("%s takes nothing; let go", self.name)
                    await socket.close(1013, "too slow")
                    return
                except (WebSocketDisconnect, RuntimeError):  # it is gone, or closing
                    return

    def _due(self, now: float) -> None:
        """What is sent by the clock."""
        if now - self._beat_at >= BEAT:
            self._beat_at = now
            self._say(page.Beat(at_ms=now * 1e3, page_ms=self._page_ms))
        status = self._status
        if status is not None and now - self._state_at >= FRAME_RATE:
            said, stamp, at = status
            if status is not self._shown:
                self._shown, self._state_at = status, now
                self._outbox.put("state", view.state(said, stamp, now - at).model_dump_json())
            everybody = view.who(said.lease, self.names, self.others)
            self._outbox.put("who", everybody.model_dump_json(), changed_only=True)
            alarms = view.alarms(said.alarms).model_dump_json()
            self._outbox.put("alarms", alarms, changed_only=True)
        if now - self._link_at >= LINK_EVERY:
            self._link_at = now
            timing = status[0].timing if status else None
            age = now - status[2] if status else math.nan
            quality = view.link(self.link.quality(), timing, age, self._health)
            self._outbox.put("link", quality.model_dump_json())
            if isinstance(self.link, Replayed):
                at, playing, speed = self.link.place
                self._say(page.Playing(at_s=at, playing=playing, speed=speed))
