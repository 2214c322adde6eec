"""Congestion control of bulk, by the queueing delay of the datagrams (as LEDBAT, RFC 6817).

TCP fills whatever buffer the network has, and the datagrams behind it wait. Their round trip shows
how full the buffer is: bulk slows down when the round trip exceeds its shortest by more than
`TARGET`, and speeds up while it does not.
"""

from __future__ import annotations

import math

TARGET = 0.025
"""Queueing delay that bulk may cause [s]."""
SLOWEST, FASTEST = 10e3, 50e6
"""[byte/s]"""
_FASTER, _SLOWER = 0.1, 0.3
_EVERY = 0.1  # [s], between two changes, by the least round trip in between


class CongestionControl:
    """Token bucket of the bytes that may be sent."""

    def __init__(self, now: float) -> None:
        self.rate = 256e3
        """[byte/s]"""
        self._tokens = 0.0
        self._filled = self._changed = now
        self._least = math.inf

    def observe(self, round_trip: float, shortest: float, now: float) -> None:
        """Newest and shortest round trip of the datagrams [s]; NaN: none."""
        if math.isfinite(round_trip - shortest):
            self._least = min(self._least, round_trip)  # jitter is no queue
        if now - self._changed < _EVERY:
            return
        least, self._least, self._changed = self._least, math.inf, now
        if math.isinf(least):
            return
        change = max(-1.0, min(1.0, 1.0 - (least - shortest) / TARGET))
        self.rate *= 1.0 + (_FASTER if change > 0.0 else _SLOWER) * change
        self.rate = max(SLOWEST, min(FASTEST, self.rate))

    def allowed(self, now: float) -> int:
        """Bytes that may be sent now; unused ones are not saved up over a pause."""
        most = max(2048.0, 0.02 * self.rate)
        self._tokens = min(most, self._tokens + (now - self._filled) * self.rate)
        self._filled = now
        return max(0, int(self._tokens))

    def sent(self, count: int) -> None:
        """Bytes have been sent."""
        self._tokens -= count
