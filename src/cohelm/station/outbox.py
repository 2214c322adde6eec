"""What waits to be sent to one page: the newest of everything, and only as much as it can take."""

from __future__ import annotations

from collections.abc import Hashable

CREDIT = {"state": 4, "scan": 2, "frame": 2}
"""How many of a stream may be on their way; the page says what it has shown."""


class Outbox:
    """Newest wins: a message replaces one of its slot that was not sent yet.

    What belongs to a stream of `CREDIT` waits until the page has shown earlier ones, and so
    does what has a slot of its own in one, `scan/1`.
    """

    def __init__(self) -> None:
        self._waiting: dict[Hashable, str | bytes] = {}
        self._sent: dict[Hashable, str | bytes] = {}
        self._credit = dict(CREDIT)

    def put(self, slot: Hashable, message: str | bytes, *, changed_only: bool = False) -> None:
        """Have it sent. changed_only: not if it is what was sent last."""
        if changed_only and slot not in self._waiting and self._sent.get(slot) == message:
            return
        if changed_only:
            self._sent[slot] = message
        self._waiting[slot] = message

    def credit(self, stream: str) -> None:
        """The page has shown one of this stream."""
        self._credit[stream] = min(self._credit[stream] + 1, CREDIT[stream])

    def take(self) -> list[str | bytes]:
        """What can be sent now."""
        out: list[str | bytes] = []
        for slot in list(self._waiting):
            stream = slot.partition("/")[0] if isinstance(slot, str) else ""
            if stream in self._credit:
                if self._credit[stream] == 0:
                    continue
                self._credit[stream] -= 1
            out.append(self._waiting.pop(slot))
        return out
