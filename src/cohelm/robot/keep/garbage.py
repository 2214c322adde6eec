"""Python's garbage collector where nobody may be late: only in spare time, and never over all.

Left to itself it looks through everything a process has imported, every ten seconds or so, and
takes a tenth of a second for it. What is there at the start stays; so it need not be looked
through. What a period makes and drops goes without the collector, but for what refers to itself.
"""

from __future__ import annotations

import gc

EVERY = 5.0
"""From one sweep to the next [s]."""
_ALL = 12  # one sweep in so many goes through all that was made since the start


class Sweeper:
    """From when it is made, garbage is swept when `sweep` is called, and else never."""

    def __init__(self) -> None:
        gc.collect()
        gc.freeze()
        gc.disable()
        self._swept = -float("inf")
        self._sweeps = 0

    def sweep(self, now: float) -> bool:
        """In spare time: whether it did. now: of any one clock [s]."""
        if now - self._swept < EVERY:
            return False
        self._swept = now
        self._sweeps += 1
        gc.collect(2 if self._sweeps % _ALL == 0 else 0)
        return True

    def end(self) -> None:
        """As Python would have it again."""
        gc.enable()
        gc.unfreeze()
