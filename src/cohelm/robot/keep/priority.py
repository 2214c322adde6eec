"""Scheduling priorities of processes and threads."""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading
from pathlib import Path

_SLACK, _NAME = 29, 15  # PR_SET_TIMERSLACK, PR_SET_NAME


def set_process_name(name: str) -> None:
    """Set the name that process lists show; at most 15 characters."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_NAME, name.encode(), 0, 0, 0)


def raise_priority() -> str:
    """Ask for real-time scheduling (SCHED_FIFO) of this process; returns what was granted.

    It needs CAP_SYS_NICE; without it a lower niceness is tried. Processes started later have
    ordinary scheduling.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SLACK, 1, 0, 0, 0)  # wake up on time, not 50 us later
    try:
        _real_time(0, 10)
    except (OSError, AttributeError):
        pass
    else:
        return "real-time scheduling"
    try:
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    except OSError:
        return "ordinary scheduling (real-time scheduling needs the right CAP_SYS_NICE)"
    return "raised priority"


def restore_priority(niceness: int = 0) -> None:
    """Restore ordinary scheduling of this process and all its threads, when nothing is due any
    more: what follows, such as drawing figures, must not starve others.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SLACK, 0, 0, 0, 0)
        for task in Path("/proc/self/task").iterdir():
            with contextlib.suppress(ProcessLookupError):
                os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))
                os.setpriority(os.PRIO_PROCESS, int(task.name), niceness)


def raise_thread_priorities() -> None:
    """Give this process's other threads the priority just below the calling thread's.

    Otherwise one that is preempted by an ordinary process while it holds the interpreter's lock
    (GIL) would block the caller: priority inversion. Without real-time scheduling nothing changes.
    """
    own = threading.get_native_id()
    with contextlib.suppress(OSError, AttributeError):
        if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_FIFO:
            return
        for task in Path("/proc/self/task").iterdir():
            if int(task.name) != own:
                _real_time(int(task.name), 9)


def _real_time(task: int, priority: int) -> None:
    """Real-time scheduling for a thread, 0: the calling one; its children are ordinary."""
    os.sched_setscheduler(task, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
