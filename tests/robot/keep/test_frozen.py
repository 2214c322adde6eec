"""A loop that freezes, wherever it freezes: its gate process hears and acts, and it stands."""

import multiprocessing
import os
import pickle
import signal
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cohelm.robot.keep.record_pipe import LARGEST, line
from tests.robot.keep.frozen import PERIOD, SPEED, drive
from tests.robot.keep.robots import SALLY, Traced, Watch

pytestmark = pytest.mark.xdist_group("realtime")

STARTED = 120.0  # with nothing compiled, on a busy machine [s]
WATCHDOG = 0.1
STOPPING = SPEED * (WATCHDOG + PERIOD + SALLY.delay_s) + SPEED**2 / (2.0 * 2.0)
"""From the last command to standing: watchdog, one look of the gate process, delay, brakes [m]."""
SLACK = 0.02
"""... and 40 ms in which a busy machine may keep the gate process waiting [m]."""


class Frozen:
    """A small loop at work, in another process; what its gate process says."""

    def __init__(self, tmp_path, wrong: str, width: int, beams: int) -> None:
        self.watch = Watch(tmp_path / "trace")
        made = Traced(self.watch.path, width, beams)
        self._heard, theirs = line()
        context = multiprocessing.get_context("spawn")
        self._ours, told = context.Pipe()
        self.process = context.Process(target=drive, args=(made, told, theirs, wrong))
        self.process.start()
        theirs.close()
        told.close()
        assert self._ours.poll(STARTED)
        self.gated: int = self._ours.recv()
        assert self._ours.poll(10.0)
        assert self._ours.recv() == "drives"
        self._said: list[str] = []

    def said(self, what: str, within: float) -> bool:
        """Whether the gate process says so."""
        end = time.monotonic() + within
        while not any(what in text for text in self._said):
            self._heard.settimeout(max(end - time.monotonic(), 1e-3))
            try:
                self._said.append(pickle.loads(self._heard.recv(LARGEST)).text)
            except TimeoutError:
                return False
        return True

    def stands(self, by: float) -> None:
        """The gate process says so in time, and the robot has come no farther than this."""
        assert self.said("no valid command for more than 100 ms", 1.0)
        assert self.said("stands, ", 2.0)
        end = time.monotonic() + 0.5  # it says so when next to nothing is left
        while self.watch.now().v != 0.0:
            assert time.monotonic() < end, self.watch.now()
            time.sleep(0.001)
        assert self.watch.now().x < by

    def hears(self) -> Any:
        """What the loop says next."""
        assert self._ours.poll(5.0)
        return self._ours.recv()

    def close(self) -> None:
        self.process.kill()
        self.process.join()
        self.process.close()
        self._heard.close()
        self._ours.close()

    def state(self) -> str:
        stat = Path(f"/proc/{self.process.pid}/stat").read_text()
        return stat.rpartition(")")[2].split()[0]

    def frozen(self) -> float:
        """Wait until it is; how far the robot had come."""
        end = time.monotonic() + 5.0
        while self.state() != "T":
            assert time.monotonic() < end
            time.sleep(0.001)
        return self.came()

    def came(self) -> float:
        """How far the robot has come, driving."""
        moved = self.watch.now()
        assert moved.v > 0.9 * SPEED  # nothing else has stopped it before
        return moved.x


@contextmanager
def frozen(tmp_path, wrong: str, width: int = 0, beams: int = 720):
    made = Frozen(tmp_path, wrong, width, beams)
    try:
        yield made
    finally:
        made.close()
        for _ in range(100):
            if not Path(f"/proc/{made.gated}").exists():
                break
            time.sleep(0.1)


@pytest.mark.parametrize(
    ("width", "beams"),
    [
        pytest.param(640, 720, id="frames of 0.9 MB"),
        pytest.param(0, 720, id="no camera", marks=pytest.mark.slow),
        pytest.param(64, 720, id="small frames", marks=pytest.mark.slow),
        pytest.param(1280, 720, id="frames of 3.7 MB", marks=pytest.mark.slow),
        pytest.param(0, 100_000, id="scans of 0.8 MB", marks=pytest.mark.slow),
    ],
)
def test_no_answer_that_the_loop_does_not_take_makes_the_gate_deaf(tmp_path, width, beams):
    with frozen(tmp_path, "read", width, beams) as loop:
        at = loop.frozen()
        loop.stands(at + STOPPING + SLACK)
        os.kill(loop.process.pid, signal.SIGCONT)
        assert loop.hears() == ("AUTOMATIC", True)  # the answer that lay there
        time.sleep(0.3)  # and it goes on proposing
        assert loop.watch.now().v == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("call", ["propose", "truth"])
def test_in_whatever_call_the_loop_freezes_the_robot_stands(tmp_path, call):
    with frozen(tmp_path, call) as loop:
        at = loop.frozen()
        loop.stands(at + STOPPING + SLACK)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["only reads", "listens no more"])
def test_a_loop_that_requests_modes_but_never_proposes_commands_does_not_drive(tmp_path, wrong):
    with frozen(tmp_path, wrong, width=640) as loop:
        at = loop.came()
        loop.stands(at + SPEED * 0.3 + STOPPING + SLACK)  # ten periods after it said it drives
