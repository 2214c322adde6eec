"""Reports publishers that are never received: another type, or a QoS that never matches; and two
where one is meant.

What comes seldom, as goals do, is not missed when it does not come; and its publisher may start
later than the robot.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.ros import mismatch
from cohelm.ros.port import Qos, Transport

_LOOK = 1.0
"""From one look to the next [s]."""
_TWICE = 2
"""A type may be discovered before its QoS: an error is reported when seen so often."""


class Wanted(NamedTuple):
    """A subscription."""

    topic: str
    kinds: tuple[str, ...]
    """Types of messages."""
    qos: Qos
    option: str
    """By which another topic is named."""
    alone: str = ""
    """What publishes it, where that has to be one; empty: any number may."""


class Unreached:
    """Checks, from a thread of its own, and logs each sentence once."""

    def __init__(
        self, transport: Transport, wanted: Sequence[Wanted], log: Callable[[str], None]
    ) -> None:
        """log: receives sentences for the user."""
        self._transport, self._wanted, self._log = transport, tuple(wanted), log
        self._seen: dict[str, int] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="unreached", daemon=True)
        if wanted:
            self._thread.start()

    def look(self) -> None:
        """Once."""
        there = self._transport.endpoints()
        for topic, kinds, qos, option, alone in self._wanted:
            why = mismatch.never(topic, kinds, qos, option, there)
            if not why and alone:
                why = mismatch.alone(topic, kinds[0], alone, there)[1]
            if why:
                self._seen[why] = self._seen.get(why, 0) + 1
                if self._seen[why] == _TWICE:
                    self._log(why)

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        if self._wanted:
            self._thread.join()

    def _run(self) -> None:
        while not self._over.wait(_LOOK):
            try:
                self.look()
            except CohelmError:  # the transport has been closed meanwhile, or its bridge is gone
                continue
