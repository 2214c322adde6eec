"""The command as a process: signals, pipes, full disks, and environments that are not kind."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cohelm.core.interrupts import INTERRUPTS
from tests.few import first

COHELM = (sys.executable, "-m", "cohelm")


def process(*arguments: str, **options) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        (*COHELM, *arguments), capture_output=True, text=True, check=False, **options
    )


@pytest.mark.parametrize("sent", first(INTERRUPTS))
def test_ctrl_c_in_mid_run_ends_with_130_and_a_record_that_is_replayed_so_far(
    tmp_path, sent, cohelm
):
    record = tmp_path / "cut" / "record.mcap"
    process = subprocess.Popen(
        (*COHELM, "run", "lab-shared", "--set", "simulation.duration_s=3000", "--out", "cut"),
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    deadline = time.monotonic() + 120.0
    while not (record.exists() and record.stat().st_size > 100_000):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline, "the run does not start"
        time.sleep(0.01)
    process.send_signal(sent)
    out, err = process.communicate()
    assert process.returncode == 130
    assert out == ""
    assert err == "interrupted; see what was run: cohelm replay cut/record.mcap\n"
    replayed = cohelm("replay", "cut/record.mcap", "--json")
    assert replayed.code == 1
    said = json.loads(replayed.out)
    assert 1.0 < said["duration_s"] < 3000.0
    assert said["record_whole"] is False
    assert "stopped by KeyboardInterrupt" in said["record_fault"]
    assert replayed.err.startswith("warning: cut/record.mcap is not whole")
    assert "stopped by KeyboardInterrupt" in replayed.err


@pytest.mark.slow
def test_a_disk_that_fills_up_during_a_run_is_reported_and_the_rest_is_playable(tmp_path):
    process("run", "minimal", cwd=tmp_path)  # so that nothing is compiled onto the full disk
    full = process(
        "run", "lab-shared", "--out", "full", "--json", cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000)),
    )  # fmt: skip
    assert full.returncode == 1
    assert full.stdout == ""
    assert full.stderr.startswith("error: full/record.mcap: recording stopped")
    assert full.stderr.count("\n") == 1
    assert "free some space" in full.stderr
    replayed = process("replay", "full", "--json", cwd=tmp_path)
    assert replayed.returncode == 1
    assert json.loads(replayed.stdout)["duration_s"] > 5.0
    assert "is not whole" in replayed.stderr


@pytest.mark.slow  # nobody comes to harm by what it says
def test_a_reader_that_has_seen_enough_ends_the_command_in_silence():
    process = subprocess.Popen(
        (*COHELM, "schema"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    process.stderr.close()
    assert process.wait() == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_an_output_that_can_not_be_written_is_reported_without_a_traceback():
    with Path("/dev/full").open("w") as full:
        said = subprocess.run(
            (*COHELM, "schema"), stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert said.returncode == 1
    assert said.stderr.startswith("error: what is printed")
    assert "can not be written (No space left on device)" in said.stderr
    assert said.stderr.count("\n") == 1


@pytest.mark.slow  # compiles everything twice
def test_without_a_cache_with_assertions_off_and_in_ascii_a_run_is_the_same(tmp_path):
    folder = tmp_path / "ein Ordner, é 車"
    folder.mkdir()
    (folder / "mein weg.yaml").write_text(
        "name: wég\nreference: {waypoints_m: [[0, 0], [1, 0]]}\n", encoding="utf-8"
    )
    harsh = {
        "COHELM_CACHE_DIR": "/dev/null/no", "PYTHONOPTIMIZE": "1", "PYTHONIOENCODING": "ascii",
        "LC_ALL": "C", "NO_COLOR": "1", "PYTHONWARNINGS": "error", "COLUMNS": "20",
    }  # fmt: skip
    run = ("run", "mein weg.yaml", "--json", "--out")
    kind = process(*run, "a b", cwd=folder)
    hard = process(*run, "c d", cwd=folder, env={**os.environ, **harsh}, stdin=subprocess.DEVNULL)
    assert (kind.returncode, kind.stderr) == (0, "")
    assert (hard.returncode, hard.stderr) == (0, "")
    first, second = json.loads(kind.stdout), json.loads(hard.stdout)
    assert (first.pop("out"), second.pop("out")) == ("a b", "c d")
    assert first == second
    table = process("replay", "c d", cwd=folder, env={**os.environ, **harsh})
    assert (table.returncode, table.stderr) == (0, "")
    assert table.stdout.isascii()
    assert "\x1b" not in table.stdout


def test_ctrl_c_while_the_command_still_imports_ends_it_without_a_traceback(tmp_path):
    code = "from cohelm.__main__ import main; main()"
    process = subprocess.Popen(
        (sys.executable, "-X", "importtime", "-c", code, "run", "minimal"), cwd=tmp_path,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    said: list[str] = []
    for line in process.stderr:  # a line for each module that was imported
        said.append(line)
        if "click" in line or "typer" in line:
            break
    process.send_signal(signal.SIGINT)
    said.append(process.stderr.read())
    process.communicate()
    assert process.returncode in (-signal.SIGINT, 130)
    assert "Traceback" not in "".join(said)
    assert not list(tmp_path.iterdir())


def test_in_the_background_ctrl_c_stays_ignored():
    code = "import signal; import cohelm.__main__; print(repr(signal.getsignal(signal.SIGINT)))"
    said = subprocess.run(
        (sys.executable, "-c", code), capture_output=True, text=True, check=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    assert "SIG_IGN" in said.stdout
