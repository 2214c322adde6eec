"""What the filter node publishes: diagnostics, its reason, markers, and a line in the log."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import NamedTuple

from cohelm.core.types import Twist
from cohelm.law.verdict import Verdict
from cohelm.ros import messages
from cohelm.ros.clock import SimulatedClock
from cohelm.ros.found import Found
from cohelm.ros.names import resolved
from cohelm.ros.port import COMMAND, LATCHED, Transport

NODE = "cohelm_filter"
_DIAGNOSTICS, _MARKERS = 0.5, 0.2
"""Periods of publishing while nothing changes [s]."""
_FOR_GOOD = 1.0
"""A reason counts as gone when it has been away for so long [s]: they come and go from period to
period."""
_LEVELS = {
    "": messages.OK, "command": messages.OK, "limits": messages.OK, "shaped": messages.WARN,
    "brakes": messages.WARN, "monitor": messages.WARN, "readings": messages.ERROR,
    "gate": messages.ERROR, "footprint": messages.WARN,
}  # fmt: skip

_WORDED = ("readings", "gate", "command", "footprint")
"""Kinds of reasons that are published again as soon as their words change, and not their numbers
alone; of others, other words wait until the first ones are gone."""


class Row(NamedTuple):
    """One control period."""

    kind: str
    """Of the reason."""
    reason: str
    """Why the base did not get what the controller requested; empty: it did."""
    nominal: Twist
    """What the controller requested."""
    safe: Twist
    """What the filter let through."""
    applied: Twist
    """What gate and monitors let through of that: the command to the base."""
    verdict: Verdict
    change: float
    """Of the command by the filter [m/s]."""
    clearance: float
    """From the outline to what is nearest, inf: nothing near [m]."""
    latched: bool
    """Whether only a reset lets it drive again."""
    limiting: tuple[float, float] | None
    """Where that is what holds the robot back, in the frame of the odometry [m]."""
    odometry_age: float
    scan_age: float
    took: float
    """From the command to the base [s]."""


class Report:
    """Of one node."""

    def __init__(
        self, transport: Transport, found: Found, log: Callable[[str], None],
        clock: SimulatedClock | None = None,
    ) -> None:  # fmt: skip
        """log: receives each new reason, in a sentence. clock: for stamps, by default the
        wall's."""
        self._found, self._log, self._clock = found, log, clock
        self.outline = found.model.outline
        """The robot's, as it counts now."""
        space = found.topics.namespace
        self._diagnostics = transport.publish(
            resolved("diagnostics", space), messages.DIAGNOSTICS, COMMAND._replace(depth=10)
        )
        self._reason = transport.publish(self.topic("reason"), messages.STRING, LATCHED)
        self._markers = transport.publish(self.topic("markers"), messages.MARKERS, COMMAND)
        self._kind, self._text = "", ""
        self._kind_at = self._published_at = self._drawn = -math.inf
        self._reason.send(messages.reason(""))

    def topic(self, name: str) -> str:
        """One of the node's own."""
        return resolved(f"{NODE}/{name}", self._found.topics.namespace)

    def take(self, row: Row) -> None:
        """After every period."""
        now = time.monotonic()
        changed = self._changed(row, now)
        if changed or now - self._published_at >= _DIAGNOSTICS:
            self._published_at = now
            self._diagnostics.send(self._status(row))
        if now - self._drawn >= _MARKERS:
            self._drawn = now
            found = self._found
            drawn = messages.markers(
                self.outline, found.body, found.odom, _LEVELS[self._kind], row.limiting,
                found.model.axle_x_m,
            )  # fmt: skip
            self._markers.send(drawn)

    def note(self, text: str) -> None:
        """Something that happened once."""
        self._log(text)

    def _changed(self, row: Row, now: float) -> bool:
        """A new reason is published; one that stays, or comes again at once, keeps its words."""
        if (row.kind, _words(row.reason)) == (self._kind, _words(self._text)):
            self._kind_at = now
            return False
        worse = _LEVELS[row.kind] > _LEVELS[self._kind] or row.kind in _WORDED
        if not worse and now - self._kind_at < _FOR_GOOD:
            return False
        self._kind, self._text, self._kind_at = row.kind, row.reason, now
        self._reason.send(messages.reason(row.reason))
        self._log(row.reason or "commands pass unchanged")
        return True

    def _status(self, row: Row) -> object:
        found = self._found
        values: dict[str, object] = {
            "verdict": row.verdict.name, "reason": self._kind or "none",
            "nominal_v": row.nominal.v, "nominal_omega": row.nominal.omega,
            "safe_v": row.safe.v, "safe_omega": row.safe.omega,
            "applied_v": row.applied.v, "applied_omega": row.applied.omega,
            "change_mps": row.change, "clearance_m": row.clearance, "latched": row.latched,
            "odometry_age_s": row.odometry_age, "scan_age_s": row.scan_age, "took_s": row.took,
            "odometry_clock_ahead_s": found.odom_clock.ahead,
            "scan_clock_ahead_s": found.lidars[0].clock.ahead, "base_type": found.out_type,
        }  # fmt: skip
        return messages.diagnostics(
            NODE, found.model.name, _LEVELS[self._kind], self._text or "commands pass", values,
            None if self._clock is None else self._clock.time(),
        )  # fmt: skip


def _words(text: str) -> str:
    return re.sub(r"[\d.-]+", "#", text)
