"""Keeps the base from moving, whatever its sensors report: an emergency stop's lock on a topic (as
twist_mux has them), another node that commands the base past the filter, and a second driver on the
topic of a sensor.

It belongs to the gate process, and each is a fault of it: the gate latches, and only a reset after
the cause has gone lets the robot drive again (ISO 13850: releasing an emergency stop restarts
nothing).
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence

from cohelm.ros import mismatch
from cohelm.ros.mismatch import BOOL
from cohelm.ros.option_names import FILTER, OptionNames
from cohelm.ros.port import LATCHED, SENSOR, Endpoint, Received, Transport

_LOOK = 0.5
"""Period of checking the graph [s]."""


class Interlock:
    """Of one robot: `faults` says why it must not move; `close` ends it."""

    def __init__(
        self, transport: Transport, out: str, lock: str, bypass: bool = False,
        silence: float = math.inf, alone: Sequence[tuple[str, str, str]] = (),
        options: OptionNames = FILTER,
    ) -> None:  # fmt: skip
        """out: the base's commands; no other publisher is allowed there, but with bypass. lock: a
        topic of std_msgs/msg/Bool, true while nothing may move; empty: none. silence: so long may
        pass without a message on it [s]. alone: topic, type and thing of which there is one; a
        second one that begins later is as wrong as at the start, once it sends. options: by which
        the user names topics."""
        self._transport, self._out, self._lock = transport, out, lock
        self._bypass, self._silence, self._options = bypass, silence, options
        self._pressed, self._unread = "", ""
        self._received_at = time.monotonic()
        self._there, self._missed = False, 0
        self._alone, self._senders = tuple(alone), Senders()
        self._found, self._blind = ("",), ""
        """Why it must not move, by the last look; and why there was none."""
        self._over = threading.Event()
        if lock:
            # Repeated, maybe best effort; or published once and latched.
            for qos in (SENSOR, LATCHED):
                transport.subscribe(lock, BOOL, qos, self._on_lock)
        self._thread = threading.Thread(target=self._watch, name="interlock", daemon=True)
        self._thread.start()

    def faults(self) -> tuple[str, ...]:
        """Why it must not move; waits for nothing."""
        pressed, self._unread = self._pressed or self._unread, ""  # also if only for a moment
        silent = ""
        if self._lock and time.monotonic() - self._received_at > self._silence:
            silent = f"{self._lock} has been silent for more than {self._silence:g} s"
        return tuple(filter(None, (pressed, silent, *self._found, self._blind)))

    def received(self, topic: str, received: Received) -> None:
        """A message on a topic of which there is one publisher."""
        self._senders.received(topic, received.sender)

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()

    def _on_lock(self, received: Received) -> None:
        self._received_at, self._there = time.monotonic(), True
        if received.message is None:
            self._pressed = f"what comes on {self._lock} can not be read ({received.damage})"
        else:
            self._pressed = f"{self._lock} is on" if received.message.data else ""
        self._unread = self._pressed or self._unread

    def _watch(self) -> None:
        while not self._over.wait(_LOOK):
            try:
                if not self._transport.lost():
                    self._look(self._transport.endpoints())
                self._blind = ""
            except Exception as error:  # whatever it is: a watch that has ended reports nothing
                self._blind = f"who publishes what can not be looked at ({error!r:.60})"

    def _look(self, seen: list[Endpoint]) -> None:
        there = any(e.publishes and e.topic == self._lock and e.type == BOOL for e in seen)
        self._there = self._there or there
        self._missed = self._missed + 1 if self._there and not there else 0
        left = self._missed > 1  # a message may come before its publisher is discovered
        self._found = (
            f"no node publishes {self._lock} any more" if left else "",
            mismatch.lock(self._lock, seen, (), self._options)[1] if self._lock else "",
            "" if self._bypass else mismatch.bypass(self._out, seen, self._options),
            next(filter(None, (self._several(*one, seen) for one in self._alone)), ""),
        )

    def _several(self, topic: str, kind: str, what: str, seen: list[Endpoint]) -> str:
        """Why there are two of one thing; empty: there is one, and maybe one that was killed."""
        why = mismatch.alone(topic, kind, what, seen)[1]
        if not why:
            self._senders.forget(topic)
        return why if self._senders.several(topic) else ""


# Who sends on topics of which there is one driver.
#
# A driver that was killed stays listed for as long as its lease lasts, 10 or 20 seconds, and when
# it is started again under another node name, two are. But who is dead sends nothing: there are two
# drivers where one sends again after another has begun.


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
