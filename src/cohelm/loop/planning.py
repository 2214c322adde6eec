"""The slow part of the pilot, where it can not make the loop late: in another process."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from multiprocessing.connection import Connection
from typing import Protocol

from cohelm.pilot.pilot import Planner
from cohelm.pilot.plan import Plan, Task
from cohelm.robot.keep.priority import named


class Planning(Protocol):
    """Takes a snapshot, and has a plan some periods later."""

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
        self._made: deque[tuple[float, Plan]] = deque()

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
    """Plans in a process of its own."""

    def __init__(self, planner: Planner) -> None:
        context = multiprocessing.get_context("spawn")
        self._line, theirs = context.Pipe(duplex=True)
        self._process = context.Process(
            target=_plan, args=(theirs, planner), name="cohelm planner", daemon=True
        )
        self._process.start()
        theirs.close()
        self._busy = False
        self.broken = False
        """Whether the process is gone: the course stays as it is."""

    def offer(self, now: float, task: Task) -> bool:
        """Send it over, unless one is there."""
        if self._busy or self.broken:
            return False
        try:
            self._line.send(task)
        except OSError:
            self.broken = True
            return False
        self._busy = True
        return True

    def plan(self, now: float) -> Plan | None:
        """The plan, if it has come back."""
        if not self._busy or self.broken:
            return None
        try:
            if not self._line.poll():
                return None
            self._busy = False
            return self._line.recv()
        except (EOFError, OSError):
            self.broken = True
            return None

    def close(self) -> None:
        """End the process."""
        self._line.close()
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _plan(line: Connection, planner: Planner) -> None:
    """The other process: below the loop, the keeper and the recorder."""
    named("cohelm planner")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(5)
    while True:
        try:
            line.send(planner(line.recv()))
        except (EOFError, OSError):
            return
