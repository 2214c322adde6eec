"""The four buttons on the keyboard of the terminal, for sticks that have none."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from typing import Any

from cohelm.link.messages import Device
from cohelm.link.sticks.port import Button, Feel, Reading, StickDevice

KEYS = {
    ord(" "): Button.STOP,
    ord("r"): Button.RESET,
    ord("m"): Button.MODE,
    ord("l"): Button.LEASE,
}


class TerminalButtons:
    """A stick, and the keys of the terminal this runs in; where it runs in none, only the stick."""

    def __init__(self, device: StickDevice, fd: int | None = None) -> None:
        """fd: of the terminal; else that of stdin."""
        self._device = device
        self._fd, self._before = -1, list[Any]()
        with contextlib.suppress(OSError, ValueError, termios.error):
            found = sys.stdin.fileno() if fd is None else fd
            if os.isatty(found) and foreground(found):
                self._before = termios.tcgetattr(found)
                tty.setcbreak(found)  # a key counts at once; Ctrl-C stays what it is
                self._fd = found

    @property
    def listens(self) -> bool:
        """There is a terminal."""
        return self._fd >= 0

    @property
    def name(self) -> str:
        """That of the stick."""
        return self._device.name

    @property
    def kind(self) -> Device:
        """That of the stick."""
        return self._device.kind

    @property
    def force(self) -> bool:
        """Whether the stick can push."""
        return self._device.force

    def read(self) -> Reading:
        """How the stick stands, and what was pressed on either."""
        reading = self._device.read()
        keys = self._keys()
        return reading._replace(pressed=reading.pressed + keys) if keys else reading

    def feel(self, feel: Feel) -> None:
        """The stick's."""
        self._device.feel(feel)

    def close(self) -> None:
        """The stick's, and the terminal is as it was."""
        self._device.close()
        if self._fd >= 0:
            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)
            self._fd = -1

    def _keys(self) -> tuple[Button, ...]:
        if self._fd < 0:
            return ()
        with contextlib.suppress(OSError):
            if foreground(self._fd) and select.select([self._fd], [], [], 0.0)[0]:
                return tuple(KEYS[key] for key in os.read(self._fd, 64) if key in KEYS)
        return ()


def foreground(fd: int) -> bool:
    """Another process of the terminal that reads from it is stopped by it."""
    return os.tcgetpgrp(fd) == os.getpgrp()
