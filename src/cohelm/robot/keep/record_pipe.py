"""A non-blocking socket to the recorder: what does not fit is dropped, and counted."""

from __future__ import annotations

import math
import pickle
import socket
import time
from typing import Any, NamedTuple

from cohelm.core.types import Floats

LARGEST = 180_000
"""Bytes of one message: it must fit into the socket's buffer."""
ALIVE = b"alive"
"""The recorder's heartbeat, every half second."""
HUNG_AFTER = 3.0
"""A recorder without a heartbeat for this long hangs [s]: about as long as the socket buffers what
is sent."""


class Event(NamedTuple):
    """An event for the log."""

    stamp: float
    """The robot's clock [s]."""
    who: str
    """gate, loop, recorder..."""
    text: str
    serious: bool = False
    """Whether it needs attention."""


class OutlineChange(NamedTuple):
    """The robot has another outline from now on."""

    stamp: float
    """The robot's clock [s]."""
    corners: Floats
    """(k, 2), in the body frame [m]."""


def line() -> tuple[socket.socket, socket.socket]:
    """Both ends of a socket: messages arrive whole, in order."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    return ours, theirs


class RecordLine:
    """Sends messages to the recorder, if there is one."""

    def __init__(self, end: socket.socket | None, *, waits: bool = False) -> None:
        """waits: wait for room instead of dropping, as simulated time may."""
        self._end = end
        self._how = 0 if waits else socket.MSG_DONTWAIT
        self.dropped = 0
        """Messages for which there was no room."""
        self.broken = ""
        """Why nothing can be sent any more; empty while it can."""
        self._alive = math.inf
        """When the recorder's last heartbeat came; infinite before the first [s]."""

    @property
    def hung(self) -> bool:
        """Whether the recorder hangs, by what `received` has seen."""
        return self.open and time.monotonic() - self._alive > HUNG_AFTER

    @property
    def open(self) -> bool:
        """Whether there is a recorder that receives."""
        return self._end is not None and not self.broken

    def __call__(self, message: Any) -> None:
        """Send it, or drop it."""
        if self._end is None or self.broken:
            return
        data = pickle.dumps(message, protocol=5)
        if len(data) > LARGEST:
            self.dropped += 1
            return
        try:
            self._end.send(data, self._how)
        except BlockingIOError:
            self.dropped += 1
        except OSError as error:
            self.broken = f"the recorder has ended ({error.strerror})"

    def received(self) -> Any:
        """The recorder's next message, or None."""
        if self._end is None or self.broken:
            return None
        try:
            while (data := self._end.recv(LARGEST, socket.MSG_DONTWAIT)) == ALIVE:
                self._alive = time.monotonic()
        except BlockingIOError:
            return None
        except OSError as error:
            self.broken = f"the recorder has ended ({error.strerror})"
            return None
        if not data:
            self.broken = "the recorder has ended"
            return None
        return pickle.loads(data)

    def close(self) -> None:
        """Close it."""
        if self._end is not None:
            self._end.close()
            self._end = None
