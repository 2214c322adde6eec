"""Runs slow jobs beside the loop, one after the other: in a thread, or inline."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

from cohelm.core.errors import CohelmError

Job = Callable[[], None]
_log = logging.getLogger("cohelm.drive")


class InlineJobs:
    """Runs jobs at once: for simulated time, deterministic."""

    def do(self, job: Job) -> None:
        """Now."""
        job()

    def close(self, within: float) -> bool:
        """Nothing is running."""
        return True


class ThreadJobs:
    """Runs jobs in a thread: for real time."""

    def __init__(self, name: str) -> None:
        """name: of the thread."""
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._open = True
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def do(self, job: Job) -> None:
        """In the thread."""
        self._jobs.put(job)

    def close(self, within: float) -> bool:
        """Drop the jobs that have not begun."""
        self._open = False
        self._jobs.put(None)
        self._thread.join(within)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None and self._open:
            try:
                job()
            except Exception:
                _log.exception("an error in a background job; the loop continues")


Jobs = InlineJobs | ThreadJobs
"""Runs jobs; the caller limits them to one of each kind at a time."""


def told(error: Exception) -> str:
    """What whoever asked for a job is told of its error; the log has all of what is not theirs."""
    if isinstance(error, CohelmError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    _log.error("an error in a background job; the loop continues", exc_info=error)
    return f"{type(error).__name__}: {error}"


def in_thread(what: Callable[[], None]) -> Callable[[], None]:
    """Run `what` in a thread, so that compiling here and in the gate process takes only the longer
    of both times. Returns a function that waits for its end, and raises what it raised."""
    raised: list[BaseException] = []

    def done() -> None:
        try:
            what()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=done, name="warm up", daemon=True)
    thread.start()

    def join() -> None:
        thread.join()
        if raised:
            raise raised[0]

    return join
