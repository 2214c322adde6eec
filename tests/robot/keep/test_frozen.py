"""A loop that freezes, wherever it freezes: the keeper hears and acts, and the robot stands."""

import multiprocessing
import os
import pickle
import signal
import time
from contextlib import contextmanager

import pytest

from cohelm.robot.keep.lines import LARGEST, line
from tests.robot.keep.frozen import PERIOD, SPEED, drive
from tests.robot.keep.robots import SALLY, Traced, Watch

pytestmark = pytest.mark.xdist_group("realtime")

STARTED = 120.0  # with nothing compiled, on a busy machine [s]
WATCHDOG = 0.1
STOPPING = SPEED * (WATCHDOG + PERIOD + SALLY.delay_s) + SPEED**2 / (2.0 * 2.0)
"""From the last command to standing: watchdog, one look of the keeper, delay, brakes [m]."""
SLACK = 0.02
"""... and 40 ms in which a busy machine may keep the keeper waiting [m]."""


class Frozen:
    """A small loop at work, in another process; what its keeper says."""

    def __init__(self, tmp_path, freezes: str, width: int, beams: int) -> None:
        self.watch = Watch(tmp_path / "trace")
        made = Traced(self.watch.path, width, beams)
        self._heard, theirs = line()
        context = multiprocessing.get_context("spawn")
        self._ours, told = context.Pipe()
        self.process = context.Process(target=drive, args=(made, told, theirs, freezes))
        self.process.start()
        theirs.close()
        told.close()
        assert self._ours.poll(STARTED)
        self.keeper: int = self._ours.recv()
        assert self._ours.poll(10.0)
        assert self._ours.recv() == "drives"
        self._said: list[str] = []

    def said(self, what: str, within: float) -> bool:
        """Whether the keeper says so."""
        end = time.monotonic() + within
        while not any(what in text for text in self._said):
            self._heard.settimeout(max(end - time.monotonic(), 1e-3))
            try:
                self._said.append(pickle.loads(self._heard.recv(LARGEST)).text)
            except TimeoutError:
                return False
        return True

    def close(self) -> None:
        self.process.kill()
        self.process.join()
        self.process.close()
        self._heard.close()
        self._ours.close()

    def state(self) -> str:
        with open(f"/proc/{self.process.pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0]

    def frozen(self) -> float:
        """Wait until it is; how far the robot had come."""
        end = time.monotonic() + 5.0
        while self.state() != "T":
            assert time.monotonic() < end
            time.sleep(0.001)
        moved = self.watch.now()
        assert moved.v > 0.9 * SPEED  # nothing else has stopped it before
        return moved.x


@contextmanager
def frozen(tmp_path, freezes: str, width: int = 0, beams: int = 720):
    made = Frozen(tmp_path, freezes, width, beams)
    try:
        yield made
    finally:
        made.close()
        for _ in range(100):
            if not os.path.exists(f"/proc/{made.keeper}"):
                break
            time.sleep(0.1)


@pytest.mark.parametrize(
    ("width", "beams"),
    [(0, 720), (64, 720), (640, 720), (1280, 720), (0, 100_000)],
    ids=["no camera", "small frames", "frames of 0.9 MB", "frames of 3.7 MB", "scans of 0.8 MB"],
)
def test_no_answer_makes_the_keeper_deaf_when_the_loop_does_not_take_it(tmp_path, width, beams):
    with frozen(tmp_path, "read", width, beams) as loop:
        at = loop.frozen()
        assert loop.said("no sound command for more than 100 ms", 1.0)
        assert loop.said("stands, ", 2.0)
        assert loop.watch.now().v == 0.0
        assert loop.watch.now().x - at < STOPPING + SLACK
