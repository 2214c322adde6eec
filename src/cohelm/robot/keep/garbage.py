"""Runs Python's garbage collector in spare time only, for processes with deadlines.

Left to itself it scans everything a process has imported, every ten seconds or so, for a tenth of
a second. Objects that exist at the start are frozen, so that they are not scanned. Reference
counting frees what a period makes; the collector is for reference cycles only.
"""

from __future__ import annotations

import gc

EVERY = 5.0
"""From one sweep to the next [s]."""
_ALL = 12  # one sweep in so many goes through all that was made since the start


class Sweeper:
    """While it exists, garbage is collected in `sweep` only."""

    def __init__(self) -> None:
        gc.collect()
        gc.freeze()
        gc.disable()
        self._swept = -float("inf")
        self._sweeps = 0

    def sweep(self, now: float) -> bool:
        """Collect if it is due; whether it did. now: of any one clock [s]."""
        if now - self._swept < EVERY:
            return False
        self._swept = now
        self._sweeps += 1
        gc.collect(2 if self._sweeps % _ALL == 0 else 0)
        return True

    def end(self) -> None:
        """Restore Python's own schedule."""
        gc.enable()
        gc.unfreeze()
