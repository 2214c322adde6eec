"""How fast bulk may flow without the datagrams waiting behind it.

TCP fills whatever buffer the network has, and what is behind it in the buffer waits. The round
trip of the datagrams shows how full it is: bulk slows down as soon as the round trip grows beyond
its shortest by more than `TARGET`, and speeds up while it does not (as LEDBAT, RFC 6817).
"""

from __future__ import annotations

import math
from collections import deque

TARGET = 0.025
"""Waiting that bulk may cause [s]."""
SLOWEST, FASTEST = 10e3, 50e6
"""[byte/s]"""
_GAIN = 0.2
_EVERY = 0.1  # [s], between two changes
_RECENT = 4  # round trips, whose least is taken: jitter is not a queue


class Pace:
    """Bytes that may leave now."""

    def __init__(self, now: float) -> None:
        self.rate = 256e3
        """[byte/s]"""
        self._tokens = 0.0
        self._filled = self._changed = now
        self._recent: deque[float] = deque(maxlen=_RECENT)

    def saw(self, round_trip: float, shortest: float, now: float) -> None:
        """Newest and shortest round trip of the datagrams [s]; NaN where there is none."""
        if now - self._changed < _EVERY:
            return
        self._changed = now
        if not math.isfinite(round_trip - shortest):
            return
        self._recent.append(round_trip)
        waiting = min(self._recent) - shortest
        change = max(-1.0, min(1.0, 1.0 - waiting / TARGET))
        self.rate = max(SLOWEST, min(FASTEST, self.rate * (1.0 + _GAIN * change)))

    def allowed(self, now: float) -> int:
        """Bytes that may be sent now; a pause is not made up for."""
        most = max(2048.0, 0.02 * self.rate)
        self._tokens = min(most, self._tokens + (now - self._filled) * self.rate)
        self._filled = now
        return max(0, int(self._tokens))

    def sent(self, count: int) -> None:
        """So many have been."""
        self._tokens -= count
