"""Client of CLS2Sim's low-level control (formerly "external control"), over UDP.

CLS2Sim is the program of Brunner's force sticks. One request sets the force of every axis, and
its answer holds the positions of the axes (https://cls2sim.brunner-innovation.swiss/, "Remote
interface", "Low level control"). Little-endian, 20 bytes each way, without a number that assigns
an answer to its request.
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
"""CLS2Sim's default port."""
COMMAND = 0xAF
"""Low-level control of one seat."""
_REQUEST = struct.Struct("<i4i")
_ANSWER = struct.Struct("<i4f")
_ROUNDING = 1e-4  # positions beyond 0 ... 1 by at most this are clipped: floats of 4 bytes
_MOST = 64  # datagrams received at once


class Forces(NamedTuple):
    """Forces of the axes, in CLS2Sim's own unit."""

    elevator: int
    aileron: int


class StickPositions(NamedTuple):
    """Positions of the axes, in [0, 1]."""

    elevator: float
    aileron: float
    age: float
    """Time since the request, or longer [s]."""


def request(forces: Forces) -> bytes:
    """The datagram of a request; no force on rudder and collective."""
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
    """Requests to one CLS2Sim, and their answers; once open, no method waits or raises.

    Answers have no numbers, so they are counted: each belongs to the oldest unanswered request, and
    one without a request within the last `patience` is a duplicate, or too old. The socket is
    connected: the kernel drops datagrams of other addresses.
    """

    def __init__(self, host: str, port: int, patience: float) -> None:
        """patience: longest time to an answer [s]. CohelmError where the host is unknown."""
        family, address = resolved(host, port, socket.SOCK_DGRAM)
        self._socket = opened(family)
        with contextlib.suppress(OSError):  # no route yet; there may be one later
            self._socket.connect(address)
        self._patience = patience
        self._pending: deque[float] = deque()
        self.refused = 0
        """Datagrams that were no answers of low-level control."""

    def ask(self, forces: Forces, now: float) -> None:
        """Send a request. now: a steady clock [s]."""
        self._pending.append(now)
        with contextlib.suppress(OSError):  # full, no route, no listener: shows as no answer
            self._socket.send(request(forces))

    def answers(self, now: float) -> list[StickPositions]:
        """The answers received, in order."""
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
        """Close the socket."""
        self._socket.close()


def unit(share: float, full: float) -> int:
    """A share of the full force, in CLS2Sim's unit; clipped to it, and 0 for NaN and inf.

    full: signed; negative where a positive number pushes towards position 0.
    """
    if not math.isfinite(share):
        return 0
    return round(min(max(share, -1.0), 1.0) * full)
