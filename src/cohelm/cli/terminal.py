"""The terminal of a drive: shows its state, and reads typed commands."""

from __future__ import annotations

import os
import re
import select
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING

from cohelm.cli.output import console, plain, say
from cohelm.link.messages import Severity
from cohelm.link.sticks.terminal_buttons import foreground

if TYPE_CHECKING:
    from cohelm.drive.reset_here import ResetHere
    from cohelm.drive.session import Session

_LOOK = 0.2
"""From one look whether it is over to the next [s]."""
RESETS = ("r", "reset")
_NUMBERS = re.compile(r"[\d.]+")
"""Of one reason they change all the time."""


def _terminal() -> int:
    """That of stdin, if a person can type there now; else -1."""
    with suppress(OSError, ValueError, AttributeError):  # closed: `<&-`
        fd = sys.stdin.fileno()
        if os.isatty(fd) and foreground(fd):
            return fd
    return -1


@contextmanager
def typed(fd: int, reset: Callable[[], None], say: Callable[[str], None]) -> Generator[None]:
    """Hear it, from a thread, within the context. fd: of the terminal; -1: there is none."""
    over = threading.Event()

    def read() -> None:
        line = b"."
        while line and not over.is_set():  # none is Ctrl-D: the end of typing
            if not select.select([fd], [], [], _LOOK)[0] or not foreground(fd):
                over.wait(_LOOK)
                continue
            line = os.read(fd, 256)
            word = line.decode(errors="replace").strip().lower()
            if word in RESETS:
                reset()
            elif word:
                say("type r and Enter to reset; Ctrl-C ends it")

    def listen() -> None:
        with suppress(OSError):  # the terminal is closed
            read()

    thread = threading.Thread(target=listen, name="typed", daemon=True)
    if fd >= 0:
        thread.start()
    try:
        yield
    finally:
        over.set()
        if fd >= 0:
            thread.join(1.0)


@contextmanager
def shown(session: Session, reset: ResetHere, topic: str) -> Generator[None]:
    """Print state changes of the gate, and on a terminal a status line, during the drive; from a
    thread of its own. On a terminal a person may type. topic: of reset requests; empty: none."""
    screen = console(stderr=True)
    over, fd = threading.Event(), _terminal()

    def show() -> None:
        last, was_stopped, warned = "", False, set[int]()
        with screen.status("") if screen.is_terminal else nullcontext() as status:
            shows = session.live is not None
            while not over.wait(0.5):
                if shows and session.loop.log.view_lost:
                    shows = False
                    say("the live view has ended: the robot continues without it")
                for alarm in session.loop.alarms.worst():
                    if alarm.severity == Severity.WARNING and alarm.number not in warned:
                        warned.add(alarm.number)
                        say(plain(alarm.text))
                now = session.state()
                if (words := _NUMBERS.sub("", now)) != last:
                    last = words
                    say(plain(now))
                if session.stopped and not was_stopped:
                    say(_cure(fd >= 0, topic))
                was_stopped = session.stopped
                if status is not None:
                    status.update(plain(session.line()))

    thread = threading.Thread(target=show, name="live line", daemon=True)
    thread.start()
    try:
        with typed(fd, lambda: reset.ask("the terminal", time.monotonic()), say):
            yield
    finally:
        over.set()
        thread.join(1.0)


def _cure(typing: bool, topic: str) -> str:
    """How to reset a latched stop, as a sentence."""
    ways = ["type r and Enter here"] if typing else []
    ways += [f"publish std_msgs/msg/Empty once on {plain(topic)}"] if topic else []
    if ways:
        return f"it stands so until it is reset: {', or '.join(ways)}"
    return "it stands so until it is started again; with --listen a station resets it"
