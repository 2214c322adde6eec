"""A process that answers one question after the other, and never holds up who asks.

It is below all others, and may be stopped by them in the middle of a message: so nothing here waits
for the rest of one, in either direction.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import socket
import struct
from collections.abc import Callable
from typing import Any

from cohelm.robot.keep.processes import bound, started

_SIZE = struct.Struct("!Q")
_PART = 1 << 18


class Child:
    """The process, and the line to it. All calls come from one thread and return at once."""

    def __init__(
        self, name: str, answer: Callable[[Any], Any], begin: Callable[[], Any] | None = None
    ) -> None:
        """answer: what is run there, for each question. begin: before the first one; what it
        returns is the first thing heard, if it is given. Both are pickled."""
        self._line, theirs = socket.socketpair()
        self._process = started(name, _serve, theirs, answer, begin, daemon=True)
        theirs.close()
        self._line.setblocking(False)
        self._going, self._coming = b"", bytearray()
        self.gone = False
        """Whether there will be no more answers."""

    def say(self, what: object) -> None:
        """Send as much as can be sent at once; `heard` goes on with it."""
        self._going += _framed(what)
        self._exchange()

    def heard(self) -> Any:
        """What it says, when all of it is here; else None."""
        self._exchange()
        if len(self._coming) < _SIZE.size:
            return None
        (size,) = _SIZE.unpack_from(self._coming)
        if len(self._coming) < _SIZE.size + size:
            return None
        said = pickle.loads(self._coming[_SIZE.size :])
        self._coming.clear()
        return said

    def end(self, within: float = 0.0) -> None:
        """Whatever it does, when it has had so long to end by itself [s]."""
        self._line.close()
        if within > 0.0:
            self._process.join(within)
        self._process.kill()
        self._process.join()

    def _exchange(self) -> None:
        """Send and receive what can be at once."""
        try:
            while self._going:
                self._going = self._going[self._line.send(self._going) :]
            while part := self._line.recv(_PART):
                self._coming += part
            self.gone = True
        except BlockingIOError:
            pass
        except OSError:
            self.gone = True


def _framed(what: object) -> bytes:
    data = pickle.dumps(what, pickle.HIGHEST_PROTOCOL)
    return _SIZE.pack(len(data)) + data


def _serve(
    line: socket.socket, answer: Callable[[Any], Any], begin: Callable[[], Any] | None
) -> None:
    """The other process: below the loop, the gate process and the recorder."""
    bound()
    os.nice(5)
    with line, line.makefile("rb") as questions, contextlib.suppress(OSError):
        if begin is not None:
            line.sendall(_framed(begin()))
        while head := questions.read(_SIZE.size):
            (size,) = _SIZE.unpack(head)
            question = questions.read(size)
            if len(question) < size:  # who asks ended while it said it
                return
            line.sendall(_framed(answer(pickle.loads(question))))
