"""Before others, where the machine allows it: the processes that must not be late."""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading
from pathlib import Path

_SLACK, _NAME = 29, 15  # PR_SET_TIMERSLACK, PR_SET_NAME


def named(name: str) -> None:
    """Call this process so in lists of processes; at most 15 characters."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_NAME, name.encode(), 0, 0, 0)


def urgent() -> str:
    """Put this process before ordinary ones; says what was granted.

    Real-time scheduling needs a right that root has; without it a lower niceness is tried. What
    this process starts later is ordinary again.
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


def ordinary(niceness: int = 0) -> None:
    """Put this process and all its threads back among ordinary ones, when nothing is due any more.

    What it does next, such as drawing what was driven, may take long, and must keep no other
    process off the processor.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SLACK, 0, 0, 0, 0)
        for task in Path("/proc/self/task").iterdir():
            with contextlib.suppress(ProcessLookupError):
                os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))
                os.setpriority(os.PRIO_PROCESS, int(task.name), niceness)


def with_its_threads() -> None:
    """Put this process's other threads right behind the urgent one that calls this.

    They share its interpreter: one that is kept off the processor by an ordinary process while it
    holds the interpreter's lock would keep the urgent one waiting. Where real-time scheduling is
    not granted nothing changes.
    """
    own = threading.get_native_id()
    with contextlib.suppress(OSError, AttributeError):
        if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_FIFO:
            return
        for task in Path("/proc/self/task").iterdir():
            if int(task.name) != own:
                _real_time(int(task.name), 9)


def _real_time(task: int, priority: int) -> None:
    """Real-time scheduling for a thread, 0 for the one that asks; what it starts is ordinary."""
    os.sched_setscheduler(task, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
