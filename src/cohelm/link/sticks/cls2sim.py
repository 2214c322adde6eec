"""What CLS2Sim is asked and answers in low-level control (once "external control"), over UDP.

CLS2Sim is the program of Brunner's force sticks. One request sets the force of every axis, and
its answer holds where the axes stand (https://cls2sim.brunner-innovation.swiss/, "Remote
interface", "Low level control"). Little-endian, 20 bytes each way, no number that says which
answer belongs to which request.
"""

from __future__ import annotations

import contextlib
import math
import socket
import struct
from collections import deque
from typing import NamedTuple

from cohelm.link.udp import opened, receive, resolved

PORT = 15090
"""CLS2Sim's own default."""
COMMAND = 0xAF
"""Low-level control of one seat."""
_REQUEST = struct.Struct("<i4i")
_ANSWER = struct.Struct("<i4f")
_ROUNDING = 1e-4  # a position this little beyond 0 ... 1 is cut: it is a float of 4 bytes
_MOST = 64  # datagrams looked at in one go


class Forces(NamedTuple):
    """What the axes are to push with, in CLS2Sim's own unit."""

    elevator: int
    aileron: int


class StickPositions(NamedTuple):
    """Where the axes stand, in [0, 1]."""

    elevator: float
    aileron: float
    age: float
    """How long ago it was asked for, or longer [s]."""


def request(forces: Forces) -> bytes:
    """As it goes over the network; rudder and collective are not pushed."""
    return _REQUEST.pack(COMMAND, forces.elevator, forces.aileron, 0, 0)


def positions(data: bytes) -> tuple[float, float] | None:
    """Elevator and aileron of an answer; None for what is no answer of low-level control."""
    if len(data) != _ANSWER.size:
        return None
    command, elevator, aileron, _, _ = _ANSWER.unpack(data)
    if command != COMMAND:
        return None
    if not all(-_ROUNDING <= axis <= 1.0 + _ROUNDING for axis in (elevator, aileron)):
        return None  # NaN neither
    return min(max(elevator, 0.0), 1.0), min(max(aileron, 0.0), 1.0)


class Cls2SimLine:
    """Requests to one CLS2Sim, and their answers; nothing here waits or raises once it is open.

    Answers have no numbers, so they are counted: each takes the oldest request that has none yet,
    and what comes without a request of the last `patience` is a duplicate, or too old. The socket
    is connected: the kernel drops what comes from any other address.
    """

    def __init__(self, host: str, port: int, patience: float) -> None:
        """patience: for how long an answer may come [s]. CohelmError where the host has no name."""
        family, address = resolved(host, port, socket.SOCK_DGRAM)
        self._socket = opened(family)
        with contextlib.suppress(OSError):  # no route now; there may be one later
            self._socket.connect(address)
        self._patience = patience
        self._pending: deque[float] = deque()
        self.refused = 0
        """Datagrams that were no answers of low-level control."""

    def ask(self, forces: Forces, now: float) -> None:
        """Send a request. now: a steady clock [s]."""
        self._pending.append(now)
        with contextlib.suppress(OSError):  # full, no route, nobody there: no answer tells it
            self._socket.send(request(forces))

    def answers(self, now: float) -> list[StickPositions]:
        """Those that came, in their order."""
        came: list[StickPositions] = []
        with contextlib.suppress(ValueError):  # closed
            for data, _ in receive(self._socket, _MOST):
                found = positions(data)
                while self._pending and now - self._pending[0] > self._patience:
                    self._pending.popleft()
                if found is None:
                    self.refused += 1
                elif self._pending:
                    came.append(StickPositions(*found, now - self._pending.popleft()))
        return came

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()


def unit(share: float, full: float) -> int:
    """A share of the full force, in CLS2Sim's unit; never beyond it, and 0 for what is no number.

    full: signed; negative where a positive number pushes towards position 0.
    """
    if not math.isfinite(share):
        return 0
    return round(min(max(share, -1.0), 1.0) * full)
