"""A simulated CLS2Sim server, written from its documentation, with a simulated stick.

What the documentation leaves open (which way a positive force pushes, its unit) is a property of
the simulated stick, so that tests can have it either way.
"""

from __future__ import annotations

import heapq
import random
import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from cohelm.core.types import Stick
from cohelm.link.sticks.cls2sim import Forces, StickPositions

STEP = 0.0005  # [s]


@dataclass
class Axis:
    """A mass with friction between two stops; positions in [0, 1]."""

    unit: float = 0.001
    """Force of one unit [half travels/s^2 kg]; negative: a positive force pushes towards 0."""
    mass: float = 0.02
    friction: float = 0.1
    position: float = 0.5
    rate: float = 0.0
    force: int = 0
    hand: float = 0.0
    """Force of a hand, towards 1."""
    held: float | None = None
    """Position that a hand holds, as strong as it needs."""

    def advance(self, dt: float) -> None:
        while dt > 0.0:
            step = min(STEP, dt)
            dt -= step
            if self.held is not None:
                self.position, self.rate = self.held, 0.0
                continue
            push = self.unit * self.force + self.hand - self.friction * 2.0 * self.rate
            self.rate += push / self.mass * step / 2.0  # half a travel is 1
            self.position += self.rate * step
            if not 0.0 <= self.position <= 1.0:
                self.position, self.rate = min(max(self.position, 0.0), 1.0), 0.0


@dataclass
class SimulatedStick:
    """Two axes, and which end of each is forward and left."""

    elevator: Axis = field(default_factory=Axis)
    aileron: Axis = field(default_factory=Axis)
    forward: int = 1
    left: int = 1

    def hold(self, stick: Stick | None) -> None:
        """By a hand, or let go."""
        if stick is None:
            self.elevator.held = self.aileron.held = None
        else:
            self.elevator.held = 0.5 + 0.5 * stick.x * (2 * self.forward - 1)
            self.aileron.held = 0.5 + 0.5 * stick.psi * (2 * self.left - 1)

    def lean(self, stick: Stick) -> None:
        """A hand that pushes with a force."""
        self.elevator.hand = stick.x * (2 * self.forward - 1)
        self.aileron.hand = stick.psi * (2 * self.left - 1)

    @property
    def stick(self) -> Stick:
        return Stick(
            (2 * self.elevator.position - 1) * (2 * self.forward - 1),
            (2 * self.aileron.position - 1) * (2 * self.left - 1),
        )

    def advance(self, dt: float) -> None:
        self.elevator.advance(dt)
        self.aileron.advance(dt)


class SimulatedLine:
    """The same behind a network of simulated time: what the device takes for its line and clock."""

    def __init__(
        self, stick: SimulatedStick, delay: float = 0.001, loss: float = 0.0, seed: int = 0
    ) -> None:
        """delay: one way [s]. loss: of each datagram."""
        self.stick, self.delay, self.loss = stick, delay, loss
        self.now = 100.0
        self.refused = 0
        self.asked: list[Forces] = []
        self.dead = False
        self._random = random.Random(seed)
        self._down: list[tuple[float, int, Forces, float]] = []
        self._up: list[tuple[float, int, StickPositions]] = []
        self._number = 0

    def clock(self) -> float:
        return self.now

    def wait(self, dt: float) -> None:
        """Time goes on."""
        end = self.now + dt
        while self._down and self._down[0][0] <= end:
            due, number, forces, asked = heapq.heappop(self._down)
            self.stick.advance(max(0.0, due - self.now))
            self.now = max(self.now, due)
            self.stick.elevator.force, self.stick.aileron.force = forces
            if not self.dead and self._random.random() >= self.loss:
                elevator, aileron = self.stick.elevator.position, self.stick.aileron.position
                heapq.heappush(
                    self._up,
                    (due + self.delay, number, StickPositions(elevator, aileron, asked)),
                )
        self.stick.advance(end - self.now)
        self.now = end

    def ask(self, forces: Forces, now: float) -> None:
        self.asked.append(forces)
        if not self.dead and self._random.random() >= self.loss:
            self._number += 1
            heapq.heappush(self._down, (now + self.delay, self._number, forces, now))

    def answers(self, now: float) -> list[StickPositions]:
        came: list[StickPositions] = []
        while self._up and self._up[0][0] <= now:
            _, _, answer = heapq.heappop(self._up)
            came.append(answer._replace(age=now - answer.age))
        return came

    def close(self) -> None:
        self.dead = True


class NoWatchdog:
    """Where time is simulated."""

    def beat(self) -> bool:
        return True

    def close(self) -> None:
        pass


class CLS2SimServer:
    """UDP on loopback. Answers as documented; `mangle` can spoil what goes out."""

    def __init__(self, stick: SimulatedStick | None = None) -> None:
        self.stick = stick or SimulatedStick()
        self.forces: list[tuple[float, int, int]] = []
        """What was asked for: when, elevator, aileron."""
        self.wrong: list[bytes] = []
        """Requests that the documentation does not know."""
        self.mangle: Callable[[bytes], list[bytes]] = lambda answer: [answer]
        self.delay = 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self.client: tuple[str, int] = ("", 0)
        self._open = True
        self._late: list[tuple[float, int, bytes]] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def url(self) -> str:
        return f"brunner://127.0.0.1:{self.port}"

    def inject(self, data: bytes) -> None:
        """Something that nobody asked for, from the right address."""
        self._socket.sendto(data, self.client)

    def close(self) -> None:
        if self._open:
            self._open = False
            self._thread.join()
            self._socket.close()

    def _serve(self) -> None:
        before, number = time.monotonic(), 0
        while self._open:
            wait = 0.05 if not self._late else max(0.0, self._late[0][0] - time.monotonic())
            ready = select.select([self._socket], [], [], min(wait, 0.05))[0]
            now = time.monotonic()
            self.stick.advance(now - before)
            before = now
            while self._late and self._late[0][0] <= now:
                self._socket.sendto(heapq.heappop(self._late)[2], self.client)
            if not ready:
                continue
            data, who = self._socket.recvfrom(2048)
            if len(data) != 20 or data[:4] != b"\xaf\0\0\0":
                self.wrong.append(data)
                continue
            elevator, aileron, rudder, collective = struct.unpack("<4i", data[4:])
            if rudder or collective:
                self.wrong.append(data)
            self.stick.elevator.force, self.stick.aileron.force = elevator, aileron
            self.forces.append((now, elevator, aileron))
            answer = struct.pack(
                "<i4f", 0xAF, self.stick.elevator.position, self.stick.aileron.position, 0.5, 0.5
            )
            self.client = self.client if self.client[1] else who
            for out in self.mangle(answer):
                if self.delay:
                    number += 1
                    heapq.heappush(self._late, (now + self.delay, number, out))
                else:
                    self._socket.sendto(out, who)
