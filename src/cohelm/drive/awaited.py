"""A link to a robot that still starts, so that the page is served before the robot is ready."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from cohelm.link.bulk_messages import Checked
from cohelm.link.messages import Answer, Command, RequestKind
from cohelm.station.robot_link import News, Quality, RobotLink

_NOT_YET = "the robot is not started yet"


class PendingLink:
    """`RobotLink` that connects as soon as the robot is ready.

    Requests made before are refused, not stored: a robot that has just started executes new
    requests only.
    """

    def __init__(self, made: Callable[[], RobotLink | None], starting: Callable[[], str]) -> None:
        """made: the link, or None while there is no robot yet. starting: what it is doing."""
        self._made, self._starting = made, starting
        self._link: RobotLink | None = None
        self._closed = False
        self._number = 0
        self._refused: list[News] = []

    def _robot(self) -> RobotLink | None:
        if self._link is None and not self._closed:
            self._link = self._made()
        return self._link

    def news(self) -> list[News]:
        """What has come since the last call."""
        out, self._refused = self._refused, []
        link = self._robot()
        return out if link is None else out + link.news()

    def steer(self, command: Command) -> None:
        """Send the operator's command; without effect before there is a robot."""
        link = self._robot()
        if link is not None:
            link.steer(command)

    def ask(self, what: RequestKind, value: int = 0, made: float | None = None) -> int:
        """Make a request."""
        link = self._robot()
        return self._refusal() if link is None else link.ask(what, value, made)

    def answer(self, number: int) -> Answer | None:
        """The answer to a request; None: none yet."""
        if number < 0 or self._link is None:
            return Answer(number, False, _NOT_YET)
        return self._link.answer(number)

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Waypoints."""
        link = self._robot()
        if link is not None:
            return link.propose(points, only_check)
        answer = Answer(self._refusal(), False, _NOT_YET)
        self._refused.append(News(Checked(answer, 65535), math.nan, math.nan))
        return answer.number

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """A record, or the list of them."""
        link = self._robot()
        if link is not None:
            link.fetch(name, offset, size)

    def quality(self) -> Quality:
        """How good the link is; not connected, and why, until there is a robot."""
        link = self._robot()
        if link is not None:
            return link.quality()
        return Quality(False, "the robot beside it", self._starting(), math.nan, math.nan, math.nan)

    def close(self) -> None:
        """Leave."""
        self._closed = True
        if self._link is not None:
            self._link.close()

    def _refusal(self) -> int:
        """The number of something that is refused: below 0, as none of a robot's is."""
        self._number -= 1
        return self._number
