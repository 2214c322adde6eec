"""The station's port to a robot, and the one over the network; playback of a record is another."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from cohelm.link.bulk_messages import Checked, Fetch, FromRobot, Waypoints
from cohelm.link.keys import Keys
from cohelm.link.messages import Answer, Command, RequestKind
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import LinkState, StampedMessage, StationEnd

News = StampedMessage[FromRobot]
"""A message from the robot."""


class RobotLink(Protocol):
    """One operator's link to the robot. Calls return at once.

    A subclass need not take commands, nor have records.
    """

    def news(self) -> list[News]:
        """New messages since the last call; of replaceable ones the newest."""
        ...

    def steer(self, command: Command, until: float | None = None) -> None:
        """Send the operator's command; the newest wins. To be called at 50 Hz.

        until: when it is lost if no other comes, by the monotonic clock [s]; None: soon.
        """

    def ask(self, what: RequestKind, value: int = 0, made: float | None = None) -> int:
        """Make a request; returns the number of its answer.

        made: when the person did, by the monotonic clock; None: now [s].
        """
        ...

    def answer(self, number: int) -> Answer | None:
        """The answer to a request; None: none yet."""
        ...

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Waypoints to check, and unless `only_check` to follow; `Checked` has its number."""
        ...

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """Have `size` bytes of a record sent in pieces; 0: its size and hash. An empty name asks
        for the list."""

    def state(self) -> LinkState:
        """State of the link."""
        ...

    def close(self) -> None:
        """Close the link."""


class Linked:
    """`RobotLink` over the network. The robot's clock is known after its first message."""

    def __init__(
        self, keys: Keys, host: str, port: int, over: Callable[[], str] = lambda: ""
    ) -> None:  # fmt: skip
        """over: returns why the robot has ended, where that is known; else empty."""
        self._over = over
        self._end = StationEnd(keys, host, port)
        self.steer, self.ask, self.answer = self._end.steer, self._end.ask, self._end.answer
        self._bulk = StationBulk(keys, host, port, self._end.session)
        self._proposals = 0

    def news(self) -> list[News]:
        """New messages since the last call."""
        new: list[News] = [*self._end.news()]
        picture = self._bulk.picture()
        if picture is not None:
            new.append(News(picture, picture.taken, self._end.age(picture.taken)))
        return new + [News(message, math.nan, math.nan) for message in self._bulk.news()]

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Waypoints."""
        self._proposals += 1
        way = np.array(points, dtype=np.float64).reshape(-1, 2)
        self._bulk.send(Waypoints(self._proposals, way, only_check))
        return self._proposals

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """Part of a record, its hash, or the list of them."""
        self._bulk.send(Fetch(name, offset, size))

    def state(self) -> LinkState:
        """State of the link."""
        state, over = self._end.state(), self._over()
        return state._replace(connected=False, why=over) if over else state

    def close(self) -> None:
        """Close the link."""
        self._end.close()
        self._bulk.close()


class RefusingLink(RobotLink):
    """A link that refuses every request, with a reason."""

    def __init__(self, reason: str) -> None:
        self._reason = reason
        self._number = 0
        self._refused: list[News] = []

    def ask(self, what: RequestKind, value: int = 0, made: float | None = None) -> int:
        """A number below 0, as none of a robot's is."""
        self._number -= 1
        return self._number

    def answer(self, number: int) -> Answer | None:
        """Always the same."""
        return Answer(number, False, self._reason)

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Refused in the next news."""
        self._number -= 1
        answer = Answer(self._number, False, self._reason)
        self._refused.append(News(Checked(answer, 65535), math.nan, math.nan))
        return self._number

    def news(self) -> list[News]:
        """The refused proposals since the last call."""
        refused, self._refused = self._refused, []
        return refused


class StartingLink(RefusingLink):
    """In place of the link to a robot that still starts, so that the page is served before.

    What was requested before is refused, not stored: a robot that has just started executes new
    requests only.
    """

    def __init__(self, ready: Callable[[], RobotLink | None], starting: Callable[[], str]) -> None:
        """ready: the link, or None while there is no robot yet. starting: what it is doing."""
        super().__init__("the robot is not started yet")
        self.ready, self._starting = ready, starting

    def state(self) -> LinkState:
        """Not connected, and why."""
        return LinkState(False, "the robot beside it", self._starting())


class PlaybackPosition(NamedTuple):
    """Playback position of a replay."""

    at: float
    """Since the start [s]."""
    playing: bool
    speed: float


@runtime_checkable
class ReplayLink(Protocol):
    """What playback of a record offers in addition."""

    @property
    def duration(self) -> float:
        """[s]"""
        ...

    @property
    def place(self) -> PlaybackPosition:
        """The present playback position."""
        ...

    def play(self, playing: bool | None, speed: float | None, at: float | None) -> None:
        """Run or not, how fast, and from where; None: unchanged."""
        ...


Connect = Callable[[str], RobotLink]
"""Makes the link of an operator with this name."""
