"""Stick files: accepted forms, and errors."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.errors import CohelmError
from cohelm.link import stick

DATA = Path(__file__).parents[3] / "shared" / "data" / "stick"
recorded = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recorded joysticks are not beside this checkout"
)

EVENTS = (
    "run,source,t,v,w\n"
    "0,joy_cmd,-0.04,0,0\n0,joy_cmd,1.5,0.5,1.3\n0,sloppy_joy_cmd,2,1,1\n"
    "1,cmd_vel,0,-1,-0.65\n"
)
RUNS = (
    "run,participant,t,x,y,joy_v,joy_w,cmd_v,cmd_w\n"
    "0,p,0.0,9,9,0.5,0.65,0.1,3.0\n0,p,0.1,9,9,1.0,-1.3,0.1,4.0\n"
    "1,p,0.0,9,9,,,0.25,1.3\n"
)


def written(folder: Path, text: str, name: str = "stick.csv") -> Path:
    file = folder / name
    file.write_text(text)
    return file


def refusal(*args, **options) -> str:
    with pytest.raises(CohelmError) as caught:
        stick.read(*args, **options)
    return str(caught.value)


@pytest.mark.parametrize(
    "header", ["t,x,psi", "t,fore_aft,left_right", "time_s, stick_x, stick_psi"]
)
def test_each_column_name_of_a_plain_table_is_accepted(tmp_path, header):
    table = stick.read(written(tmp_path, f"# mine\n{header}\n-1,0,0\n\n0.5,1,-0.25\n0.5,0,0\n"))
    assert table.times.tolist() == [-1.0, 0.5, 0.5]
    assert table.x.tolist() == [0.0, 1.0, 0.0]
    assert table.psi.tolist() == [0.0, -0.25, 0.0]


@given(
    st.lists(
        st.tuples(st.floats(0, 10), st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=20
    )
)
def test_every_ordered_table_is_read_back_bit_for_bit(tmp_path_factory, steps):
    times = np.cumsum([step[0] for step in steps])
    rows = [f"{float(t)!r},{x!r},{psi!r}" for t, (_, x, psi) in zip(times, steps, strict=True)]
    file = written(tmp_path_factory.mktemp("stick"), "\n".join(["t,x,psi", *rows]))
    table = stick.read(file)
    assert (table.times == times).all()
    assert table.x.tolist() == [x for _, x, _ in steps]
    assert table.psi.tolist() == [psi for _, _, psi in steps]


def test_a_gzip_file_is_read_as_the_plain_one(tmp_path):
    file = tmp_path / "stick.csv.gz"
    file.write_bytes(gzip.compress(b"t,x,psi\n0,0.5,0\n"))
    assert stick.read(file).x.tolist() == [0.5]


def test_the_stick_of_an_event_log_is_scaled_to_full_deflection(tmp_path):
    file = written(tmp_path, EVENTS)
    table = stick.read(f"{file}#0")
    assert table.times.tolist() == [-0.04, 1.5]
    assert table.psi.tolist() == [0.0, 1.0]
    assert stick.read(file, run="1").psi.tolist() == [-0.5]
    assert stick.read(f"{file}#0:sloppy_joy_cmd").psi.tolist() == [1.0]
    assert stick.read(file, run="1", full_scale=(2.0, 0.65)).x.tolist() == [-0.5]


def test_a_log_of_runs_gives_the_stick_and_not_the_pose_or_the_command(tmp_path):
    file = written(tmp_path, RUNS)
    table = stick.read(f"{file}#0")
    assert table.x.tolist() == [0.5, 1.0]
    assert table.psi.tolist() == [0.5, -1.0]
    # where no assistant stood between, the command was the hand
    assert stick.read(f"{file}#1").psi.tolist() == [1.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,x,psi\n0,0,0\n2,0,0\n1,0,0\n", "stick.csv:4: t: 1 s comes after 2 s; sort the rows"),
        ("t,x,psi\n0,0,0\n1,0,-1.2\n", "stick.csv:3: psi: deflection -1.2 is beyond -1 ... 1"),
        ("t,x,psi\n0,nan,0\n", "stick.csv:2: x: must be a finite number, got 'nan'"),
        ("t,x,psi\n0,0,\n", "stick.csv:2: psi: must be a finite number, got nothing"),
        ("# why\nt,x,psi\n\n0,left,0\n", "stick.csv:4: x: must be a finite number, got 'left'"),
        ("t,x,psi\n0,0\n", "stick.csv:2: 2 cells, but the header has 3 (t, x, psi)"),
        ("t,x,y\n0,0,0\n", "no column psi (or left_right, stick_psi); found: t, x, y"),
        ("x,psi\n0,0\n", "no column t (or t_s, time, time_s); found: x, psi"),
        ("t,x,psi\n", "has a header but no rows"),
        ("", "is empty; it needs a header t,x,psi"),
        ('t,x,psi\n0,"0\n0",0\n', "a quoted cell spans lines"),
        ("t,cmd_v,x\n0,0,0\n", "no pair of columns such as joy_v and joy_w; found: t, cmd_v, x"),
        (EVENTS, "which run? it holds 0, 1; choose with stick.csv#0"),
        ("run,source,t,v,w\n0,planner,0,0,0\n", "which source? there are planner"),
    ],
)
def test_a_stick_file_that_is_not_in_order_is_refused_with_line_and_value(tmp_path, text, said):
    assert said in refusal(written(tmp_path, text))


def test_a_missing_run_or_source_is_refused_with_the_available_ones(tmp_path):
    events, runs = written(tmp_path, EVENTS), written(tmp_path, RUNS, "runs.csv")
    assert "no run '7'; it holds 0, 1" in refusal(f"{events}#7")
    assert "no source 'nav'; there are joy_cmd, sloppy_joy_cmd" in refusal(f"{events}#0:nav")
    assert "no source 'joy' in this run; there are cmd" in refusal(f"{runs}#1:joy")
    plain = written(tmp_path, "t,x,psi\n0,0,0\n", "plain.csv")
    assert "holds a single run" in refusal(plain, run="0")


def test_a_file_that_can_not_be_a_table_is_refused(tmp_path):
    written(tmp_path, "t,x,psi\n0,0,0\n", "mine.csv")
    assert "no such stick file; did you mean mine.csv?" in refusal(tmp_path / "min.csv")
    assert "is a folder" in refusal(tmp_path)
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\xff\xfe")
    assert "not a text file" in refusal(tmp_path / "picture.csv")
    (tmp_path / "half.csv.gz").write_bytes(gzip.compress(b"t,x,psi\n0,0,0\n" * 99)[:-12])
    assert "damaged or cut short" in refusal(tmp_path / "half.csv.gz")


def test_too_much_deflection_is_clipped_only_on_request(tmp_path):
    file = written(tmp_path, "t,x,psi\n0,3,-1.5\n1,0.5,0.5\n")
    assert "(and" not in refusal(file)
    table = stick.read(file, clip=True)
    assert table.x.tolist() == [1.0, 0.5]
    assert table.psi.tolist() == [-1.0, 0.5]


@recorded
@pytest.mark.parametrize("name", ["joystick_runs_10hz.csv.gz", "joystick_raw_events.csv.gz"])
@pytest.mark.parametrize("run", range(6))
def test_every_recorded_run_is_ordered_and_reaches_full_deflection(name, run):
    table = stick.read(DATA / f"{name}#{run}")
    assert len(table.times) > 300
    assert (np.diff(table.times) >= 0.0).all()
    assert np.abs(table.x).max() == 1.0
    assert np.abs(table.psi).max() == 1.0


@recorded
@pytest.mark.parametrize("run", range(6))
def test_both_logs_of_a_run_have_the_same_stick(run):
    even = stick.read(DATA / f"joystick_runs_10hz.csv.gz#{run}")
    events = stick.read(DATA / f"joystick_raw_events.csv.gz#{run}")
    newest = np.searchsorted(events.times, even.times, side="right") - 1
    held = newest >= 0
    # the 10 Hz log holds the newest message, on times rounded to its own grid
    same = np.abs(even.psi[held] - events.psi[newest[held]]) < 0.02
    assert same.mean() > 0.8
