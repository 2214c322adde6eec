"""`cohelm calibrate`; the simulated robot drives in real time."""

import io
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cohelm.scenario.load import load_robot

TYPED = [sys.executable, "-m", "cohelm", "calibrate", "sally", "--yes", "--json", "-o", "out"]


def test_a_load_without_a_run_before_is_refused_before_anything_moves(cohelm):
    said = cohelm("calibrate", "sally", "--yes", "--load", "-o", "out")
    assert said.code == 2
    assert "needs a run without it first" in said.err
    assert not Path("out").exists()


@pytest.mark.parametrize("whole", [True, False])
def test_what_was_measured_is_not_overwritten_but_where_it_is_not_whole(cohelm, monkeypatch, whole):
    monkeypatch.setattr(sys, "stdin", io.StringIO("n\n"))
    Path("out").mkdir()
    Path("out/calibration.json").write_text(json.dumps({"robot": "cart", "whole": whole}))
    said = cohelm("calibrate", "sally", "-o", "out")
    assert said.code == 2
    assert ("out holds what was measured of cart already: choose another" in said.err) is whole
    assert ("nothing was driven" in said.err) is not whole


def test_an_unwritable_output_is_reported_before_anything_moves(cohelm):
    Path("out").write_text("mine")
    said = cohelm("calibrate", "sally", "--yes", "-o", "out/here")
    assert said.code == 2
    assert "the folder out/here can not be made" in said.err


def test_a_robot_with_a_clock_of_its_own_is_driven_by_it(cohelm):
    """It waited for ever: that clock goes on in `wait` only, which another process never called."""
    driver = "tests.api.carts:Dying"  # after three seconds by its clock
    said = cohelm("calibrate", "sally", "--driver", driver, "--yes", "-o", "out")
    assert said.code == 2
    assert "the line is dead" in said.err


@pytest.mark.slow
def test_a_robot_is_measured_and_its_file_written_and_then_again_with_a_load(tmp_path):
    for more in ([], ["--load"]):
        ran = subprocess.run(
            TYPED + more, cwd=tmp_path, capture_output=True, text=True, timeout=400
        )
        assert ran.returncode == 0, ran.stderr
        said = json.loads(ran.stdout)
        assert said["whole"]
        assert said["with_load"] == bool(more)
        assert {one["verdict"] for one in said["findings"].values()} == {"safe"}
        assert [(tmp_path / one).stat().st_size > 10_000 for one in said["pictures"]] == [True] * 2
        measured, shipped = load_robot(str(tmp_path / said["file"])), load_robot("sally")
        assert measured.odometry != shipped.odometry
        assert measured.model_copy(update={"odometry": shipped.odometry}) == shipped


@pytest.mark.slow
def test_ctrl_c_during_calibration_stops_the_robot_and_reports_missing_data(tmp_path):
    ran = subprocess.Popen(TYPED, cwd=tmp_path, stdout=-1, stderr=-1, text=True)
    try:
        ran.wait(20.0)
        pytest.fail("it ended by itself")
    except subprocess.TimeoutExpired:
        ran.send_signal(signal.SIGINT)
    out, err = ran.communicate(timeout=30.0)
    assert (ran.returncode, out) == (2, "")
    assert "too little was driven" in err
    assert "nothing is written" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_measurements_are_printed_though_nothing_can_be_written(tmp_path):
    """As where the disk is full by then."""
    (tmp_path / "out" / "calibration.json").mkdir(parents=True)
    ran = subprocess.run(TYPED, cwd=tmp_path, capture_output=True, text=True, timeout=400)
    assert ran.returncode == 2
    assert "out can not be written (Is a directory): what was measured stands above" in ran.stderr
    assert json.loads(ran.stdout)["findings"]
