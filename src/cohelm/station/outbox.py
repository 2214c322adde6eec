"""Send queue of one page: the newest message of each slot, with flow control by credits."""

from __future__ import annotations

from collections.abc import Hashable

CREDIT = {"state": 4, "scan": 2, "frame": 2}
"""How many messages of a stream may be in flight; the page reports those it has shown."""


class Outbox:
    """A message replaces one of its slot that is not sent yet.

    A message of a stream in `CREDIT` waits until the page has shown earlier ones; slots of their
    own within a stream, as `scan/1`, share its credit.
    """

    def __init__(self) -> None:
        self._waiting: dict[Hashable, str | bytes] = {}
        self._sent: dict[Hashable, str | bytes] = {}
        self._credit = dict(CREDIT)

    def put(self, slot: Hashable, message: str | bytes, *, changed_only: bool = False) -> None:
        """Queue a message. changed_only: not if it equals the last one of its slot."""
        if changed_only and slot not in self._waiting and self._sent.get(slot) == message:
            return
        if changed_only:
            self._sent[slot] = message
        self._waiting[slot] = message

    def credit(self, stream: str) -> None:
        """The page has shown one message of this stream."""
        self._credit[stream] = min(self._credit[stream] + 1, CREDIT[stream])

    def take(self) -> list[str | bytes]:
        """The messages that can be sent now."""
        out: list[str | bytes] = []
        for slot in list(self._waiting):
            stream = slot.partition("/")[0] if isinstance(slot, str) else ""
            if stream in self._credit:
                if self._credit[stream] == 0:
                    continue
                self._credit[stream] -= 1
            out.append(self._waiting.pop(slot))
        return out
