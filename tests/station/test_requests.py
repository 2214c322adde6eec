"""What a page requests is answered, whatever else is on its way; and what it allows holds."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from cohelm.link.bulk_messages import MOST_WAYPOINTS
from cohelm.station import operator as of_operator
from cohelm.station.messages import Do, Request, Waypoints
from cohelm.station.operator import PageOperator
from cohelm.station.robot_link import RefusingLink
from cohelm.station.serve import Server
from tests.link.ends import until
from tests.station.bare import Bare
from tests.station.servers import served
from tests.station.visitor import opened


@pytest.fixture
def server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


def do(page: ClientConnection, what: str) -> None:
    page.send(json.dumps({"type": "do", "what": what, "value": 0}))


def take(page: ClientConnection, bare: Bare) -> None:
    """Become the driver of a robot that nobody drives."""
    until(lambda: bare.end.driver, turn=lambda: (do(page, "take"), time.sleep(0.3)))


def heard(page: ClientConnection, kind: str, within: float = 30.0) -> Iterator[dict[str, object]]:
    """Messages of a kind, as they come."""
    end = time.monotonic() + within
    while time.monotonic() < end:
        text = page.recv(timeout=within)
        if isinstance(text, str) and (message := json.loads(text))["type"] == kind:
            yield message


def test_refusals_that_come_together_all_reach_the_page() -> None:
    operator = PageOperator("key", "anna", RefusingLink("not now"), 0.25)
    asked: tuple[Request, ...] = ("reset", "hold", "dock")
    for what in asked:
        operator._requested[operator.link.ask(*Do(what=what).request())] = what
    for only_check in (False, True):
        number = operator.link.propose([(0.0, 0.0)], only_check)
        operator._proposed[number] = only_check, time.monotonic()
    operator._poll_link()
    told = [json.loads(text) for text in operator._outbox.take()]
    assert [one["what"] for one in told if one["type"] == "refused"] == list(asked)
    assert [one["only_check"] for one in told if one["type"] == "checked"] == [False, True]


def test_a_route_that_the_robot_does_not_answer_is_said_to_be_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was on its way when the connection broke."""
    link = SimpleNamespace(propose=lambda *_: 1, news=list)
    operator = PageOperator("key", "anna", link, 0.25)  # type: ignore[arg-type]
    operator._on_message(Waypoints(points=[(0.0, 0.0)], only_check=False))
    operator._poll_link()
    assert operator._outbox.take() == []
    monkeypatch.setattr(of_operator, "ROUTE_WITHIN", 0.0)
    operator._poll_link()
    operator._poll_link()
    [told] = [json.loads(text) for text in operator._outbox.take()]
    assert (told["type"], told["ok"], told["only_check"]) == ("checked", False, False)
    assert told["why"] == "the robot did not answer: send it again"


def test_a_request_for_control_that_waits_for_the_driver_is_not_told_as_refused(
    server: Server, bare: Bare
) -> None:
    with opened(server) as one, opened(server) as two:
        take(one, bare)
        until(lambda: bare.end._held.requester, turn=lambda: (do(two, "take"), time.sleep(0.3)))
        told = []
        shown = lambda: any(one["type"] == "who" and one["you_request"] for one in told)  # noqa: E731
        end = time.monotonic() + 1.0
        while time.monotonic() < end or (not shown() and time.monotonic() < end + 30.0):
            text = two.recv(timeout=30.0)
            if isinstance(text, str):
                told.append(json.loads(text))
        assert shown()
        assert not [one for one in told if one["type"] == "refused"]
        until(
            lambda: not bare.end._held.requester,
            turn=lambda: (do(one, "refuse"), time.sleep(0.3)),
        )
        assert next(one for one in heard(two, "who") if not one["you_request"])
        do(two, "reset")
        assert next(heard(two, "refused"))["why"] == "you are not the driver"


def test_a_page_that_leaves_does_not_raise_the_speed(server: Server, bare: Bare) -> None:
    """In automatic mode the station speaks for it until it is back."""
    with opened(server) as page:
        take(page, bare)
        command = {
            "stick": [0, 0], "valid": True, "armed": True, "device": "keyboard", "speed_scale": 0.2,
        }  # fmt: skip
        for n, beat in zip(range(100), heard(page, "beat"), strict=False):
            page.send(
                json.dumps({"type": "steer", "n": n, "echo_ms": beat["at_ms"], "command": command})
            )
            now = bare.end.receive().command
            if now is not None and now.valid:
                break
    until(lambda: (now := bare.end.receive().command) and not now.valid, within=2.0)
    command = bare.end.receive().command
    assert command is not None
    assert command.speed_scale == pytest.approx(0.2)


def test_a_robot_with_several_fast_lidars_does_not_flood_its_page(server: Server) -> None:
    """Each scan that was shown is acknowledged, beside a stick and states."""
    scan, steer = (
        json.dumps({"type": "got", "stream": "scan"}, separators=(",", ":")),
        json.dumps({"type": "do", "what": "acknowledge", "value": 7}),
    )
    with opened(server) as page:
        for k in range(900):
            page.send(scan)
            if k % 9 == 0:
                page.send(steer)
                time.sleep(0.01)
        now = 1e3 * time.monotonic()
        assert any(beat["at_ms"] > now for beat in heard(page, "beat"))
        with pytest.raises(ConnectionClosed):
            flood(page, steer)  # what no page sends


def flood(page: ClientConnection, text: str) -> None:
    while True:
        page.send(text)


@pytest.mark.parametrize("count", [201, MOST_WAYPOINTS])
def test_a_long_route_does_not_end_the_connection(server: Server, count: int) -> None:
    with opened(server) as page:
        points = [[0.1 * i, 0.0] for i in range(count)]
        page.send(json.dumps({"type": "waypoints", "points": points, "only_check": True}))
        for n, _ in enumerate(heard(page, "beat")):
            if n == 10:
                return
    raise AssertionError("the connection has ended")
