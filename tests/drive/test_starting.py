"""Ctrl-C while a robot starts."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.drive.faults import CORRIDOR

STARTED = 120.0  # on a busy machine [s]
AT_ONCE = 2.0  # on a busy machine [s]
IMPORTED = 30.0  # what has only just been started finds out when it is there, on a busy machine [s]


class Started:
    """A command in a session of its own, as in a terminal of its own."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "cohelm", *arguments], stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip

    def processes(self) -> int:
        """How many there are of it."""
        count = 0
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                state, _, group = stat.read_text().rsplit(")", 1)[1].split()[:3]
            except OSError:
                continue
            count += int(group) == self.process.pid and state != "Z"
        return count

    def end(self) -> str:
        """See that nothing is left of it; what it said."""
        end = time.monotonic() + IMPORTED
        while self.processes() and time.monotonic() < end:
            time.sleep(0.05)
        left = self.processes()
        if left:
            os.killpg(self.process.pid, signal.SIGKILL)
        said = self.process.communicate()[1]
        assert not left
        return said


def test_ctrl_c_during_the_start_ends_all_processes_at_once():
    robot = Started("robot", str(CORRIDOR))
    try:
        end = time.monotonic() + STARTED
        while robot.processes() < 3:  # the gate process is being started
            assert time.monotonic() < end
            time.sleep(0.1)
        time.sleep(0.3)
        os.killpg(robot.process.pid, signal.SIGINT)  # as a terminal does
        assert robot.process.wait(AT_ONCE) == -signal.SIGINT  # 130 in a shell
    finally:
        said = robot.end()
    assert "Traceback" not in said, said
