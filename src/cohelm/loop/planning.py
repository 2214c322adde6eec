"""The slow part of the pilot, where it can not make the loop late: in another process."""

from __future__ import annotations

import contextlib
import os
import pickle
import socket
import struct
from collections import deque
from typing import Protocol

from cohelm.pilot.pilot import Planner
from cohelm.pilot.plan import Plan, Task
from cohelm.robot.keep.processes import bound, started

ANSWER = 2.0
"""A plan that takes longer is not used [s]. They take 0.04 s, and ten times that on a busy machine;
meanwhile the robot goes a metre, as far as its plans look ahead around things."""
_ASKED = 0.1  # who asks more seldom for a plan does not wait for it [s]


class Planning(Protocol):
    """Takes a snapshot, and has a plan some periods later."""

    broken: bool
    """Whether there will be no more plans: the course stays as it is."""
    late: bool
    """Whether there was no plan in time, so that none is used, though there may be some again."""

    @property
    def busy(self) -> bool:
        """Whether a plan is being made, or has not been asked for since."""
        ...

    def offer(self, now: float, task: Task) -> bool:
        """Plan from this; False where the last one is not done yet."""
        ...

    def plan(self, now: float) -> Plan | None:
        """The plan, once, when it is there."""
        ...

    def close(self) -> None:
        """No more plans."""
        ...


class Here:
    """Plans at once, and hands the plan out after a set time: the same in every run."""

    def __init__(self, planner: Planner, takes: float = 0.04) -> None:
        """takes: as long as it would take elsewhere [s]."""
        self._planner, self._takes = planner, takes
        self.broken = self.late = False
        self._made: deque[tuple[float, Plan]] = deque()

    @property
    def busy(self) -> bool:
        """Whether a plan has not been handed out yet."""
        return bool(self._made)

    def offer(self, now: float, task: Task) -> bool:
        """Plan now."""
        if self._made:
            return False
        self._made.append((now + self._takes, self._planner(task)))
        return True

    def plan(self, now: float) -> Plan | None:
        """The plan, when its time has come."""
        if self._made and now >= self._made[0][0]:
            return self._made.popleft()[1]
        return None

    def close(self) -> None:
        """Nothing to close."""


class Elsewhere:
    """Plans in a process of its own.

    That process is below all others, and may be stopped by them in the middle of a message: so
    nothing here waits for the rest of one, in either direction. A plan whose task is older than
    `ANSWER` is not used: it is for a place where the robot no longer is.
    """

    def __init__(self, planner: Planner) -> None:
        self._line, theirs = socket.socketpair()
        self._process = started("cohelm planner", _plan, theirs, planner, daemon=True)
        theirs.close()
        self._line.setblocking(False)
        self._going, self._coming = b"", bytearray()
        self.busy = False
        self._offered = self._asked = 0.0
        self._waited = 0.0
        """For this plan, as long as somebody asked for it [s]."""
        self.broken = self.late = False

    def offer(self, now: float, task: Task) -> bool:
        """Send it over, unless one is there."""
        if self.busy or self.broken:
            return False
        self._going, self.busy = _framed(task), True
        self._offered, self._asked, self._waited = now, now, 0.0
        self._exchange()
        return not self.broken

    def plan(self, now: float) -> Plan | None:
        """The plan, if all of it has come back."""
        if not self.busy or self.broken:
            return None
        self._exchange()
        made = self._come()
        gap = max(now - self._asked, 0.0)
        # After a long gap another drive has begun, that has not waited yet.
        self._waited = 0.0 if gap > ANSWER else self._waited + min(gap, _ASKED)
        self.late = self.late and self._waited > 0.0
        self._asked = now
        if made is None:
            self.late = self.late or self._waited > ANSWER
            return None
        self.busy = False
        old = now - self._offered > ANSWER
        self.late = self._waited > ANSWER  # who did not ask did not wait
        return None if old else made

    def _come(self) -> Plan | None:
        """The plan, if all of it is there."""
        if len(self._coming) < _SIZE.size:
            return None
        (size,) = _SIZE.unpack_from(self._coming)
        if len(self._coming) < _SIZE.size + size:
            return None
        made: Plan = pickle.loads(self._coming[_SIZE.size :])
        self._coming.clear()
        return made

    def _exchange(self) -> None:
        """Send and receive what can be at once."""
        try:
            while self._going:
                self._going = self._going[self._line.send(self._going) :]
            while part := self._line.recv(1 << 18):
                self._coming += part
            self.broken = True
        except BlockingIOError:
            pass
        except OSError:
            self.broken = True

    def close(self) -> None:
        """End the process."""
        self._line.close()
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


_SIZE = struct.Struct("!Q")


def _framed(what: object) -> bytes:
    data = pickle.dumps(what, pickle.HIGHEST_PROTOCOL)
    return _SIZE.pack(len(data)) + data


def _plan(line: socket.socket, planner: Planner) -> None:
    """The other process: below the loop, the keeper and the recorder."""
    bound()
    os.nice(5)
    with line, line.makefile("rb") as tasks, contextlib.suppress(OSError):
        while head := tasks.read(_SIZE.size):
            (size,) = _SIZE.unpack(head)
            task = tasks.read(size)
            if len(task) < size:  # the loop ended while it told it
                return
            line.sendall(_framed(planner(pickle.loads(task))))
