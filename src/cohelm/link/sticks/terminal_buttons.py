"""The four buttons as keys of the terminal, for sticks that have none."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from typing import Any

from cohelm.link.sticks.port import Button, Reading, StickDevice

KEYS = {
    ord(" "): Button.STOP, ord("r"): Button.RESET, ord("m"): Button.MODE, ord("l"): Button.LEASE,
}  # fmt: skip


class TerminalButtons:
    """A stick with the keys of this process's terminal as buttons; without one, only the stick."""

    def __init__(self, device: StickDevice, fd: int | None = None) -> None:
        """fd: of the terminal; else that of stdin."""
        self._device = device
        self.name, self.kind, self.force = device.name, device.kind, device.force
        self.repeats, self.feel = device.repeats, device.feel
        self._fd, self._before = -1, list[Any]()
        with contextlib.suppress(OSError, ValueError, AttributeError, termios.error):
            found = sys.stdin.fileno() if fd is None else fd
            if os.isatty(found) and foreground(found):
                self._before = termios.tcgetattr(found)
                tty.setcbreak(found)  # keys count at once; Ctrl-C is unchanged
                self._fd = found

    @property
    def listens(self) -> bool:
        """Whether there is a terminal."""
        return self._fd >= 0

    def read(self) -> Reading:
        """The state of the stick, with the buttons of both."""
        reading = self._device.read()
        keys = self._keys()
        return reading._replace(pressed=reading.pressed + keys) if keys else reading

    def close(self) -> None:
        """Close the stick, and restore the terminal."""
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
    """Whether this process may read from its terminal, which stops any other that does."""
    return os.tcgetpgrp(fd) == os.getpgrp()
