"""`cohelm campaign`: results, comparison, replay, errors."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta

import pytest

from cohelm import __version__ as cohelm_version
from cohelm.core.interrupts import INTERRUPTS
from cohelm.robot.model import shipped_path
from cohelm.study.campaign import runner, worker
from cohelm.study.campaign.runner import processors
from cohelm.study.campaign.worker import commit

pytestmark = pytest.mark.xdist_group("adversarial")  # which is compiled once for them

MOST = 4 * processors()
ONE = ("campaign", "adversary", "--law", "guard", "--n", "3", "--seed", "2", "--jobs", "1")
# of this seed both laws arrive within 20 s
TWO = ("campaign", "random", "--compare", "none,paper", "--n", "2", "--seed", "7", "--jobs", "1")


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Folders of campaigns, by their arguments, as they were left: each is driven once."""
    left = {}

    def take(cohelm, arguments, to):
        """Such a folder at `to`, and what the command said when it was driven."""
        if arguments not in left:
            folder = tmp_path_factory.mktemp("driven") / "there"
            left[arguments] = folder, cohelm(*arguments, "--out", folder)
        folder, said = left[arguments]
        shutil.copytree(folder, to)
        return said

    return take


@pytest.fixture
def undrawn(monkeypatch):
    """For who looks at no picture: for that of the report each episode is driven again."""
    monkeypatch.setattr("cohelm.study.campaign.report._figure", lambda _suite, _row: "")
    monkeypatch.setattr("cohelm.study.campaign.pictures.picture", lambda *_: b"")
    monkeypatch.setattr("cohelm.study.campaign.pictures.strip", lambda *_: None)


@pytest.mark.usefixtures("undrawn")
def test_one_law_gives_one_json_object_with_its_counts(cohelm, driven, tmp_path):
    said = driven(cohelm, (*ONE, "--json"), tmp_path / "there")
    assert said.code == 0
    got = json.loads(said.out)
    assert (got["suite"], got["law"], got["episodes"], got["seed"]) == ("adversary", "guard", 3, 2)
    assert (got["arrived"], got["score"], got["contacts_moving"]) == (None, None, 0)
    assert got["min_clearance_moving_m"] >= 0.0075
    assert got["limit_excess"] == 0.0
    assert got["contacts_moving_share"]["high"] == pytest.approx(1.0 - 0.025 ** (1 / 3))
    assert "compare" not in got
    assert got["version"] == cohelm_version
    assert datetime.now(UTC) - datetime.fromisoformat(got["began"]) < timedelta(hours=1)
    assert got["commit"] == commit()
    assert json.loads((tmp_path / "there" / "summary.json").read_text()).items() <= got.items()


def test_laws_are_compared_on_the_same_episodes(cohelm, driven, tmp_path, monkeypatch):
    said = driven(cohelm, TWO, tmp_path / "there")
    assert said.code == 0
    assert re.search(r"quantity\W+none\W+paper", said.out)
    page = (tmp_path / "there" / "report.html").read_text()
    assert page.count("<img") == 4  # both episodes under both laws
    assert 'src="http' not in page
    assert "link " not in page
    monkeypatch.setattr("cohelm.study.campaign.report.write", None)  # nothing is drawn again
    got = json.loads(cohelm("campaign", "there", "--json").out)
    assert [one["law"] for one in got["compare"]] == ["none", "paper"]
    assert got["law"] == "none"
    assert got["episodes"] == 2


@pytest.mark.usefixtures("undrawn")
def test_a_campaign_with_a_custom_robot_continues_without_its_file(cohelm, tmp_path):
    """The file is kept in the plan: it may be moved or changed afterwards."""
    shutil.copy(shipped_path("turtlebot3_burger"), tmp_path / "mine.yaml")
    drive = ("--law", "none", "--n", "1", "--seed", "2", "--jobs", "1", "--json")
    said = cohelm("campaign", "random", "--robot", "mine.yaml", *drive, "--out", "there")
    assert said.code == 0
    got = json.loads(said.out)
    assert got["robot"] == "turtlebot3_burger"
    (tmp_path / "mine.yaml").unlink()
    again = json.loads(cohelm("campaign", "there", "--json").out)
    assert again == got
    row = json.loads(cohelm("campaign", "there", "--replay", "0", "--json").out)
    assert row["same_as_row"]
    assert "turtlebot3_burger drives here" in (tmp_path / "there" / "report.html").read_text()
    other = cohelm("campaign", "random", "--robot", "husky", *drive, "--out", "there")
    assert other.code != 0
    assert "robot turtlebot3_burger (requested: husky)" in other.err


@pytest.mark.parametrize(
    "given",
    [("--seed", "3"), ("--seed", "7"), ("--replay", "0", "--law", "paper"),
     ("--replay", "0", "--seed", "3"), ("--replay", "0", "--plant", "twin")],
    ids=" ".join,
)  # fmt: skip
def test_options_that_a_folder_has_already_are_refused_and_not_ignored(
    cohelm, driven, tmp_path, given
):
    driven(cohelm, TWO, tmp_path / "there")
    said = cohelm("campaign", "there", *given)
    assert said.code == 2
    assert "there continues with its own options: leave out" in said.err
    assert not (tmp_path / "there" / "episodes").exists()


def test_failed_episodes_are_reported_and_the_exit_status_is_1(cohelm, tmp_path):
    (tmp_path / "torn.py").write_text("def law(robot, period):\n    return lambda now: 1 / 0\n")
    wanted = ("campaign", "random", "--law", "torn:law", "--n", "2", "--jobs", "1", "--out", "x")
    said = cohelm(*wanted)
    assert said.code == 1
    assert "failed: torn:law/0: ZeroDivisionError: division by zero (torn.py:2)" in said.err
    assert "1 more, in the report" in said.err
    again = cohelm("campaign", "x", "--json")
    assert again.code == 1
    assert len(json.loads(again.out)["failed"]) == 2


def test_a_replayed_row_equals_the_row_of_the_campaign(
    cohelm, driven, tmp_path, monkeypatch, request
):
    driven(cohelm, TWO, tmp_path / "there")
    monkeypatch.setattr("cohelm.study.campaign.report.write", None)  # nothing is drawn again
    got = json.loads(cohelm("campaign", "there", "--replay", "paper/1", "--json").out)
    assert got["same_as_row"] is True
    assert (got["law"], got["episode"], got["out"]) == ("paper", 1, "there/episodes/paper-1")
    scored = json.loads(cohelm("replay", "there/episodes/paper-1", "--json").out)
    assert scored["duration_s"] == pytest.approx(got["duration_s"])
    assert scored["path_length_m"] == pytest.approx(got["path_length_m"])
    monkeypatch.setattr("cohelm.study.campaign.replay_episode.drive", None)  # minutes, maybe
    again = cohelm("campaign", "there", "--replay", "paper/1")
    assert again.code == 2
    assert "never overwrites" in again.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("campaign", "randon"), ["no suite 'randon'", "did you mean random?"]),
        (("campaign", "barn"), ["--data"]),
        (("campaign", "random", "--n", "0"), ["--n"]),
        *(
            (
                ("campaign", "random", "--jobs", jobs),
                [f"between 1 and {MOST},", jobs],
            )
            for jobs in ("0", "-1", str(MOST + 1), "500")
        ),
        (("campaign", "random", "--law", "gaurd"), ["no law 'gaurd'", "guard"]),
        (("campaign", "random", "--law", "none", "--compare", "paper"), ["not both"]),
        (("campaign", "random", "--law", "gaurd"), ["did you mean guard?"]),
        (("campaign", "random", "--compare", "guard,"), ["name each law between the commas"]),
        (("campaign", "random", "--cluster", ""), ["--cluster is empty", "leave it out"]),
        (("campaign", "."), ["holds no campaign"]),
        (("campaign", "out/rooms"), ["out/rooms: there is no such folder"]),
        (("campaign", ".", "--replay", "1"), ["holds no campaign"]),
        (("campaign", "random", "--replay", "1"), ["random", "holds no campaign"]),
    ],
)
def test_invalid_options_are_refused_in_one_sentence(cohelm, tmp_path, arguments, words):
    said = cohelm(*arguments, "--json")
    assert (said.code, said.out) == (2, "")
    assert said.err.startswith("error: ")
    assert all(word in said.err for word in words)
    assert "Traceback" not in said.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("undrawn")
def test_a_folder_of_another_campaign_is_not_touched(cohelm, driven, tmp_path):
    driven(cohelm, (*ONE, "--json"), tmp_path / "there")
    before = sorted((f.name, f.stat().st_size) for f in (tmp_path / "there").rglob("*"))
    said = cohelm(*ONE[:-4], "--seed", "3", "--out", "there")
    assert said.code == 2
    assert "seed 2 (requested: 3)" in said.err
    for n in ("7", "0"):
        assert cohelm("campaign", "there", "--n", n).code == 2
    for which in ("guard/77", "²", "guard/"):
        said = cohelm("campaign", "there", "--replay", which)
        assert (said.code, "no such row" in said.err) == (2, True)
    assert sorted((f.name, f.stat().st_size) for f in (tmp_path / "there").rglob("*")) == before


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("sent", INTERRUPTS)
def test_ctrl_c_keeps_what_was_driven_and_prints_how_to_continue(
    cohelm, tmp_path, monkeypatch, sent
):
    driven = []

    def chunk(suite, law, numbers):
        driven.append(numbers)
        if len(driven) == 2:
            signal.raise_signal(sent)
        return worker.chunk(suite, law, numbers)

    monkeypatch.setattr(runner, "chunk", chunk)
    before = {one: signal.getsignal(one) for one in INTERRUPTS}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where pytest is under nohup
    try:
        options = ("--law", "none", "--n", "25", "--jobs", "1", "--out", "over there")
        said = cohelm("campaign", "adversary", *options)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert said.code == 130
    assert "interrupted" in said.err
    assert "cohelm campaign 'over there'\n" in said.err
    assert "Traceback" not in said.err
    got = json.loads(cohelm("campaign", "over there", "--json", "--jobs", "1").out)
    assert got["episodes"] == 25
    first, cut, *rest = driven
    assert rest == [cut, tuple(range(20, 25))]  # and none of the first ones again
    assert first == tuple(range(10))


@pytest.mark.slow  # in this process: above; what is left of it: tests/study/campaign/test_runner.py
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("sent", INTERRUPTS)
def test_ctrl_c_keeps_finished_episodes_and_prints_how_to_continue(cohelm, tmp_path, sent):
    command = [sys.executable, "-m", "cohelm", "campaign", "adversary", "--law", "none"]
    process = subprocess.Popen(
        [*command, "--n", "300", "--jobs", "2", "--out", "over there"],
        cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    until = time.monotonic() + 120.0
    while not list(tmp_path.glob("over there/rows/part-*.parquet")) and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(sent)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "cohelm campaign 'over there'\n" in err
    assert "Traceback" not in err
    assert "leaked" not in err
    got = json.loads(cohelm("campaign", "over there", "--json", "--jobs", "1").out)
    assert got["episodes"] == 300
