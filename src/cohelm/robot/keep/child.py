"""A worker process that answers one request after the other and never blocks the caller.

It has the lowest priority and may be preempted in the middle of a message, so neither side waits
for the rest of one.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import socket
import struct
from collections.abc import Callable
from typing import Any

from cohelm.robot.keep.processes import (
    detach,
    end_group,
    end_with_parent,
    how_ended,
    start_process,
)

_SIZE = struct.Struct("!Q")
_PART = 1 << 18


class Child:
    """The process and the socket to it. All calls come from one thread and return at once."""

    def __init__(
        self, name: str, answer: Callable[[Any], Any], begin: Callable[[], Any] | None = None,
        parent: bool = False,
    ) -> None:  # fmt: skip
        """answer: run there for each request. begin: run there first; what it returns is received
        first, unless that is None. Both are pickled. parent: it may start processes, which end
        with it."""
        self._line, theirs = socket.socketpair()
        self._process = start_process(name, _serve, theirs, answer, begin, daemon=not parent)
        theirs.close()
        self._parent = parent
        if parent:
            detach(self._process)  # Python would wait for it at exit
        self._line.setblocking(False)
        self._outgoing, self._incoming = b"", bytearray()
        self.gone = False
        """Whether the process has ended: there will be no more answers."""

    def send(self, what: object) -> None:
        """Send as much as can be sent at once; `received` continues."""
        self._outgoing += _framed(what)
        self._exchange()

    def received(self) -> Any:
        """The next answer when all of it has come; else None."""
        self._exchange()
        if len(self._incoming) < _SIZE.size:
            return None
        (size,) = _SIZE.unpack_from(self._incoming)
        if len(self._incoming) < _SIZE.size + size:
            return None
        answer = pickle.loads(self._incoming[_SIZE.size :])
        self._incoming.clear()
        return answer

    def wait(self, most: float) -> None:
        """Until there is something to send or receive, `most` seconds."""
        select.select([self._line], [self._line] if self._outgoing else [], [], most)

    def end(self, within: float = 0.0) -> str:
        """Kill it, after it has had `within` [s] to end by itself. Returns how it did; empty: it
        did not."""
        self._line.close()
        ended = how_ended(self._process, within)
        self._process.kill()
        self._process.join()
        if self._parent:
            end_group(self._process.pid)
        return ended

    def _exchange(self) -> None:
        """Send and receive what is possible without waiting."""
        try:
            while self._outgoing:
                self._outgoing = self._outgoing[self._line.send(self._outgoing) :]
            while part := self._line.recv(_PART):
                self._incoming += part
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
    """The worker: lower priority than the loop, the gate process and the recorder."""
    end_with_parent()
    os.nice(5)
    with line, line.makefile("rb") as questions, contextlib.suppress(OSError):
        if begin is not None and (begun := begin()) is not None:
            line.sendall(_framed(begun))
        while head := questions.read(_SIZE.size):
            (size,) = _SIZE.unpack(head)
            question = questions.read(size)
            if len(question) < size:  # the caller ended in the middle of it
                return
            line.sendall(_framed(answer(pickle.loads(question))))
