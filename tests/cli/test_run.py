"""`cohelm run` and `cohelm replay`: files and output."""

import json
from datetime import datetime

import pytest
from PIL import Image

from cohelm.core.errors import CohelmError
from cohelm.scenario import build, load
from cohelm.study import single

BRIEF = ("minimal", "--set", "simulation.duration_s=3")
LAB = ("lab-shared", "--set", "simulation.duration_s=20")  # the mover sets out at 15 s
WRITTEN = {"record.mcap", "scenario.yaml", "metrics.json", "run.png", "run.svg"}


@pytest.fixture
def undrawn(monkeypatch):
    """For who looks at no picture: it takes longer than a short run."""
    monkeypatch.setattr("cohelm.study.figures.draw_run", lambda run, folder, name: None)


def test_a_run_leaves_record_scenario_scores_and_picture(cohelm, tmp_path):
    said = cohelm("run", *BRIEF, "--out", "there")
    assert said.code == 0
    assert said.err == "record, scores and picture: there\n"
    assert "smallest h, post" in said.out
    assert {file.name for file in (tmp_path / "there").iterdir()} == WRITTEN
    with Image.open(tmp_path / "there" / "run.png") as picture:
        assert picture.width > 1000
    assert (tmp_path / "there" / "run.svg").read_text().lstrip().startswith("<?xml")


@pytest.mark.usefixtures("undrawn")
def test_a_replay_gives_the_metrics_of_the_run_to_the_last_digit(cohelm, tmp_path):
    ran = json.loads(cohelm("run", *LAB, "--out", "there", "--json").out)
    replayed = json.loads(cohelm("replay", "there/record.mcap", "--json").out)
    assert replayed.pop("record") == "there/record.mcap"
    assert (replayed.pop("record_whole"), replayed.pop("record_fault")) == (True, None)
    assert (ran.pop("scenario"), ran.pop("out")) == ("lab-shared", "there")
    assert replayed == ran
    assert json.loads((tmp_path / "there" / "metrics.json").read_text()) == ran
    assert set(ran["discs"]) == {"cone_1", "cone_2", "cone_3", "mover"}


@pytest.mark.usefixtures("undrawn")
def test_a_run_is_replayed_by_its_folder(cohelm):
    cohelm("run", *BRIEF, "--out", "there")
    assert json.loads(cohelm("replay", "there", "--json").out)["record"] == "there/record.mcap"


@pytest.mark.usefixtures("undrawn")
def test_the_stored_scenario_repeats_the_run(cohelm, tmp_path):
    first = json.loads(cohelm("run", *BRIEF, "--out", "first", "--json").out)
    second = json.loads(cohelm("run", "first/scenario.yaml", "--out", "second", "--json").out)
    assert (first.pop("out"), second.pop("out")) == ("first", "second")
    assert first == second
    assert (tmp_path / "first" / "record.mcap").read_bytes() == (
        tmp_path / "second" / "record.mcap"
    ).read_bytes()


@pytest.mark.usefixtures("undrawn")
def test_the_default_folder_has_name_and_time(cohelm, tmp_path):
    name = "../a b/" + "車" * 60
    said = cohelm("run", *BRIEF, "--set", f"name={name}", "--json")
    (folder,) = (tmp_path / "out").iterdir()
    assert said.code == 0
    assert json.loads(said.out)["out"] == f"out/{folder.name}"
    assert folder.name.startswith("---a-b-車車")
    when = "-".join(folder.name.split("-")[-2:])
    assert abs(datetime.strptime(when, "%Y%m%d-%H%M%S") - datetime.now()).seconds < 600


def test_runs_that_start_in_the_same_second_have_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = {single.fresh("lab") for _ in range(50)}
    assert len(folders) == 50
    assert all(folder.is_dir() for folder in folders)


def test_other_files_in_the_output_folder_are_kept(cohelm, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "notes.txt").write_text("mine")
    assert cohelm("run", *BRIEF, "--out", "there").code == 0
    assert (tmp_path / "there" / "notes.txt").read_text() == "mine"
    assert {file.name for file in (tmp_path / "there").iterdir()} == {*WRITTEN, "notes.txt"}


@pytest.mark.usefixtures("undrawn")
def test_warnings_are_printed_on_stderr_beside_the_json_object(cohelm):
    said = cohelm("run", *BRIEF, "--set", "reference.speed_mps=5", "--json")
    assert said.code == 0
    assert said.err.startswith("warning: reference: asks for a speed of 3.")
    assert json.loads(said.out)["scenario"] == "minimal"


@pytest.mark.usefixtures("undrawn")
def test_names_can_not_send_terminal_control_sequences(cohelm, tmp_path):
    (tmp_path / "s.yaml").write_text(
        'name: "\\e[31m[bold]x\\a"\nreference: {waypoints_m: [[0, 0], [1, 0]]}\n'
    )
    said = cohelm("run", "s.yaml")
    assert said.code == 0
    assert said.out.startswith("�[31m[bold]x�")
    assert "\x1b" not in said.out + said.err


@pytest.mark.usefixtures("undrawn")
def test_of_many_obstacles_the_nearest_are_listed_and_the_others_counted(cohelm, tmp_path):
    crowd = "\n".join(
        f"  - {{name: o{i}, center_m: [{i % 40 - 20}, {3 + i // 40}], radius_m: 0.1}}"
        for i in range(100)
    )
    (tmp_path / "s.yaml").write_text(
        f"name: crowd\nreference: {{waypoints_m: [[0, 0], [1, 0]]}}\nobstacles:\n{crowd}\n"
    )
    said = cohelm("run", "s.yaml", "--out", "there")
    assert said.code == 0
    assert said.out.count("smallest h, o") == 8
    assert "smallest h, 92 others" in said.out
    kept = json.loads((tmp_path / "there" / "metrics.json").read_text())
    assert len(kept["discs"]) == 100


@pytest.mark.usefixtures("undrawn")
def test_without_obstacles_clearances_are_null(cohelm, tmp_path):
    (tmp_path / "s.yaml").write_text("name: s\nreference: {waypoints_m: [[0, 0], [1, 0]]}\n")
    assert "nothing near" in cohelm("run", "s.yaml").out
    said = json.loads(cohelm("run", "s.yaml", "--json").out)
    assert (said["min_h"], said["min_clearance_m"], said["discs"]) == (None, None, {})


def test_a_run_of_a_single_step_is_a_run(cohelm):
    said = cohelm("run", "minimal", "--set", "simulation.duration_s=0.001", "--json")
    assert (said.code, said.err) == (0, "")
    assert json.loads(said.out)["duration_s"] == 0.0


def test_a_full_folder_is_reported_and_the_record_stays_whole(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    setup = build.setup(load.scenario(*BRIEF[:1], BRIEF[2:]))
    folder = tmp_path / "there"

    def told(doing: str, _share: float) -> None:
        if doing == "drawing":  # the picture's place is taken after the folder was found free
            (folder / "run.png").mkdir()

    with pytest.raises(CohelmError, match=r"run\.png can not be written.*record beside it is"):
        single.recorded(setup, folder, told)
    assert (folder / "metrics.json").exists()
