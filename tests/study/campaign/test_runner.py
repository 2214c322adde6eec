"""Campaigns go on where they stopped, and come out the same however they are driven."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import process
from dataclasses import replace
from multiprocessing import active_children

import pytest

from cohelm.core.errors import CohelmError
from cohelm.study.campaign import runner, suites, worker as drive
from cohelm.study.campaign.runner import CampaignConfig, planned, remaining, run
from cohelm.study.campaign.store import Store, read_plan, read_rows

pytestmark = pytest.mark.xdist_group("adversarial")  # which is compiled once for them
PLAN = CampaignConfig("adversary", ("guard", "none"), 7, 30)


def quiet(_doing, _share):
    pass


def text(rows):
    return [repr(row) for row in rows]  # NaN is equal to itself so


def test_the_same_seed_gives_the_same_rows_whatever_the_number_of_processes(tmp_path):
    plan = replace(PLAN, n=12)  # more than are driven at a time
    _, one = run(plan, tmp_path / "one", 1, None, quiet)
    _, two = run(plan, tmp_path / "two", 2, None, quiet)
    assert text(one) == text(two)
    assert [(r.law, r.episode) for r in one] == [
        (law, k) for law in plan.laws for k in range(12)
    ]  # fmt: skip
    _, other = run(
        CampaignConfig("adversary", ("guard",), 8, 3), tmp_path / "three", 1, None, quiet
    )
    assert text(other) != text(one[:3])


def test_a_shipped_scenario_that_was_changed_makes_other_rows(tmp_path, monkeypatch):
    """lab and hands are driven in one of them."""
    file, made = tmp_path / "lab-guard.yaml", []
    monkeypatch.setattr(drive, "shipped", lambda: {"lab-guard": file})
    for seen in ("a", "b", "a"):
        file.write_text(seen)
        made.append(drive.code.__wrapped__())
    assert made[0] == made[2] != made[1]


def test_a_cohelm_inside_of_another_repository_has_no_commit_of_that(tmp_path, monkeypatch):
    """As in an environment that somebody keeps in his own checkout."""
    package = tmp_path / ".venv" / "cohelm"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    monkeypatch.setattr(drive, "_PACKAGE", package)
    assert drive.commit() is None
    git = ("git", "-C", tmp_path, "-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("init", "-q"), ("commit", "-q", "--allow-empty", "-m", "theirs")):
        subprocess.run([*git, *command], check=True)
    assert drive.commit() is None
    subprocess.run([*git, "add", "-A"], check=True)
    subprocess.run([*git, "commit", "-q", "-m", "ours"], check=True)
    assert re.fullmatch("[0-9a-f]{12}", drive.commit())
    monkeypatch.setenv("PATH", str(tmp_path))
    assert drive.commit() is None


def test_an_interrupted_campaign_continues_and_repeats_no_episode(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "_FLUSH", 0.0)
    driven = []
    real = drive.chunk

    def counted(made, law, numbers):
        if len(driven) == 3:
            raise KeyboardInterrupt
        driven.append((law, numbers))
        return real(made, law, numbers)

    monkeypatch.setattr(runner, "chunk", counted)
    with pytest.raises(KeyboardInterrupt):
        run(PLAN, tmp_path, 1, None, quiet)
    kept = read_rows(tmp_path)
    assert len(kept) == 30
    before = list(driven)
    driven[:] = []
    monkeypatch.setattr(runner, "chunk", lambda *w: driven.append(w[1:]) or real(*w))
    shares = []
    _, rows = run(PLAN, tmp_path, 1, None, lambda _d, share: shares.append(share))
    assert shares[0] == pytest.approx(0.5)
    assert len(before) + len(driven) == len(set(before + driven)) == 6
    assert text(rows) == text(run(PLAN, tmp_path.with_name("whole"), 1, None, quiet)[1])


_KILLED = """
import sys
from pathlib import Path
from cohelm.study.campaign.runner import CampaignConfig, run
if __name__ == "__main__":
    asked = CampaignConfig("adversary", ("guard",), 7, 400)
    run(asked, Path(sys.argv[1]), 2, None, lambda *_: None)
"""


def test_an_interrupted_campaign_leaves_no_process_and_no_thread(tmp_path, monkeypatch):
    """Python ends beside a thread of the pool with an error, now and then."""
    of_pool, ending = process._ExecutorManagerThread, "join_executor_internals"
    real, before = getattr(of_pool, ending), {*threading.enumerate(), *active_children()}
    monkeypatch.setattr(of_pool, ending, lambda thread: time.sleep(0.5) or real(thread))
    plan = replace(PLAN, n=60)

    def interrupts(_doing, share):
        if share > 0.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(plan, tmp_path, 2, None, interrupts)
    assert {*threading.enumerate(), *active_children()} <= before


@pytest.mark.slow  # Ctrl-C and a worker that is killed are tried by default
def test_kill_9_loses_no_episode_and_leaves_no_process(tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(_KILLED)
    there = tmp_path / "there"
    process = subprocess.Popen([sys.executable, script, there], start_new_session=True)
    until = time.monotonic() + 120.0
    while not list(there.glob("rows/part-*.parquet")) and time.monotonic() < until:
        time.sleep(0.02)
    process.kill()
    process.wait()
    kept = read_rows(there)
    assert 0 < len(kept) < 400
    while _alive(process.pid) and time.monotonic() < until:  # the workers end by themselves
        time.sleep(0.05)
    assert not _alive(process.pid)
    plan = CampaignConfig("adversary", ("guard",), 7, 400)
    _, rows = run(plan, there, 1, None, quiet)
    assert [row.episode for row in rows] == list(range(400))
    assert all(repr(rows[k]) == repr(row) for (_, k), row in kept.items())
    made = plan.prepared()
    assert text(rows[:10]) == text(drive.chunk(made, "guard", tuple(range(10))))


def _alive(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow  # two processes are started, and driven until one is killed
def test_a_killed_worker_is_reported_and_the_campaign_can_continue(tmp_path, monkeypatch):
    from multiprocessing import active_children

    others = {child.pid for child in active_children()}  # of tests that ran before
    killed = []

    def workers():
        return [child.pid for child in active_children() if child.pid not in others]

    def told(doing, _share):
        if not killed and " of " in doing:
            killed.append(os.kill(workers()[0], signal.SIGKILL))

    with pytest.raises(CohelmError, match=r"killed from outside.*same command"):
        run(CampaignConfig("adversary", ("guard",), 7, 4000), tmp_path, 2, None, told)
    assert len(read_rows(tmp_path)) > 0
    assert not workers()


def test_an_internal_error_in_one_episode_is_reported_in_its_row(tmp_path, monkeypatch):
    real = suites.rooms.case

    def broken(seed, number, model):
        return real(seed, number, model) if number != 1 else 1 // 0

    monkeypatch.setattr(suites.rooms, "case", broken)
    _, rows = run(CampaignConfig("random", ("none",), 1, 3), tmp_path, 1, None, quiet)
    assert [bool(row.fault) for row in rows] == [False, True, False]
    assert rows[1].fault.startswith("ZeroDivisionError: ")
    assert "test_runner.py" in rows[1].fault
    assert not rows[1].arrived


def test_all_laws_drive_an_episode_before_the_next_ones_come():
    work = remaining(("guard", "none"), 7, 3, {("guard", 1), ("none", 6)})
    assert work == [
        ("guard", (0, 2)), ("none", (0, 1, 2)), ("guard", (3, 4, 5)), ("none", (3, 4, 5)),
        ("guard", (6,)),
    ]  # fmt: skip


WALK = "t,id,x,y\n" + "".join(f"{0.4 * k:.1f},1,{0.4 * k:.1f},9\n" for k in range(9))
STICK = "t,x,psi\n" + "".join(f"{0.1 * k:.1f},0.5,0.1\n" for k in range(20))
WORLDS = '{"worlds": [{"id": 3, "cyl": [[1, 5]], "path": [[-2, 3], [-2, 13]]}]}'


@pytest.mark.parametrize(
    ("name", "file", "text", "other"),
    [
        ("adversary", "stick/hand.csv", STICK, "stick/another.csv"),
        ("hands", "stick/hand.csv", STICK, "hand.csv"),
        ("crowd", "scene.csv", WALK, "another.csv"),
        ("barn", "barn/worlds.json", WORLDS, ""),
    ],
)
def test_data_that_were_changed_do_not_continue_a_campaign(tmp_path, name, file, text, other):
    """Their rows are of other episodes of the same numbers."""
    data, out = tmp_path / "data", tmp_path / "out"
    (data / file).parent.mkdir(parents=True)
    (data / file).write_text(text)
    plan = CampaignConfig(name, ("none",), 1, 1, data)

    def opened():
        with Store(out, plan.as_dict(plan.prepared())):
            pass

    def refused():
        with pytest.raises(CohelmError, match=r"another version of the data in --data, .* --out"):
            opened()

    opened()
    (data / file).touch()
    (data / "README").write_text("whose they are")
    opened()
    (data / file).write_text(text.replace("5", "4").replace("9", "8"))
    refused()
    (data / file).write_text(text)
    opened()
    if other:
        (data / other).write_text(text)
        (opened if name == "hands" else refused)()  # hands has a folder of its own here


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (CampaignConfig("random", ("guard",), 1, 0), "--n"),
        (CampaignConfig("random", ("guard",), -1), "--seed"),
        (CampaignConfig("random", ("guard", "guard"), 1), "once"),
        (CampaignConfig("random", ("gaurd",), 1), "no law 'gaurd'"),
        (CampaignConfig("lab", ("rvo",), 1), "choose guard, paper, none"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(plan, words, tmp_path):
    with pytest.raises(CohelmError, match=words):
        run(plan, tmp_path / "x", 1, None, quiet)
    assert not (tmp_path / "x").exists()


def test_the_plan_a_folder_keeps_makes_the_same_campaign(tmp_path):
    run(CampaignConfig("random", ("none",), 3, 2), tmp_path, 1, None, quiet)
    kept = read_plan(tmp_path)
    assert kept is not None
    assert planned(tmp_path) == CampaignConfig("random", ("none",), 3, 2, plant="kinematic")
    for wrong in ({"suite": "random"}, kept | {"n": math.inf}, kept | {"laws": 5}):
        (tmp_path / "campaign.json").write_text(json.dumps(wrong))
        with pytest.raises(CohelmError, match=rf"{tmp_path}\S+: is not a campaign's plan"):
            planned(tmp_path)


@pytest.mark.slow  # only a new room can change it
def test_the_digest_of_the_code_is_of_every_room_that_a_row_can_depend_on():
    loaded = "import sys, cohelm.study.campaign.worker as w; print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True).stdout
    rooms = {name.split(".")[1] for name in said.split() if name.startswith("cohelm.")}
    assert {"robot", "study"} <= rooms <= set(drive.ROOMS)
