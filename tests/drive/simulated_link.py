"""The robot's own end of the link in simulated time: its real requests, lease, clocks and bulk,
without sockets, encryption and threads. Stations speak to it in bytes, with any delay."""

from __future__ import annotations

import heapq
import itertools
import socket
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np

from cohelm.core.types import Stick
from cohelm.drive.station_publisher import StationPublisher
from cohelm.link import robot_bulk
from cohelm.link.bulk_messages import Waypoints
from cohelm.link.keys import pair_here
from cohelm.link.listener import Guest
from cohelm.link.messages import Command, Device, Mode, Request, RequestKind, Uplink
from cohelm.link.robot_bulk import RobotBulk, _Station
from cohelm.link.robot_end import RobotEnd
from cohelm.link.wire import Header, encode

CENTRED = Stick(0.0, 0.0)


@cache
def robot_keys():
    return pair_here()[0]


class End(RobotEnd):
    """Turns when it is told to."""

    def __init__(self, link, clock) -> None:
        self._link = link
        super().__init__(robot_keys(), "127.0.0.1", 0, clock=clock)

    def _start(self) -> None:
        pass

    def close(self) -> None:
        self._close_all()
        self._waker.close()

    def answer(self, client, number, granted, reason="") -> None:
        super().answer(client, number, granted, reason)
        self._link.answered(client, number, granted, reason)

    def _lease(self, held, *args, **more) -> None:
        before = self._held.driver
        super()._lease(held, *args, **more)
        if held.driver != before:
            self._link.log.append(("lease", before, held.driver))


class Bulk(RobotBulk):
    def __init__(self, end: End, records: Path) -> None:
        with mock.patch.object(robot_bulk.udp, "listening", return_value=socket.socket()):
            super().__init__(end, robot_keys(), records)  # nobody comes by TCP

    def _start(self) -> None:
        pass

    def close(self) -> None:
        self._listener.close()
        self._waker.close()


class Station:
    """A person's end: speaks 50 times a second, repeats what is not answered."""

    _sessions = itertools.count(1)

    def __init__(self, link: SimulatedLink, name: str, delay: float = 0.02) -> None:
        """delay: of each way [s]."""
        self.link, self.name, self.delay = link, name, delay
        self.session = next(self._sessions)
        self.stick, self.valid, self.armed, self.silent = CENTRED, True, True, False
        self.pending: list[Request] = []
        self.asked: dict[int, Request] = {}
        self.answers: dict[int, tuple[bool, str]] = {}
        self._numbers, self._sequence = itertools.count(1), itertools.count(1)
        channel = SimpleNamespace(
            name=name, peer=f"key of {name}", up=True, close=lambda: [], seal=lambda data: []
        )
        sock = SimpleNamespace(close=lambda: None, send=lambda data: None)
        link.end._admit(Guest(channel, sock, ("", 0), []))
        self.number = max(link.end._clients)
        self.client = link.end._clients[self.number]
        self.bulk = _Station(channel, ("", 0), 0.0)
        self.bulk.session = self.session
        link.bulk._stations.append(self.bulk)
        link.stations[self.number] = self

    def ask(self, what: RequestKind, value: int = 0) -> int:
        request = Request(next(self._numbers), what, value, self.link.now())
        self.pending = [*self.pending, request][-8:]
        self.asked[request.number] = request
        return request.number

    def propose(self, points, only_check: bool = False) -> int:
        number = next(self._numbers)
        data = encode(self._header(), Waypoints(number, np.array(points, float), only_check))
        self.link.later(self.delay, lambda: self.link.bulk._message(self.bulk, data))
        return number

    def _header(self) -> Header:
        now = self.link.now()
        return Header(self.session, next(self._sequence), now, now - self.delay, 0.0)

    def speak(self) -> None:
        if self.silent:
            return
        self.pending = [r for r in self.pending if r.number not in self.answers]
        command = Command(self.stick, self.valid, self.armed, Device.SCRIPT)
        data = encode(self._header(), Uplink(command, tuple(self.pending)))
        self.link.later(self.delay, lambda: self.hand_over(data))

    def hand_over(self, data: bytes) -> None:
        if self.there:
            self.link.end._message(self.client, data)

    def leave(self) -> None:
        self.silent = True
        if self.there:
            self.link.end._remove(self.client, "good-bye")

    @property
    def there(self) -> bool:
        """Whether this one is connected: its number may be another's when it has left."""
        return self.link.end._clients.get(self.number) is self.client


class SimulatedLink(StationPublisher):
    def __init__(self, model, records: Path) -> None:
        self.clock = lambda: 0.0
        self.log: list[tuple] = []
        """What the robot did, in order: ("lease", before, after) and ("answer", station, request,
        granted, reason)."""
        self.stations: dict[int, Station] = {}
        self._queue: list = []
        self._count = itertools.count()
        self.end = End(self, self.now)
        self.bulk = Bulk(self.end, records)
        super().__init__(self.end, self.bulk, model, records, False, False)

    def now(self) -> float:
        return self.clock()

    def answered(self, client: int, number: int, granted: bool, reason: str) -> None:
        station = self.stations[client]
        if number not in station.answers:
            station.answers[number] = (granted, reason)
        self.log.append(("answer", station, station.asked[number], granted, reason))

    def later(self, delay: float, do) -> None:
        heapq.heappush(self._queue, (self.now() + delay, next(self._count), do))

    def turn(self) -> None:
        """Between two periods: what the stations say, and what arrives."""
        for station in list(self.stations.values()):
            station.speak()
        while self._queue and self._queue[0][0] <= self.now() + 1e-9:
            heapq.heappop(self._queue)[2]()
        self.end._expire(self.now())


def checked(station: Station) -> list:
    """What the robot said to the ways that a station proposed, and forget it."""
    said = list(station.bulk.replies)
    station.bulk.replies.clear()
    return said


def chosen(link: SimulatedLink, mode: Mode):
    """Part of a script: anna takes the lease and chooses a mode; returns her, and the answer."""
    anna = Station(link, "anna")
    yield from range(10)
    anna.ask(RequestKind.TAKE)
    yield from range(10)
    number = anna.ask(RequestKind.MODE, mode)
    yield from range(10)
    return anna, anna.answers[number]
