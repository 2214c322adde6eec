import json
import math
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from pydantic import ValidationError

from cohelm.core.types import Pose, Stick
from cohelm.link.bulk_messages import LineKind, Polyline
from cohelm.link.messages import (
    MOST_ALARMS,
    Alarm,
    Command,
    Device,
    Localised,
    Mode,
    RequestKind,
    Severity,
    Status,
)
from cohelm.link.wire import Header, encode, from_robot
from cohelm.station import typescript, view
from cohelm.station.messages import Do, Request, Steer, from_page
from tests.link.ends import STATUS

HEADER = Header(1, 1, 0.0, math.nan, 0.0)
WEB = Path(__file__).parents[2] / "src" / "cohelm" / "station" / "web" / "src"


def test_the_pages_types_are_those_of_the_server() -> None:
    made = (WEB / "messages.ts").read_text(encoding="utf-8")
    assert made == typescript.text(), "run: python -m cohelm.station.typescript > .../messages.ts"


@pytest.mark.parametrize(
    "text",
    [
        "", "[]", "null", "{}", '{"type":"steer"}',
        '{"type":"dance"}', '{"type":"do","what":"fly"}',
        '{"type":"do","what":"give","value":-1}', '{"type":"do","what":"give","value":1.5}',
        '{"type":"waypoints","points":[],"only_check":true}',
        '{"type":"waypoints","points":[[NaN,0]],"only_check":true}',
        '{"type":"waypoints","points":[[1e9,0]],"only_check":true}',
        '{"type":"got","stream":"map"}', '{"type":"play","playing":true,"speed":0}',
    ],
)  # fmt: skip
def test_malformed_messages_are_refused(text: str) -> None:
    with pytest.raises(ValidationError):
        from_page(text)


STEER = (
    '{"type":"steer","n":1,"echo_ms":0.0,"command":{"stick":[1.0,-1.0],"valid":true,"armed":true,'
    '"device":"touch","speed_scale":0.5}}'
)


def test_a_pages_command_is_the_links() -> None:
    message = from_page(STEER)
    assert isinstance(message, Steer)
    assert message.command == Command(Stick(1.0, -1.0), True, True, Device.TOUCH, 0.5)


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        *[("[1.0,", f"[{x},") for x in ("1.001", "-2", "NaN", "Infinity", "1e400", '"1"', "null")],
        ("[1.0,-1.0]", "[1.0]"), ("[1.0,-1.0]", "[1.0,-1.0,0.0]"), ("0.5", "1.5"),
        ('"valid":true', '"valid":1'), ('"valid":true,', ""), ('"valid"', '"requests":[],"valid"'),
        ('"touch"', '"hand"'), ('"touch"', "null"),
    ],
)  # fmt: skip
def test_a_command_that_the_link_does_not_have_is_refused(good: str, bad: str) -> None:
    assert good in STEER
    with pytest.raises(ValidationError):
        from_page(STEER.replace(good, bad))


def test_who_pressed_stop_is_named_as_the_page_calls_it_and_you_to_the_one_who_did() -> None:
    names, lease = {2: "operator 1", 3: "operator 2"}, STATUS.lease
    for number, by in ((2, "you"), (3, "operator 2"), (4, "desk (4)")):
        said = f"reset first: stop by desk ({number})"
        alarm = Alarm(1, Severity.ALARM, True, False, said)
        status = STATUS._replace(
            lease=lease._replace(you=2), stopped=said, why=said, alarms=(alarm,)
        )  # fmt: skip
        shown = view.named(status, names)
        told = {shown.stopped, shown.why, shown.alarms[0].text}
        assert told == {f"reset first: stop by {by}"}
        assert view.persons(f"desk ({number}) pressed stop", 2, names) == f"{by} pressed stop"
    replayed = STATUS._replace(lease=lease._replace(you=0, driver=0), stopped="stop by desk (2)")
    assert view.named(replayed, {}).stopped == "stop by desk (2)"


def test_a_stop_by_a_driver_that_is_back_says_that_it_was_lost() -> None:
    """Beside *You drive*, a driver that is lost is another one."""
    said = "the driver is lost: silent for 0.6 s"
    there = Alarm(1, Severity.ALARM, True, False, said)
    for alarms, tense in (((there,), "is"), ((there._replace(active=False),), "was"), ((), "was")):
        shown = view.named(STATUS._replace(stopped=said, why=said, alarms=alarms), {})
        assert {shown.stopped, shown.why} == {said.replace("is", tense, 1)}
    pausing = STATUS._replace(stopped="", why="the stick is lost: no valid stick input", alarms=())
    assert view.named(pausing, {}).why == pausing.why  # it is a pause, and not over


def test_a_driver_whose_page_is_closed_is_said_to_be_so() -> None:
    """For who opens the page anew, and is told that another drives: it was that same person."""
    lease = STATUS.lease._replace(you=3, driver=2, driver_name="desk", requester=4)
    names = {2: "operator 1", 3: "operator 2"}
    assert view.who(lease, names, ["operator 1", "operator 2"]).driver == "operator 1"
    assert view.who(lease, names, ["operator 2"]).driver == "operator 1 (page closed)"
    assert view.who(lease, {3: "operator 2"}, ["operator 2"]).driver == "desk (2)"


def test_a_driver_that_the_robot_does_not_hear_is_said_to_be_lost_but_not_to_itself() -> None:
    lease = STATUS.lease._replace(you=3, driver=2, driver_name="desk")
    assert not view.who(lease, {}, []).driver_lost
    assert not view.who(lease._replace(requester=4, left=3.0), {}, []).driver_lost
    assert view.who(lease._replace(left=0.0), {}, []).driver_lost
    assert not view.who(lease._replace(left=0.0, you=2), {}, []).driver_lost
    assert not view.who(lease._replace(left=0.0, driver=0), {}, []).driver_lost


LONG = "what an alarm says may take more than the sixty-four bytes of a status, " * 3


def alarm(number: int, text: str = LONG) -> Alarm:
    return Alarm(number, Severity.ALARM, True, False, text)


def received(status: Status) -> Status:
    """As it comes over the link."""
    message = from_robot(encode(HEADER, status))[1]
    assert isinstance(message, Status)
    return message


def test_alarms_are_shown_whole_and_all() -> None:
    every = tuple(alarm(number, f"{number}: {LONG}") for number in range(9, 0, -1))
    status = received(STATUS._replace(alarms=every))
    assert len(status.alarms) == MOST_ALARMS
    assert all(len(one.text.encode()) <= 64 for one in status.alarms)
    assert view.whole(status, every).alarms == every


def test_why_it_is_stopped_is_shown_whole() -> None:
    reason = f"the robot reports: {LONG}"
    status = received(STATUS._replace(stopped=reason, why=reason, alarms=(alarm(1, reason),)))
    assert status.stopped != reason
    shown = view.whole(status, (alarm(2), alarm(1, reason)))
    assert (shown.stopped, shown.why) == (reason, reason)
    shown = view.whole(status, (alarm(2),))  # what is told of all alarms comes after it
    assert (shown.stopped, shown.why) == (status.stopped, status.why)
    brief = received(STATUS._replace(stopped="stop"))
    assert view.whole(brief, (alarm(1, "stop by desk"),)).stopped == "stop"


def test_of_two_tidings_of_an_alarm_the_newer_is_shown() -> None:
    """The status is: what is told of all alarms may have waited behind a picture."""
    before = (alarm(3), alarm(2, "lost: no scan"), alarm(1, LONG))
    status = received(STATUS._replace(alarms=(alarm(2, "lost"), alarm(3, f"now {LONG}"))))
    assert view.whole(status, before).alarms == status.alarms
    assert view.whole(status, ()).alarms == status.alarms


def test_what_is_not_known_is_null_for_the_page() -> None:
    status = STATUS._replace(
        localised=Localised.GOOD, sigma=0.02, speed_cap=math.inf, pose=Pose(1.0, 2.0, 0.5),
        reference=Pose(1.0, math.nan, 0.0), ahead=((0.0, 0.0), (math.nan, 1.0), (2.0, 0.0)),
    )  # fmt: skip
    said = json.loads(view.shown(status, stamp=1.0, age=0.01))
    assert (said["type"], said["stamp"], said["age"]) == ("Status", 1.0, 0.01)
    assert (said["localised"], said["sigma"], said["speed_cap"]) == ("good", 0.02, None)
    assert (said["pose"], said["reference"]) == ([1.0, 2.0, 0.5], None)
    assert said["ahead"] == [[0.0, 0.0], [2.0, 0.0]]
    assert set(said) == {"type", "stamp", "age", *status._fields}


def test_a_long_line_is_thinned_out_between_its_ends() -> None:
    points = np.array([[i, math.nan if i == 7 else 0.0] for i in range(5001)], np.float32)
    said = json.loads(view.shown(Polyline(LineKind.DETOUR, points)))
    assert (said["what"], len(said["points"])) == ("detour", view.MOST_POINTS)
    assert (said["points"][0], said["points"][-1]) == ([0.0, 0.0], [5000.0, 0.0])


@pytest.mark.parametrize(
    ("what", "wanted"),
    [
        ("stop", (RequestKind.STOP, 3)), ("give", (RequestKind.GIVE, 3)),
        ("manual", (RequestKind.MODE, Mode.MANUAL)), ("hold", (RequestKind.MODE, Mode.HOLD)),
        ("record", (RequestKind.RECORD, 1)), ("record_stop", (RequestKind.RECORD, 0)),
    ],
)  # fmt: skip
def test_a_pages_request_becomes_the_robots(what: str, wanted: tuple[RequestKind, int]) -> None:
    assert Do(what=what, value=3).request() == wanted  # type: ignore[arg-type]


def test_every_request_of_a_page_is_one_of_the_robots() -> None:
    for what in get_args(Request):
        assert Do(what=what).request()[0] in RequestKind
