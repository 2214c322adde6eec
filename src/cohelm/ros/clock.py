"""Estimates the offset of the robot's clock to this machine's, so that stamps become ages.

Only the time of arrival is known, not the latency; so an offset can be told from a latency only
where it is larger than any plausible one, or where messages seem to be from the future.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.ros.port import SENSOR, Received, Transport

AHEAD, BEHIND = 0.02, 0.15
"""Readings that are this much younger or older than now may come from a clock that is right [s]."""
MOST = 5.0
"""Clocks that differ by more are not taken into account but refused, unless allowed [s]."""
SIMULATED = 1e8
"""Stamps before this are of a simulator's clock, or of none [s]: three years after 1970."""
TOPIC, TYPE = "/clock", "rosgraph_msgs/msg/Clock"
"""Where a simulator publishes its time; in no namespace."""
FASTEST = 1.1
"""A simulator may be so many times as fast as the wall: what the filter counts with in seconds of
the wall, its period and the delay of the wheels, must be no longer there."""
SILENT = 0.3
"""A simulator silent for so long stands, or is gone [s]; the slowest publish ten times a second."""
STEP = 0.05
"""A change of the wall clock by more, from one look to the next, is a step [s]: chrony and ntpd
slew by a thousandth."""
TRANSIT = 2.0
"""What comes longer after a step was not stamped before it [s]."""
_LEARNS = 1.0
"""The rate is that of about so much of the wall's time [s]: in less, messages that a busy machine
delivers late, and then at once, make it a faster one."""


class Clock(NamedTuple):
    """How the robot's clock stands."""

    ahead: float = 0.0
    """Of this machine's wall clock [s]; 0 where both agree within what can be measured."""

    def age(self, stamp: float) -> float:
        """How long ago a stamp of the robot's was [s]."""
        return time.time() + self.ahead - stamp


class WallSteps:
    """Notices that this machine's wall clock was set, as by NTP after a boot, and corrects the ages
    of what was stamped before that and is looked at after it: to drivers on the same machine
    nothing happened."""

    def __init__(self) -> None:
        self._looked = time.monotonic()
        self._offset = time.time() - self._looked
        self._by = 0.0
        self._since = self._until = -math.inf
        """The newest step: by how much, after when, and until when it may be in transit [s]."""

    def corrected(self, age: float) -> float:
        """The true age of what seems so old by the wall clock of now [s]."""
        now = time.monotonic()
        offset = time.time() - now
        if abs(offset - self._offset) > STEP:
            self._by, self._since, self._until = offset - self._offset, self._looked, now + TRANSIT
        self._looked, self._offset = now, offset
        before = age > now - self._since if self._by > 0.0 else age < -AHEAD
        if now > self._until or not before:
            return age
        true = age - self._by
        return true if -AHEAD <= true <= TRANSIT else age


class Lateness:
    """How much longer messages of one sender are under way than the fastest of late, where nothing
    is known of its clock.

    Held up on its way (by a bridge over TCP, a router's queue), a message comes seconds after it
    was stamped, and others right behind it. That all are held up equally, from the first one on,
    can not be seen. A clock that was set back makes all messages late, for `_MINUTES`.
    """

    _MINUTES = 10
    """For so long the fastest counts: clocks drift apart by 0.12 s meanwhile."""

    def __init__(self) -> None:
        self._fastest: dict[int, float] = {}
        """Of each of the last minutes: when it came less when it was stamped [s]."""
        self._stamp = self._late = math.nan

    def update(self, stamp: float, came: float) -> float:
        """Of a message with this stamp, by any clock, that came at `came` by ours [s].

        0 without a stamp, or with that of a simulator; one that is repeated says nothing new.
        """
        if stamp < SIMULATED:
            return 0.0
        if stamp != self._stamp:
            minute, way = int(came // 60.0), came - stamp
            self._fastest = {
                one: least for one, least in self._fastest.items() if one > minute - self._MINUTES
            }
            self._fastest[minute] = min(self._fastest.get(minute, way), way)
            self._stamp, self._late = stamp, way - min(self._fastest.values())
        return self._late


def seconds(stamp: Any) -> float:
    """Of a `builtin_interfaces/msg/Time`."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def estimated(ages: list[float], topic: str, most: float = MOST, allow: str = "") -> Clock:
    """The clock by which readings came so old, by this machine's wall clock [s].

    The one that was under way the shortest is taken to have come at once, if the clocks can not
    agree. Raises CohelmError where they differ by more than `most` [s]. allow: how the user allows
    more, for the error.
    """
    least = min(ages, default=0.0)
    if not math.isfinite(least) or -AHEAD <= least <= BEHIND:
        return Clock()
    if abs(least) <= most:
        return Clock(-least)
    if time.time() - least < SIMULATED:
        raise CohelmError(
            f"the stamps of {topic} are a simulator's or zero, and {TOPIC} does not carry its "
            "time: bridge it (ros_gz_bridge), or let the driver stamp with the wall clock "
            "(use_sim_time:=false)"
        )
    direction = "ahead of" if least < 0.0 else "behind"
    raise CohelmError(
        f"the stamps of {topic} are {abs(least):.1f} s {direction} this machine's clock, which is "
        f"more than {most:g} s: set both clocks (chrony, ntp){allow}"
    )


class SimulatedClock:
    """A simulator's clock, as it comes on /clock; and one of the robot's own that goes with it.

    That one only goes forward: it runs as fast as the simulator's, and as the wall's where that is
    silent, so that readings get old when a simulator stands still. When it is set back, as at a
    reset of the world, the robot's own goes on.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received_at = time.monotonic()
        self._own, self._time = 0.0, math.nan
        self._newest = 0.0
        self._recent = self._recent_wall = 0.1 * _LEARNS
        """Of late, so much of its seconds came in so many of the wall's."""

    @classmethod
    def on(cls, transport: Transport) -> SimulatedClock:
        """The simulator's clock on its topic."""
        made = cls()
        transport.subscribe(TOPIC, TYPE, SENSOR, made.on_message)
        return made

    @property
    def known(self) -> bool:
        """Whether a message has been received."""
        return not math.isnan(self._time)

    @property
    def rate(self) -> float:
        """Its seconds in one of the wall's, of late."""
        return self._recent / self._recent_wall

    def on_message(self, received: Received) -> None:
        """A message."""
        if received.message is not None:
            self.take(seconds(received.message.clock), received.stamp)

    def take(self, time_s: float, wall: float) -> None:
        """A simulated time [s], received when this machine's monotonic clock was at `wall` [s]."""
        with self._lock:
            passed, way = wall - self._received_at, time_s - self._time
            if passed <= 0.0:
                return
            own = self._own + self._passed(wall)
            if way >= 0.0:
                own = max(own, self._own + min(way, FASTEST * passed + SILENT))
                if passed < SILENT:  # not the mean of rates, which uneven arrivals make larger
                    kept = math.exp(-passed / _LEARNS)
                    self._recent = kept * self._recent + min(way, 2.0 * passed + SILENT)
                    self._recent_wall = kept * self._recent_wall + passed
            self._own, self._time, self._received_at = own, time_s, wall

    def now(self) -> float:
        """The robot's own [s]; never goes back."""
        with self._lock:
            self._newest = max(self._newest, self._own + self._passed(time.monotonic()))
            return self._newest

    def time(self) -> float:
        """The simulator's [s]; NaN: none was received yet."""
        with self._lock:
            return self._time + self.rate * min(self._since(time.monotonic()), SILENT)

    def age(self, stamp: float) -> float:
        """How long ago a stamp of the simulator's was [s]."""
        return self.time() - stamp

    def _since(self, wall: float) -> float:
        return max(wall - self._received_at, 0.0)

    def _passed(self, wall: float) -> float:
        """Of the robot's own since the last message."""
        since = self._since(wall)
        return min(self.rate, 1.0) * min(since, SILENT) + max(since - SILENT, 0.0)


Ticks = Clock | SimulatedClock
"""By which stamps become ages."""
