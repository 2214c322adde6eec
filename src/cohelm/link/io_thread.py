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

    def _poll_once(self) -> None:
        """Wait for the waker and the sockets once, and process what came."""
        raise NotImplementedError

    def _on_error(self) -> None:
        """An exception in `_poll_once`."""

    def _close_all(self) -> None:
        """Close all connections."""

    def _run(self) -> None:
        try:
            while self._open:
                try:
                    self._poll_once()
                except Exception:  # a mistake of ours must not leave anybody deaf
                    _log.exception("an error in the %s; it continues", self._thread.name)
                    self._on_error()
                    time.sleep(0.01)
        finally:
            self._close_all()
            self._waker.close()
