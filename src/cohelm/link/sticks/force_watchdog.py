"""Takes the force from a stick when the process that made it dies or hangs.

CLS2Sim's documentation does not specify what becomes of the last force when no request follows. So
a small process receives the heartbeats of the one that makes the force: after 250 ms without one,
and at its end however it ends, it requests no force of CLS2Sim. It needs only the standard
library. Nothing helps against a cable that is pulled.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import struct
import subprocess
import sys
import time

_SILENCE = 0.25  # [s]
_TIMES, _APART = 3, 0.005  # one may be lost
_NO_FORCE = struct.pack("<i4i", 0xAF, 0, 0, 0, 0)


class ForceWatchdog:
    """Handle of the watchdog process, for the process that it watches."""

    def __init__(self, host: str, port: int) -> None:
        """host, port: of CLS2Sim; the address, not a name."""
        self._program = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, host, str(port)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
            start_new_session=True,  # no Ctrl-C: it ends after the other process
        )  # fmt: skip
        assert self._program.stdin is not None
        self._pipe = self._program.stdin.fileno()
        os.set_blocking(self._pipe, False)

    def beat(self) -> bool:
        """Send a heartbeat; whether the watchdog receives it. Never waits."""
        try:
            return os.write(self._pipe, b".") == 1
        except OSError:  # it has ended, or does not read any more
            return False

    def close(self) -> None:
        """Make it remove the force, and end."""
        if self._program.stdin is not None and not self._program.stdin.closed:
            self._program.stdin.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._program.wait(1.0)


def watch(pipe: int, host: str, port: int) -> None:
    """Watch until the other end of the pipe is closed."""
    address = (host, port)
    line = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    line.setblocking(False)
    beats = selectors.DefaultSelector()
    beats.register(pipe, selectors.EVENT_READ)
    armed = False  # one release until the next heartbeat
    while True:
        if not beats.select(_SILENCE):
            if armed:
                _release(line, address)
            armed = False
        elif not os.read(pipe, 4096):
            _release(line, address)
            return
        else:
            armed = True


def _release(line: socket.socket, address: tuple[str, int]) -> None:
    for _ in range(_TIMES):
        with contextlib.suppress(OSError):
            line.sendto(_NO_FORCE, address)
        time.sleep(_APART)


if __name__ == "__main__":
    watch(0, sys.argv[1], int(sys.argv[2]))
