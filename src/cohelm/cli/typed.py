"""What a person types in the terminal of a drive: r and Enter asks for a reset."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from cohelm.link.sticks.terminal_buttons import foreground

_LOOK = 0.2
"""From one look whether it is over to the next [s]."""
RESETS = ("r", "reset")


def terminal() -> int:
    """That of stdin, if a person can type there now; else -1."""
    with suppress(OSError, ValueError):
        fd = sys.stdin.fileno()
        if os.isatty(fd) and foreground(fd):
            return fd
    return -1


@contextmanager
def typed(fd: int, reset: Callable[[], None], say: Callable[[str], None]) -> Generator[None]:
    """Hear it, from a thread, within the context. fd: of the terminal; -1: there is none."""
    over = threading.Event()

    def read() -> None:
        while not over.is_set():
            with suppress(OSError):
                if not select.select([fd], [], [], _LOOK)[0] or not foreground(fd):
                    over.wait(_LOOK)
                    continue
                line = os.read(fd, 256)
                if not line:  # Ctrl-D: nobody types any more
                    return
                word = line.decode(errors="replace").strip().lower()
                if word in RESETS:
                    reset()
                elif word:
                    say("type r and Enter to reset; Ctrl-C ends it")

    thread = threading.Thread(target=read, name="typed", daemon=True)
    if fd >= 0:
        thread.start()
    try:
        yield
    finally:
        over.set()
        if fd >= 0:
            thread.join(1.0)
