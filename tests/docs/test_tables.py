"""The tables of the documentation that are made from the code are those of the code."""

import re

import pytest

import cohelm
from cohelm.law.verdict import Verdict
from cohelm.link.messages import Arming
from cohelm.pilot import step
from cohelm.record import period, topics
from cohelm.robot.gate.modes import GateMode
from tools.tables import DOCS, TABLES, written

RECORDS = (DOCS / "records.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.name)
def test_no_table_is_out_of_date(page):
    text = page.read_text(encoding="utf-8")
    assert text == written(text), "run python tools/tables.py"


def test_every_table_is_documented_on_a_page():
    pages = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    assert set(re.findall(r"<!-- table: ([\w-]+) -->", pages)) == set(TABLES)


def test_the_robot_on_the_page_is_one_that_the_filter_takes(tmp_path):
    text, *_ = re.findall(r"```yaml\n(.*?)```", (DOCS / "robot-yaml.md").read_text(), re.DOTALL)
    (tmp_path / "cart.yaml").write_text(text)
    robot = cohelm.load_robot(str(tmp_path / "cart.yaml"))
    assert robot.lidar is not None
    safe = cohelm.SafetyFilter(robot, 0.02)
    seen = cohelm.Obstacles(points=[[0.55, 0.0]])
    still = cohelm.Twist(0.0, 0.0)
    assert safe(cohelm.Pose(0.0, 0.0, 0.0), still, cohelm.Twist(1.0, 0.0), seen).twist.v < 0.1


def section(title: str) -> str:
    return re.split(r"^##+ ", RECORDS.split(f" {title}\n", 1)[1], maxsplit=1, flags=re.M)[0]


def test_every_topic_is_documented_with_its_type():
    rows = re.findall(r"^\| `(/[\w/]+)` \| `([\w/]+)` \|", section("Topics"), re.M)
    assert dict(rows) == topics.TOPICS


def test_every_verdict_is_documented_with_its_number():
    rows = re.findall(r"^\| (\d) \| ([A-Z]+) \|", section("Verdicts"), re.M)
    assert {name: int(number) for number, name in rows} == Verdict.__members__


@pytest.mark.parametrize(
    ("field", "names"),
    [
        ("mode", dict(GateMode.__members__)),
        ("arming", dict(Arming.__members__)),
        ("behavior", {n: getattr(step, n) for n in ("FOLLOWING", "LED", "ESCAPING", "EVADING")}),
    ],
)
def test_every_number_of_a_choice_is_documented_on_the_page_and_in_the_definition(field, names):
    (row,) = re.findall(rf"^\| `{field}` \| (.*) \|$", section("Verdicts"), re.M)
    assert {n: int(v) for n, v in re.findall(r"([A-Z]+) (\d)", row)} == names
    (constants,) = re.findall(
        rf"((?:^int64 [A-Z]+=\d\n)+)^int64 {field}  #", period.DEFINITION, re.M
    )
    assert {n: int(v) for n, v in re.findall(r"([A-Z]+)=(\d)", constants)} == names


def test_every_status_of_the_diagnostics_is_documented_with_its_values():
    from cohelm.link.messages import Alarm, Mode as Chosen, Severity
    from cohelm.link.recorded_status import StatusWords
    from cohelm.record.shown import to_messages

    alarm = Alarm(1, Severity.WARNING, True, False, "a")
    told = StatusWords(1, "anna", Chosen.HOLD, "", "", 1.0, "", (alarm,))
    ((_, message),) = to_messages(told, 0, "map")
    rows = re.findall(r"^\| `([\w ]+)`.*?\|.*?\| (.*?)\|", section("The diagnostics message"), re.M)
    assert {name: set(re.findall(r"`(\w+)`", values)) for name, values in rows} == {
        one.name: {pair.key for pair in one.values} for one in message.status
    }
