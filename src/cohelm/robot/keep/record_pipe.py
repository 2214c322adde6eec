"""A line to the recorder that makes nobody wait: what does not fit is dropped, and counted."""

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
"""What the recorder says every half second, though it has nothing to say."""
MUTE = 3.0
"""A recorder that has been at work and says nothing for so long hangs [s]: about as long as the
line holds what it is told."""


class Event(NamedTuple):
    """Something worth a line in the record."""

    stamp: float
    """The robot's clock [s]."""
    who: str
    """gate, loop, recorder..."""
    text: str
    serious: bool = False
    """Whether somebody should look at it."""


class OutlineChange(NamedTuple):
    """The robot's is another from now on."""

    stamp: float
    """The robot's clock [s]."""
    corners: Floats
    """(k, 2), in the body frame [m]."""


def line() -> tuple[socket.socket, socket.socket]:
    """Both ends of a line: messages arrive whole, in order."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    return ours, theirs


class RecordLine:
    """Says things to the recorder, if there is one."""

    def __init__(self, end: socket.socket | None, *, waits: bool = False) -> None:
        """waits: whether to wait for room instead of dropping, as simulated time may."""
        self._end = end
        self._how = 0 if waits else socket.MSG_DONTWAIT
        self.dropped = 0
        """Messages for which there was no room."""
        self.broken = ""
        """Why nothing can be said any more; empty while it can."""
        self._alive = math.inf
        """When the recorder gave its last sign of life; infinite before the first [s]."""

    @property
    def mute(self) -> bool:
        """Whether the recorder hangs, as far as `heard` could tell."""
        return self.open and time.monotonic() - self._alive > MUTE

    @property
    def open(self) -> bool:
        """Whether there is a recorder that hears."""
        return self._end is not None and not self.broken

    def __call__(self, message: Any) -> None:
        """Say it, or drop it."""
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
            self.broken = f"the recorder is gone ({error.strerror})"

    def heard(self) -> Any:
        """What the recorder says, or None."""
        if self._end is None or self.broken:
            return None
        try:
            while (data := self._end.recv(LARGEST, socket.MSG_DONTWAIT)) == ALIVE:
                self._alive = time.monotonic()
        except BlockingIOError:
            return None
        except OSError as error:
            self.broken = f"the recorder is gone ({error.strerror})"
            return None
        if not data:
            self.broken = "the recorder is gone"
            return None
        return pickle.loads(data)

    def close(self) -> None:
        """Nothing more will be said."""
        if self._end is not None:
            self._end.close()
            self._end = None
