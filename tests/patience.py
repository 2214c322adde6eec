"""Waiting on a machine that may be busy."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cohelm.drive.robot_process import RobotProcess


def looks(within: float, every: float, counted: float) -> Iterator[None]:
    """Now and then, `every` so long [s], until `within` [s] have been waited.

    While this process does not run, its threads do not either: from one look to the next no more
    than `counted` [s] is taken for waiting.
    """
    waited, last = 0.0, time.monotonic()
    while True:
        yield
        if waited > within:
            return
        time.sleep(every)
        now = time.monotonic()
        waited, last = waited + min(now - last, counted), now


class OwnTime:
    """A clock that stands still while this process does not run, as on a machine that is frozen.

    A thread looks every 10 ms; from one look to the next no more than `COUNTED` [s] is time. What
    another thread waits for, it goes on counting.
    """

    COUNTED = 0.05

    def __enter__(self) -> OwnTime:
        self._open, self._now, self.stood = True, 0.0, 0.0
        """stood: the longest time that was not counted at a stretch [s]."""
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._open = False
        self._thread.join()

    def now(self) -> float:
        """[s]"""
        return self._now

    def _look(self) -> None:
        last = time.monotonic()
        while self._open:
            time.sleep(0.01)
            now = time.monotonic()
            passed, last = now - last, now
            self._now += min(passed, self.COUNTED)
            self.stood = max(self.stood, passed - self.COUNTED)


def started(robot: RobotProcess) -> bool:
    """Whether a robot in a process of its own can be driven, once that has begun or ended."""
    while not robot.over and not robot.ready.wait(0.05):
        pass
    return not robot.over
