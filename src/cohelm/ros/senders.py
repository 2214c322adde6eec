"""Who sends on topics of which there is one driver.

A driver that was killed stays listed for as long as its lease lasts, 10 or 20 seconds, and when it
is started again under another node name, two are. But who is dead sends nothing: there are two
drivers where one sends again after another has begun.
"""

from __future__ import annotations

import threading


class Senders:
    """Of several topics: `received` with each message; `several` says whether there may be two."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest: dict[str, str] = {}
        """Who sent last on each topic; empty: it is not known."""
        self._former: dict[str, set[str]] = {}
        """Who sent before, and others since."""
        self._several: set[str] = set()

    def received(self, topic: str, sender: str) -> None:
        """A message on a topic. sender: as `Received` has it."""
        with self._lock:
            newest = self._newest.get(topic, sender)
            if sender != newest or not sender:
                former = self._former.setdefault(topic, set())
                if sender in former or not (sender and newest):
                    self._several.add(topic)
                former.add(newest)
            self._newest[topic] = sender

    def several(self, topic: str) -> bool:
        """Whether more than one may be sending: one sent again after another had begun, or it is
        not known who sends, or nothing has been sent."""
        with self._lock:
            return topic in self._several or topic not in self._newest

    def forget(self, topic: str) -> None:
        """Only one is there now: who sent before counts no more."""
        with self._lock:
            self._several.discard(topic)
            self._former.pop(topic, None)
