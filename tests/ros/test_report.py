"""What `cohelm filter` tells: diagnostics, its reason, markers, and a line in the log."""

from types import SimpleNamespace

import numpy as np
import pytest

from cohelm.core.types import Twist
from cohelm.law.verdict import Verdict
from cohelm.ros import messages, report
from cohelm.ros.mismatch import TWIST
from cohelm.ros.report import Report, Row
from cohelm.ros.topics import Topics
from cohelm.ros.types import packed, unpacked
from tests.ros.test_unheard import ENDS, FRAMES, Pretended, readings, seen

NAMES = {
    "diagnostics": ("/j100_0001/diagnostics", messages.DIAGNOSTICS),
    "reason": ("/j100_0001/cohelm_filter/reason", messages.STRING),
    "markers": ("/j100_0001/cohelm_filter/markers", messages.MARKERS),
}


class Told(Pretended):
    """What is published, as its bytes are read again."""

    def __init__(self) -> None:
        super().__init__(ENDS, FRAMES + readings())
        self.came: dict[tuple[str, str], list] = {}

    def publish(self, topic, kind, qos):
        came = self.came.setdefault((topic, kind), [])
        return SimpleNamespace(send=lambda made: came.append(unpacked(packed(made, kind), kind)[0]))

    def last(self, name: str):
        return self.came[NAMES[name]][-1]


@pytest.fixture
def told(monkeypatch):
    """The report of a robot in a namespace, the transport, the log and the time."""
    now, log, transport = [100.0], list[str](), Told()
    monkeypatch.setattr(report, "time", SimpleNamespace(monotonic=lambda: now[0]))
    found = seen(ENDS, FRAMES + readings())._replace(topics=Topics.named("/j100_0001"))
    return Report(transport, found, log.append), transport, log, now


def row(kind: str = "", reason: str = "", **fields) -> Row:
    made = Row(
        kind, reason, Twist(0.5, 0.1), Twist(0.4, 0.1), Twist(0.3, 0.1), Verdict.SHAPED, 0.1, 0.25,
        False, None, 0.011, 0.062, 0.0012,
    )  # fmt: skip
    return made._replace(**fields)


def test_commands_that_pass_are_ok_and_the_outline_is_drawn_green(told):
    one, transport, _, _ = told
    one.take(row())
    (status,) = transport.last("diagnostics").status
    values = {pair.key: pair.value for pair in status.values}
    assert (status.level, status.name, status.hardware_id) == (
        messages.OK,
        "cohelm_filter",
        "sally",
    )
    assert status.message == "commands pass"
    assert values["verdict"] == "SHAPED"
    assert [values[f"{stage}_v"] for stage in ("nominal", "safe", "applied")] == [
        "0.5",
        "0.4",
        "0.3",
    ]
    assert float(values["took_s"]) == pytest.approx(0.0012)
    assert float(values["scan_age_s"]) == pytest.approx(0.062)
    assert values["base_type"] == TWIST
    outline, limiting = transport.last("markers").markers
    drawn = np.array([(point.x, point.y) for point in outline.points])
    assert drawn == pytest.approx(np.vstack((one.outline, one.outline[:1])))
    assert outline.header.frame_id == "base_link"
    assert outline.color.g > outline.color.r
    assert limiting.action == limiting.DELETE
    assert transport.last("reason").data == ""


def test_a_reason_is_told_once_in_its_own_words_and_a_passing_one_stays_for_a_second(told):
    one, transport, log, now = told
    one.take(row("shaped", "limited by an obstacle 0.25 m off", limiting=(1.0, -0.5)))
    (status,) = transport.last("diagnostics").status
    assert (status.level, status.message) == (messages.WARN, "limited by an obstacle 0.25 m off")
    outline, limiting = transport.last("markers").markers
    assert limiting.action == limiting.ADD
    assert (limiting.pose.position.x, limiting.pose.position.y) == (1.0, -0.5)
    assert limiting.header.frame_id == "odom"
    assert outline.color.r > outline.color.b
    for k in range(20):
        now[0] += 0.02
        one.take(row("shaped", f"limited by an obstacle 0.{24 - k:02d} m off"))
    now[0] += 0.5
    one.take(row())
    assert transport.last("reason").data == "limited by an obstacle 0.25 m off"
    now[0] += 0.6
    one.take(row())
    assert transport.last("reason").data == ""
    assert log == ["limited by an obstacle 0.25 m off", "commands pass unchanged"]


def test_another_cause_of_the_same_kind_is_told_once_the_first_has_been_away_for_a_second(told):
    one, _, log, now = told
    unseen, wall = "slowed: ground never seen", "limited by an obstacle 0.25 m off"
    one.take(row("shaped", unseen))
    for _ in range(45):
        now[0] += 0.02
        one.take(row("shaped", wall))
    assert log == [unseen]
    for _ in range(45):
        now[0] += 0.02
        one.take(row("shaped", wall))
    assert log == [unseen, wall]


def test_a_fault_is_an_error_at_once_and_what_latched_says_so(told):
    one, transport, log, _ = told
    one.take(row("shaped", "limited by an obstacle 0.25 m off"))
    one.take(row("gate", "the robot reports: /emergency_stop is on", latched=True))
    (status,) = transport.last("diagnostics").status
    assert status.level == messages.ERROR
    assert {pair.key: pair.value for pair in status.values}["latched"] == "True"
    assert transport.last("reason").data == log[-1] == "the robot reports: /emergency_stop is on"


def test_while_nothing_changes_it_tells_its_state_twice_a_second(told):
    one, transport, _, now = told
    for _ in range(100):
        one.take(row())
        now[0] += 0.02
    assert len(transport.came[NAMES["diagnostics"]]) == 4
    assert len(transport.came[NAMES["markers"]]) == 10
