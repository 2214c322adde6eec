"""`import cohelm`: light, whole, typed, and every example in its docstrings true."""

import doctest
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cohelm
from cohelm.core.errors import CohelmError
from tests.ports.adapters import recorded

HEAVY = ("numpy", "numba", "pydantic", "matplotlib", "scipy", "yaml", "mcap", "mujoco", "typer")


def test_importing_cohelm_loads_nothing_heavy():
    code = f"import sys, cohelm; print([m for m in {HEAVY} if m in sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


WITHOUT = {
    "the recorder": "cohelm.drive.recorder",
    "the live view": "cohelm.drive.live",
    "the station": "cohelm.station.serve, cohelm.station.robot_link",
    "a stick's process": "cohelm.link.stick, cohelm.link.sticks.choose",
    "who reads a record": "cohelm.record.read",
    "a robot of one's own": "cohelm.robot.base, cohelm.robot.model",
    "the gate itself": "cohelm.robot.gate.gate, cohelm.robot.keep.processes",
}
"""Who needs no compiled code, and what their processes import."""


def test_processes_that_compute_nothing_do_not_import_the_compiler():
    """numba takes a third of a second to import, in each of the processes that begin a drive."""
    lines = [f"import {of}; print({who!r}, 'numba' in sys.modules)" for who, of in WITHOUT.items()]
    code = "\n".join(["import sys", *lines])
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines() == [f"{who} False" for who in WITHOUT]


def test_the_loops_process_imports_nothing_that_writes_records_or_serves_viewers():
    """That takes a fifth of a second, and other processes do it."""
    of = "cohelm.drive.session, cohelm.drive.teleop_server, cohelm.drive.robot_process"
    heavy = ("mcap", "rosbags", "websockets")
    code = f"import sys, {of}; print([m for m in {heavy} if m in sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


def test_no_name_is_missing_unsaid_or_unknown():
    assert list(cohelm.__all__) == sorted(cohelm.__all__)
    assert set(cohelm.__all__) == set(cohelm._HOME)
    assert set(cohelm.__all__) <= set(dir(cohelm))
    for name in cohelm.__all__:
        assert getattr(cohelm, name).__doc__, name
    with pytest.raises(AttributeError, match="has no attribute 'sally'"):
        cohelm.sally  # noqa: B018


def test_a_type_checker_sees_the_names_that_exist_at_run_time():
    """Every name stands among the imports for type checkers, from the home it has."""
    text = Path(cohelm.__file__).read_text()
    for name, home in cohelm._HOME.items():
        lines = [line for line in text.splitlines() if f"from cohelm.{home} import" in line]
        assert any(name in line.replace(",", " ").split() for line in lines), name


UNTRIED = {"Record", "drive", "read_record"}
"""Their examples need a record or a robot."""


@pytest.mark.parametrize("name", sorted(set(cohelm.__all__) - UNTRIED))
def test_no_example_in_a_docstring_is_wrong(name):
    finder, runner = doctest.DocTestFinder(recurse=True), doctest.DocTestRunner(verbose=False)
    found = [t for t in finder.find(getattr(cohelm, name), name, globs={}) if t.examples]
    assert found
    for test in found:
        test.globs = {"math": math}
        assert runner.run(test).failed == 0


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("drive") / "drive.mcap", 1.0)


def test_a_record_of_a_drive_is_read_into_columns(drive):
    record = cohelm.read_record(drive)
    assert record.kind == "drive"
    assert len(record.table["t"]) == 50
    assert np.allclose(np.diff(record.table["t"]), 0.02)
    assert set(record.table["applied_v"]) == {0.3}
    assert record.events[-1][1] == "loop: the end"
    stamps = [t for t, _ in record.scans]
    assert np.allclose(np.diff(stamps), 0.1)
    assert stamps[0] == pytest.approx(0.0, abs=1e-6)
    assert record.scans[0][1].shape == (720,)


def test_a_record_of_a_run_is_read_into_columns(tmp_path):
    from cohelm.record.write import Recorder

    result = cohelm.run("lab-track", changes=["simulation.duration_s=2"])
    with Recorder(tmp_path / "run.mcap") as recorder:
        recorder.write(result.trace)
    record = cohelm.read_record(tmp_path / "run.mcap")
    assert record.kind == "run"
    (tmp_path / "run.mcap").rename(tmp_path / "record.mcap")
    assert cohelm.read_record(tmp_path).table.keys() == record.table.keys()
    for name, column in result.table().items():
        assert np.array_equal(record.table[name], column, equal_nan=column.dtype.kind == "f")
    assert "lab-track" in record.scenario


def test_a_record_that_is_not_whole_says_so(drive, tmp_path):
    """Cut short, or with one byte changed in its middle."""
    from cohelm.record.read import IncompleteRecord

    whole, path = drive.read_bytes(), tmp_path / "drive.mcap"
    changed = bytearray(whole)
    changed[len(whole) // 2] ^= 1
    for data in (whole[: len(whole) // 2], changed):
        path.write_bytes(data)
        with pytest.warns(IncompleteRecord, match=r"is not whole .* is read up to t = \d") as said:
            record = cohelm.read_record(path)
        assert record.damage
        assert f"({record.damage})" in str(said[0].message)
        assert 0 < len(record.table["t"]) < 50
    assert cohelm.read_record(drive).damage == ""


def test_a_file_that_is_no_record_is_reported(tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"not a record")
    for path, said in ((tmp_path / "no.mcap", "not an MCAP"), (tmp_path / "gone", "can not be")):
        with pytest.raises(CohelmError, match=said):
            cohelm.read_record(path)


@pytest.mark.parametrize("nothing", [None, 5, b"drive.mcap", []])
@pytest.mark.parametrize("reads", ["read_record", "load_scenario", "load_robot"])
def test_what_names_no_file_is_reported(reads, nothing):
    with pytest.raises(CohelmError, match=f"name.*got {type(nothing).__name__}"):
        getattr(cohelm, reads)(nothing)
