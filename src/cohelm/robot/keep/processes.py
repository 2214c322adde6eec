"""Child processes that ignore the terminal's signals and end with their parent."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing import connection, reduction, resource_tracker
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from cohelm.robot.keep.priority import set_process_name

_PARENT_GONE = 1  # PR_SET_PDEATHSIG


def start_process(
    name: str, target: Callable[..., None], *args: Any, daemon: bool = False, outlives: bool = False
) -> SpawnProcess:
    """A new process that runs `target`; SIGINT and SIGHUP are blocked in it and its children.

    A terminal signals all its processes. The parent handles that and stops the robot in order; in
    a child that still imports it would be a traceback. What a child prints is no result of a
    command, and goes to stderr. outlives: the child also survives its parent while it still
    imports, which takes seconds.
    """
    context = multiprocessing.get_context("spawn")
    what = _PickledApart((target, args))
    streams = sys.__stdout__ is not None and sys.__stderr__ is not None  # else others' numbers
    arguments = name, what, outlives, streams
    process = context.Process(target=_run, name=name, args=arguments, daemon=daemon)
    resource_tracker.ensure_running()  # started with the process, it would undo the mask
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


def how_ended(process: SpawnProcess, within: float) -> str:
    """How a process has ended, or does so within that time [s]; empty: it has not."""
    process.join(within)
    code = process.exitcode
    if code is None:
        return ""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"it exited with code {code}"


def stopped(process: SpawnProcess) -> bool:
    """Whether a process stands still, as after SIGSTOP."""
    try:
        stat = Path(f"/proc/{process.pid}/stat").read_text()
    except OSError:  # it has ended
        return False
    return stat.rpartition(")")[2].split()[0] == "T"


def resume(process: SpawnProcess) -> None:
    """Continue a process that may have been stopped: else it can not end."""
    if process.is_alive():
        os.kill(process.pid or 0, signal.SIGCONT)


def detach(process: SpawnProcess) -> None:
    """Do not join the process at exit, as Python would, without a limit."""
    multiprocessing.process._children.discard(process)  # pyright: ignore


def lead_group() -> None:
    """This process's later children are of a group of its own, unless they leave it.

    The terminal belongs to another group. It may be written to all the same, and to read it is an
    error: by default either would stop all processes of the group.
    """
    for number in (signal.SIGTTOU, signal.SIGTTIN):
        signal.signal(number, signal.SIG_IGN)
    os.setpgid(0, 0)


def end_group(leader: int | None = None) -> None:
    """Kill the processes of this one's group but for itself, or those of another that leads one: as
    what a driver has forked holds what it has opened."""
    me, group = os.getpid(), leader or os.getpgid(0)
    for process in Path("/proc").glob("[0-9]*"):
        pid = int(process.name)
        with contextlib.suppress(OSError):  # it has ended meanwhile
            if pid != me and os.getpgid(pid) == group:
                os.kill(pid, signal.SIGKILL)


class _PickledApart:
    """Pickled with the process object, but unpickled later, by `_run`."""

    def __init__(self, what: Any) -> None:
        self._what = what

    def __reduce__(self) -> tuple[type[bytes], tuple[bytes]]:
        return bytes, (bytes(reduction.ForkingPickler.dumps(self._what)),)


def _run(name: str, what: bytes, outlives: bool, streams: bool) -> None:
    set_process_name(name)
    if streams:
        os.dup2(2, 1)
    release = end_with_parent()
    if outlives:
        release()
    target, args = pickle.loads(what)  # imports
    release()
    gc.freeze()  # what has been imported stays, and need never be looked through for garbage
    target(*args)


def killed_with_parent() -> None:
    """From now on the kernel kills this process when the thread that started it ends, whatever it
    is doing; also where it computes without letting go of the interpreter."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PARENT_GONE, signal.SIGKILL, 0, 0, 0)


def end_with_parent() -> Callable[[], None]:
    """From now on this process exits at once when its parent is gone, whatever it is doing.

    Returns a function that releases it from that.
    """
    parent, free = multiprocessing.parent_process(), threading.Event()

    def watch(sentinel: int) -> None:
        connection.wait([sentinel])
        if not free.is_set():
            os._exit(1)

    if parent is not None:
        threading.Thread(target=watch, args=(parent.sentinel,), daemon=True).start()
    return free.set
