"""A link to a robot that still starts, so that the page is served before the robot is ready."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from cohelm.link.messages import Answer, Command, RequestKind
from cohelm.link.station_end import LinkState
from cohelm.station.robot_link import News, RefusingLink, RobotLink


class PendingLink(RefusingLink):
    """Connects as soon as the robot is ready.

    Requests made before are refused, not stored: a robot that has just started executes new
    requests only.
    """

    def __init__(self, made: Callable[[], RobotLink | None], starting: Callable[[], str]) -> None:
        """made: the link, or None while there is no robot yet. starting: what it is doing."""
        super().__init__("the robot is not started yet")
        self._made, self._starting = made, starting
        self._link: RobotLink | None = None
        self._closed = False

    def _robot(self) -> RobotLink | None:
        if self._link is None and not self._closed:
            self._link = self._made()
        return self._link

    def news(self) -> list[News]:
        """What has come since the last call."""
        link, refused = self._robot(), super().news()
        return refused if link is None else refused + link.news()

    def steer(self, command: Command) -> None:
        """Send the operator's command; without effect before there is a robot."""
        link = self._robot()
        if link is not None:
            link.steer(command)

    def ask(self, what: RequestKind, value: int = 0, made: float | None = None) -> int:
        """Make a request."""
        return (self._robot() or super()).ask(what, value, made)

    def answer(self, number: int) -> Answer | None:
        """The answer to a request; None: none yet."""
        link = self._link if number >= 0 else None
        return (link or super()).answer(number)

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Waypoints."""
        return (self._robot() or super()).propose(points, only_check)

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """A record, or the list of them."""
        link = self._robot()
        if link is not None:
            link.fetch(name, offset, size)

    def state(self) -> LinkState:
        """State of the link; not connected, and why, until there is a robot."""
        link = self._robot()
        if link is not None:
            return link.state()
        return LinkState(False, "the robot beside it", self._starting())

    def close(self) -> None:
        """Leave."""
        self._closed = True
        if self._link is not None:
            self._link.close()
