"""Rate limits: a token bucket, and coalesced log lines."""

from __future__ import annotations

from typing import NamedTuple

EVERY = 1.0
"""Least time between two lines about the same thing [s]."""
_MOST_KEYS = 64


class TokenBucket:
    """Holds `at_once` tokens at most and gets `per_second` new ones; nothing passes without one."""

    def __init__(self, per_second: float, at_once: float, now: float) -> None:
        """Full at `now` [s]."""
        self.per_second, self.at_once = per_second, at_once
        self._left, self._at = at_once, now

    def take(self, now: float) -> bool:
        """Whether there was a token at `now` [s]; it is gone then."""
        self._left = min(self._left + (now - self._at) * self.per_second, self.at_once)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class _Kept(NamedTuple):
    since: float
    times: int
    text: str


class Coalesced:
    """Log lines by key: the first is logged at once, repetitions within a second as one line with
    their count. Memory is bounded for any number of keys."""

    def __init__(self) -> None:
        self._kept: dict[object, _Kept] = {}

    def add(self, now: float, key: object, text: str) -> list[str]:
        """The lines to be written now that this happened."""
        due = self.due(now)
        kept = self._kept.get(key)
        if kept is None and len(self._kept) >= _MOST_KEYS:
            key = None  # all others together
            kept = self._kept.get(key)
        if kept is None:
            self._kept[key] = _Kept(now, 0, text)
            return [*due, text]
        self._kept[key] = _Kept(kept.since, kept.times + 1, text)
        return due

    def due(self, now: float) -> list[str]:
        """The lines that have waited long enough; to be called now and then."""
        due: list[str] = []
        for key, kept in list(self._kept.items()):
            if now - kept.since < EVERY:
                continue
            if kept.times == 0:
                del self._kept[key]
                continue
            more = f" ({kept.times} times within {now - kept.since:.1f} s)"
            due.append(kept.text + (more if kept.times > 1 else ""))
            self._kept[key] = _Kept(now, 0, kept.text)
        return due
