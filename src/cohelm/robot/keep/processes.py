"""Processes that work for this one: deaf to its terminal, and gone with it while nothing moves."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from multiprocessing import connection, reduction, resource_tracker
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from cohelm.robot.keep.priority import named


def started(
    name: str, target: Callable[..., None], *args: Any, daemon: bool = False, outlives: bool = False
) -> SpawnProcess:
    """A new process that runs `target`; it and what it starts never hear Ctrl-C, nor the end of the
    terminal.

    outlives: goes on when this one is gone while it still imports, too, which takes seconds.

    A terminal tells all of them. It is for the first one to handle, which stops a robot in order;
    and in one that still imports, it would be an error message.
    """
    context = multiprocessing.get_context("spawn")
    what = _Later((target, args))
    process = context.Process(target=_run, name=name, args=(name, what, outlives), daemon=daemon)
    resource_tracker.ensure_running()  # started along with the process it would undo the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        process.start()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)  # raises a Ctrl-C that came meanwhile
    except BaseException:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if process.pid is not None:
            process.kill()
        raise
    return process


def left_alone(process: SpawnProcess) -> None:
    """This one does not wait for it at its own end, as Python otherwise does, for ever."""
    multiprocessing.process._children.discard(process)  # pyright: ignore


def children(pid: int) -> dict[str, int]:
    """What a process has started of cohelm's, by name."""
    found: dict[str, int] = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            text = status.read_text()
            name = text.partition("\n")[0].partition("\t")[2]
            if f"PPid:\t{pid}\n" in text and name.startswith("cohelm"):
                found[name] = int(status.parent.name)
    return found


class _Later:
    """Something for another process, pickled as the rest of it is, but not unpickled with it."""

    def __init__(self, what: Any) -> None:
        self._what = what

    def __reduce__(self) -> tuple[type[bytes], tuple[bytes]]:
        return bytes, (bytes(reduction.ForkingPickler.dumps(self._what)),)


def _run(name: str, what: bytes, outlives: bool) -> None:
    named(name)
    let_go = bound()
    if outlives:
        let_go()
    target, args = pickle.loads(what)  # imports
    let_go()
    gc.freeze()  # what has been imported stays, and need never be looked through for garbage
    target(*args)


def bound() -> Callable[[], None]:
    """From now on this process ends at once when the one that started it is gone, whatever it is
    doing; until it is let go by a call of what is returned."""
    parent, free = multiprocessing.parent_process(), threading.Event()

    def watch(sentinel: int) -> None:
        connection.wait([sentinel])
        if not free.is_set():
            os._exit(1)

    if parent is not None:
        threading.Thread(target=watch, args=(parent.sentinel,), daemon=True).start()
    return free.set
