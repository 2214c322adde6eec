"""Runs an end of the link in an I/O thread of its own, with a waker."""

from __future__ import annotations

import logging
import threading
import time
from typing import Self

from cohelm.link import udp

_log = logging.getLogger("cohelm.link")


class IoThread:
    """Turns in a thread until it is closed; a context manager.

    Whoever extends it calls `_start` when it is ready to turn.
    """

    def __init__(self, name: str) -> None:
        """name: of the thread."""
        self._waker = udp.Waker()
        self._open = True
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Say good-bye, and end."""
        self._open = False
        self._waker.wake()
        self._thread.join(2.0)

    def _start(self) -> None:
        self._thread.start()

    def _turn(self) -> None:
        """Once: wait for the waker and the sockets, and do what there is to do."""
        raise NotImplementedError

    def _mistaken(self) -> None:
        """A turn broke down by a mistake of ours."""

    def _let_go(self) -> None:
        """Say good-bye to all; no turn follows."""

    def _run(self) -> None:
        try:
            while self._open:
                try:
                    self._turn()
                except Exception:  # a mistake of ours must not leave anybody deaf
                    _log.exception("a mistake in the %s; it goes on", self._thread.name)
                    self._mistaken()
                    time.sleep(0.01)
        finally:
            self._let_go()
            self._waker.close()
