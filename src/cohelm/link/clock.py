"""Estimates the other end's clock offset and the path's delay, from stamped messages (NTP).

Every message carries its sender's stamp, and an echo: the newest stamp the sender has had from
here, and for how long it has held it. That is NTP's exchange (RFC 5905 8). Each gives the round
trip, and an interval in which the clocks' offset must lie, however unequal the two ways are:

    round trip = now - echo - hold
    offset     = (stamp - now) + round trip / 2,  +- round trip / 2

The estimate is the narrowest interval so far, each widened by what clocks can drift apart in the
time since. Delay makes intervals wide, never wrong; one that does not meet the estimate's therefore
proves that a clock has jumped (a computer that slept), and the estimate begins anew. How old a
stamp from before the jump is can not be told any more: its clock stood still meanwhile.

The middle of the interval is right where both ways are equally slow. Where only one is, a command
may be twice as old as the middle says. What decides whether a command is still used is therefore
the interval's upper end, `max_age`: no way back takes less than no time, so

    offset <= (stamp - hold) - echo      and      age <= now - stamp + that bound

and the least of these bounds, each widened by drift, is wrong by the shortest way to the other end.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from cohelm.link.wire import Header

DRIFT = 200e-6
"""Two clocks run apart by less than this, in seconds per second."""
_LOST_OVER = 3.0  # [s], for the share of datagrams lost
_EPS = 1e-4  # [s], for what single precision loses of `hold`


class _Sample(NamedTuple):
    when: float
    round_trip: float
    offset: float


class _Bound(NamedTuple):
    when: float
    offset: float

    def at(self, now: float, sense: float) -> float:
        """The bound `now`, widened by drift; sense: 1 for an upper one, -1 for a lower one."""
        return self.offset + sense * DRIFT * (now - self.when)


class Path:
    """The path to one other end, and its clock. All times in seconds of this end's clock."""

    def __init__(self) -> None:
        self._best: _Sample | None = None
        self._least: _Bound | None = None
        self._most: _Bound | None = None
        self._arrivals: deque[tuple[float, int]] = deque()
        self._newest: Header | None = None
        self._newest_at = math.nan
        self._jumped = -math.inf
        """The other end's clock when a jump was noticed [s]."""
        self.round_trip = math.nan
        """Of the newest message that had an echo [s]."""

    def update(self, header: Header, now: float) -> bool:
        """Process a message's header. False: it is out of order or a duplicate."""
        before = self._newest
        if before is not None and before.session != header.session:
            self.__init__()  # another process, with a clock of its own
            before = None
        self._arrivals.append((now, header.sequence))
        while now - self._arrivals[0][0] > _LOST_OVER:
            self._arrivals.popleft()
        if before is not None and header.sequence <= before.sequence:
            return False
        self._newest, self._newest_at = header, now
        self._sample(header, now)
        return True

    def echo(self, now: float) -> tuple[float, float]:
        """`echo` and `hold` for the next message to the other end."""
        if self._newest is None:
            return math.nan, math.nan
        return self._newest.stamp, now - self._newest_at

    def age(self, stamp: float, now: float) -> float:
        """How long ago, by this end's clock, the other end's clock showed `stamp`; NaN: unknown.

        Wrong by half of `shortest` at most, and `DRIFT` times the time since.
        """
        return now - (stamp - self.offset)

    def max_age(self, stamp: float, now: float) -> float:
        """The most that `age` can be, however unequal the two ways are [s]; NaN: unknown; infinite
        for a stamp from before a clock jumped.

        More than the true age by the shortest way to the other end, `DRIFT` times the time since,
        and 0.1 ms.
        """
        if self._most is None:
            return math.nan
        if stamp < self._jumped:
            return math.inf
        return now - stamp + self._most.at(now, 1.0) + _EPS

    @property
    def offset(self) -> float:
        """The other end's clock less this end's [s]; NaN: not known yet."""
        return self._best.offset if self._best else math.nan

    @property
    def shortest(self) -> float:
        """The round trip that the offset is from: about the shortest there was [s]; or NaN."""
        return self._best.round_trip if self._best else math.nan

    @property
    def lost(self) -> float:
        """Share of the other end's messages lost in the last seconds; NaN: none were sent."""
        numbers = {number for _, number in self._arrivals}
        if not numbers:
            return math.nan
        return 1.0 - len(numbers) / (max(numbers) - min(numbers) + 1)

    def silence(self, now: float) -> float:
        """Time since the newest message [s]; NaN: there was none."""
        return now - self._newest_at

    def _sample(self, header: Header, now: float) -> None:
        round_trip = now - header.echo - header.hold
        # An echo is from the past; what says otherwise measures nothing (and NaN is no echo).
        if not (-_EPS <= round_trip <= now and header.hold >= 0.0):
            return
        self.round_trip = round_trip = max(round_trip, 0.0)
        sample = _Sample(now, round_trip, header.stamp - now + 0.5 * round_trip)
        best = self._best
        if best is None:
            self._best = sample
            self._update_bounds(sample, restart=True)
            return
        drifted = DRIFT * (now - best.when)
        width = 0.5 * (sample.round_trip + best.round_trip) + drifted + 2.0 * _EPS
        jumped = abs(sample.offset - best.offset) > width
        self._update_bounds(sample, restart=jumped)
        if jumped:
            self._jumped = header.stamp
        if jumped or 0.5 * round_trip <= 0.5 * best.round_trip + drifted:
            self._best = sample

    def _update_bounds(self, sample: _Sample, restart: bool) -> None:
        """Narrow the offset's bounds by a sample's; restart: drop the earlier bounds."""
        now, half = sample.when, 0.5 * sample.round_trip
        least, most = sample.offset - half, sample.offset + half
        if not restart and self._least is not None and self._most is not None:
            before = self._least.at(now, -1.0), self._most.at(now, 1.0)
            if max(least, before[0]) <= min(most, before[1]) + 2.0 * _EPS:
                least, most = max(least, before[0]), min(most, before[1])
            # else nothing can be right for both: a jump too small for the middle to show it
        self._least, self._most = _Bound(now, least), _Bound(now, most)
