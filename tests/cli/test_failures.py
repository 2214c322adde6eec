"""Failures are in the summary, in --json and in the exit status."""

import errno
import json
import os
import resource
import subprocess
import sys
import time

import numpy as np
import pytest

from cohelm.cli import output
from cohelm.cli.robot import failures, rows
from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.record.file import About, RecordWriter
from cohelm.robot.port import Odometry, Scan
from cohelm.scenario import load
from cohelm.study import mapping, single

SOUND = {
    "scenario": "lab-guard", "robot": "Sally", "kind": "kinematic", "rate_hz": 50.0,
    "mode": "STOPPED", "reason": "the drive is over", "faulted": False, "arrived": True,
    "not_begun": None, "route": None, "docking": None, "docked": None,
    "least_clearance_moving_m": 0.1234567, "lost_share": 0.02, "lost": False, "periods": 2000,
    "overruns": 0, "within_2ms": 0.9991, "late_median": 1e-5, "late_99": 2e-5, "late_999": 2e-5,
    "late_worst": 0.0123, "took_median": 0.002, "took_99": 0.004, "took_worst": 0.009,
    "refused": 0, "scheduling": "real time", "record": "a.mcap", "record_whole": True,
    "record_fault": None, "record_dropped": 0, "live": None,
}  # fmt: skip


def test_where_what_is_compiled_can_not_be_kept_each_command_says_so(cohelm, monkeypatch):
    from cohelm.core import jit

    monkeypatch.setattr(jit, "_unkept", [])
    assert cohelm("schema").err == ""
    monkeypatch.setattr(jit, "_unkept", ["Read-only file system", "and again"])
    said = cohelm("schema", "--nonsense").err
    assert "not kept (Read-only file system), so every start takes a minute: give COHE" in said


def test_a_successful_drive_reports_no_failure():
    assert failures(SOUND) == []


@pytest.mark.parametrize("share", [0.3, 0.5, None])
def test_a_robot_found_again_has_not_failed_unless_it_was_lost_most_of_the_time(share):
    assert failures(SOUND | {"lost_share": share}) == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"faulted": True, "reason": "the scan is 372 ms old"}, "372 ms old"),
        ({"not_begun": "there is no odometry"}, "it never drove: there is no odometry"),
        ({"lost": True, "lost_share": 1.0}, "was not localized on the map (100% of"),
        ({"lost_share": 0.6}, "for most of the drive the robot was not localized on the map (60%"),
        (
            {"docked": False, "docking": "its corridor is occupied"},
            "has not docked: its corridor is",
        ),
        ({"record_whole": False, "record_fault": "recording stopped: No space left"}, "No space"),
    ],
)
def test_each_failure_is_a_sentence(changed, words):
    (said,) = failures(SOUND | changed)
    assert words in said


@pytest.mark.parametrize(
    "cause", [{"faulted": True, "reason": "no scan"}, {"not_begun": "no scan"}, {}]
)
def test_a_map_is_doubted_only_where_nothing_else_kept_the_robot_from_being_localized(cause):
    *_, said = failures(SOUND | {"lost": True, "lost_share": 1.0} | cause)
    assert "was not localized on the map (100% of the time)" in said
    assert ("does the map fit" in said) == (not cause)


def test_the_summary_for_a_person_has_units_and_no_powers_of_ten():
    text = "\n".join(f"{name}: {value}" for name, value in rows(SOUND))
    assert "e-0" not in text
    assert "late 999" not in text
    assert "smallest clearance while moving: 0.123 m" in text
    assert "periods in time (within 2 ms): 99.91% of 2000" in text
    assert "latest period: 12.3 ms late" in text
    assert "record: a.mcap (whole)" in text


def test_in_simulated_time_no_lateness_is_reported():
    found = dict(rows(SOUND | {"scheduling": "simulated time"}))
    assert found["driven for"] == "40.0 s at 50 Hz"
    assert not [name for name in found if "period" in name]


def test_a_record_that_is_not_whole_is_marked_in_the_table():
    text = dict(rows(SOUND | {"record_whole": False, "record_dropped": 7}))["record"]
    assert text == "a.mcap (NOT WHOLE, 7 messages dropped)"


@pytest.mark.parametrize(
    ("number", "code"), [(errno.ENOSPC, 1), (errno.EFBIG, 1), (errno.EACCES, 2)]
)
@pytest.mark.parametrize("command", ["run minimal", "robot minimal --fast", "campaign lab"])
def test_a_full_disk_is_no_error_of_the_command_line_wherever_it_is_noticed(
    cohelm, monkeypatch, number, code, command
):
    def full(*_: object) -> None:
        try:
            raise OSError(number, os.strerror(number))
        except OSError as error:
            raise CohelmError("it can not be written: free some space") from error

    monkeypatch.setattr(single, "fresh", full)
    monkeypatch.setattr(load, "find", full)
    said = cohelm(*command.split())
    assert (said.code, said.err) == (code, "error: it can not be written: free some space\n")


@pytest.mark.slow
@pytest.mark.xdist_group("realtime")
def test_a_drive_whose_record_fills_the_disk_ends_with_status_1_and_the_reason(tmp_path):
    command = (
        sys.executable, "-m", "cohelm", "robot", "lab-guard", "--fast", "--for", "6", "--json",
    )  # fmt: skip
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)  # compiled by now
    full = subprocess.run(
        (*command, "--record", "full.mcap"), cwd=tmp_path, capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000)),
    )  # fmt: skip
    assert full.returncode == 1, full.stderr
    said = json.loads(full.stdout)
    assert said["record_whole"] is False
    assert "recording stopped: File too large" in said["record_fault"]
    assert said["failed"] == [f"the record is not whole: {said['record_fault']}"]
    assert "failed:" in full.stderr


def _drive(path, ranges, finish=True):
    model = load.robot("sally")
    lidar = model.lidar
    assert lidar is not None
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", 946_684_800_000_000_000), model)
        for k in range(40):
            made.write(Odometry(0.1 * k, Pose(0.02 * k, 0.0, 0.0), Twist(0.2, 0.0)))
            made.write(Scan(0.1 * k, k, np.full(lidar.beams, ranges), 0.0))
        if finish:
            made.finish()
        else:
            made.flush()


@pytest.mark.parametrize("ranges", [np.nan, np.inf])
def test_a_record_without_scans_makes_no_map(cohelm, tmp_path, monkeypatch, ranges):
    monkeypatch.setattr(mapping, "_SHOWN", 0.0)  # it is drawn again and again, as of a long drive
    _drive(tmp_path / "nothing.mcap", ranges)
    said = cohelm("map", "nothing.mcap", "--json")
    assert said.code == 2
    assert "not one of its" in said.err
    assert "has a return in it" in said.err
    assert not (tmp_path / "out").exists()


def test_a_map_of_a_record_that_was_cut_short_is_made_and_the_status_is_1(cohelm, tmp_path):
    _drive(tmp_path / "cut.mcap", 2.0, finish=False)
    said = cohelm("map", "cut.mcap", "--json")
    assert said.code == 1
    assert json.loads(said.out)["record_whole"] is False
    assert "is cut short or damaged" in said.err


def test_the_starting_time_is_not_negative_after_a_clock_change(monkeypatch):
    starting = output.Starting("the robot")
    monkeypatch.setattr(output.time, "time", lambda: 0.0)
    try:
        assert starting.text().endswith("(0 s)")
    finally:
        starting.over()


def test_without_a_terminal_a_long_job_is_not_silent(monkeypatch, capsys):
    monkeypatch.setattr(output, "_PROGRESS_EVERY", 0.05)
    with output.progress("starting") as show:
        show("episode 3 of 12", 0.25)
        time.sleep(0.2)
    said = capsys.readouterr().err
    assert "episode 3 of 12: 25% (0 s)" in said
    time.sleep(0.1)
    assert capsys.readouterr().err == ""  # it is over
