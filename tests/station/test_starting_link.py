"""The page before the robot is ready: requests are refused, not stored."""

from __future__ import annotations

import json

from cohelm.core.types import Stick
from cohelm.link.messages import Answer, Command, Device, RequestKind
from cohelm.link.station_end import LinkState
from cohelm.station import messages as page
from cohelm.station.operator import PageOperator
from cohelm.station.robot_link import RefusingLink, StartingLink

AHEAD = Command(Stick(1.0, 0.0), True, True, Device.KEYBOARD)


class Robot(RefusingLink):
    """Writes down what reaches it."""

    def __init__(self) -> None:
        super().__init__("no")
        self.reached: list[object] = []

    def steer(self, command: Command, until: float | None = None) -> None:
        self.reached.append(command)

    def ask(self, what: RequestKind, value: int = 0, made: float | None = None) -> int:
        self.reached.append(what)
        return 7

    def answer(self, number: int) -> Answer | None:
        return Answer(number, True, "")

    def propose(self, points: object, only_check: bool) -> int:
        self.reached.append(points)
        return 8

    def state(self) -> LinkState:
        return LinkState(True, "robot", "")


def awaited() -> tuple[PageOperator, list[Robot]]:
    there: list[Robot] = []
    starting = StartingLink(lambda: there[0] if there else None, lambda: "starting (3 s)")
    return PageOperator("key", "anna", starting, 0.25), there


def told(operator: PageOperator) -> list[dict[str, object]]:
    return [json.loads(text) for text in operator._outbox.take()]


def test_before_the_robot_is_ready_all_requests_are_refused_with_the_reason() -> None:
    operator, _ = awaited()
    assert operator.link.state()[:3] == (False, "the robot beside it", "starting (3 s)")
    operator._on_message(page.Do(what="take"))
    operator._on_message(page.Waypoints(points=[(1.0, 2.0)], only_check=False))
    operator._poll_link()
    checked, refused = sorted(told(operator), key=lambda message: str(message["type"]))
    assert (refused["type"], refused["why"]) == ("refused", "the robot is not started yet")
    assert (checked["type"], checked["ok"]) == ("checked", False)
    assert checked["why"] == "the robot is not started yet"
    operator._poll_link()
    assert told(operator) == []


def test_no_request_from_before_the_robot_was_ready_reaches_it() -> None:
    operator, there = awaited()
    operator.link.steer(AHEAD)
    operator._on_message(page.Do(what="take"))
    operator._on_message(page.Waypoints(points=[(1.0, 2.0)], only_check=False))
    there.append(Robot())
    operator._poll_link()
    assert operator.link is there[0]
    assert there[0].reached == []
    assert {message["type"] for message in told(operator)} == {"refused", "checked"}
    operator._on_message(page.Do(what="reset"))
    assert there[0].reached == [RequestKind.RESET]
