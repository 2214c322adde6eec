"""What works for a robot's process: deaf to a terminal, and gone with it unless it was let go."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

WITHIN = 10.0  # on a busy machine [s]


def children(pid: int) -> dict[str, int]:
    """The PIDs of a process's children of cohelm, by name."""
    found: dict[str, int] = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            text = status.read_text()
            name = text.partition("\n")[0].partition("\t")[2]
            if f"PPid:\t{pid}\n" in text and name.startswith("cohelm"):
                found[name] = int(status.parent.name)
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("how", ["bound", "free"])
def test_a_child_process_ignores_terminal_signals_and_ends_with_its_parent(how):
    parent = subprocess.Popen(
        [sys.executable, "-m", "tests.robot.keep.children", how],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert parent.stdout is not None
    assert parent.stderr is not None
    child = int(parent.stdout.readline())
    try:
        os.kill(child, signal.SIGINT)  # it has only just begun
        assert parent.stderr.readline() == "ready\n"
        os.kill(child, signal.SIGINT)
        os.kill(child, signal.SIGHUP)
        time.sleep(0.1)
        assert alive(child)

        parent.kill()
        parent.wait()
        end = time.monotonic() + (WITHIN if how == "bound" else 0.3)
        while alive(child) and time.monotonic() < end:
            time.sleep(0.01)
        assert alive(child) == (how == "free")
    finally:
        parent.kill()
        if alive(child):
            os.kill(child, signal.SIGTERM)  # that it does hear
        said = parent.communicate()[1]
    assert said == ""
    end = time.monotonic() + WITHIN
    while alive(child):
        assert time.monotonic() < end
        time.sleep(0.01)
