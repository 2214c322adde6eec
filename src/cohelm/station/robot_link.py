"""What the station needs of the way to a robot. A record that is replayed offers the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from cohelm.core.types import Stick
from cohelm.link.bulk_messages import FromRobot
from cohelm.link.messages import Answer, Ask, Device
from cohelm.link.scans import WholeScan


class News(NamedTuple):
    """Something the robot told."""

    message: FromRobot | WholeScan
    stamp: float
    """The robot's clock then [s]."""
    age: float
    """How long ago that was [s]; NaN: not known."""


class Quality(NamedTuple):
    """How good the way is; NaN for what is not known."""

    connected: bool
    name: str
    """What the robot is reached by."""
    why: str
    """Why it is not connected; empty while it is."""
    round_trip: float
    """[s]"""
    loss: float
    """Share of the robot's datagrams that never came."""
    offset: float
    """The robot's clock less ours [s]."""


class RobotLink(Protocol):
    """One operator's own way to the robot. Calls return at once."""

    def news(self) -> list[News]:
        """What has come since the last call; of what only the newest counts, the newest."""
        ...

    def steer(
        self, stick: Stick, valid: bool, armed: bool, device: Device, speed_scale: float
    ) -> None:
        """What the person wants now; the newest wins. To be called at 50 Hz."""
        ...

    def ask(self, what: Ask, value: int = 0, made: float | None = None) -> int:
        """Ask for something once; returns the number of its answer.

        made: when the person did, by the monotonic clock; None: now [s].
        """
        ...

    def answer(self, number: int) -> Answer | None:
        """What became of what was asked; None: nothing yet."""
        ...

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Way-points to check, and unless `only_check` to follow; `Checked` has its number."""
        ...

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """Have `size` bytes of a record sent in pieces; 0: its size and hash. An empty name asks
        for the list."""
        ...

    def quality(self) -> Quality:
        """How good the link is."""
        ...

    def close(self) -> None:
        """Leave."""
        ...


class PlaybackPosition(NamedTuple):
    """Where a replay is."""

    at: float
    """Since the beginning [s]."""
    playing: bool
    speed: float


@runtime_checkable
class ReplayLink(Protocol):
    """What a link to a record can do besides."""

    @property
    def duration(self) -> float:
        """[s]"""
        ...

    @property
    def start(self) -> float:
        """The robot's clock at the beginning [s]."""
        ...

    @property
    def place(self) -> PlaybackPosition:
        """Where it is now."""
        ...

    def play(self, playing: bool | None, speed: float | None, at: float | None) -> None:
        """Go on or not, how fast, and from where; None: as it is."""
        ...


Connect = Callable[[str], RobotLink]
"""Makes the link of one operator, who goes by this name."""
