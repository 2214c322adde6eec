"""Paths are checked in a process of its own, which may hang or die."""

import os
import signal
import threading
import time

import numpy as np

from cohelm.core.types import Pose
from cohelm.drive import path_check_process
from cohelm.drive.path_check import CheckedPath, PathChecker
from cohelm.drive.path_check_process import RemoteChecking
from tests.link.ends import until

STARTED = 240.0  # with nothing compiled, on a busy machine [s]
OUTLINE = np.array([(-0.36, -0.29), (0.36, -0.29), (0.36, 0.29), (-0.36, 0.29)])
JUDGE = PathChecker(0.5, OUTLINE, np.empty((0, 2)), np.empty((0, 2)))
WAY, HERE = np.array([(1.0, 0.0), (3.0, 0.5)]), Pose(0.0, 0.0, 0.0)


class Sleepy:
    """A judge that never comes to an end, but for the way with which it is warmed up."""

    def __call__(self, points, pose) -> CheckedPath:
        if points[1, 0] > 2.5:
            time.sleep(60.0)
        return JUDGE(points, pose)


def checked_path(process: RemoteChecking) -> CheckedPath:
    until(lambda: process.ready, STARTED)
    process.begin(time.monotonic(), WAY, HERE)
    assert not process.ready
    said = []
    until(lambda: (said.append(process.result(time.monotonic())), said[-1])[1], STARTED)
    return said[-1]


def test_a_dead_worker_is_replaced_and_its_job_is_answered(monkeypatch):
    monkeypatch.setattr(path_check_process, "_AGAIN", 0.2)
    process = RemoteChecking(JUDGE)
    try:
        assert checked_path(process).reference is not None
        os.kill(process._child._process.pid, signal.SIGSTOP)
        process.begin(time.monotonic(), WAY, HERE)
        assert process.result(time.monotonic()) is None
        os.kill(process._child._process.pid, signal.SIGKILL)
        said = []
        until(lambda: (said.append(process.result(time.monotonic())), said[-1])[1])
        assert said[-1].why == "it could not be checked: send it again"
        assert checked_path(process).reference is not None
    finally:
        process.close()
    assert process._child is None


def test_a_check_that_hangs_is_given_up_and_no_call_blocks(monkeypatch):
    monkeypatch.setattr(path_check_process, "WITHIN", 0.5)
    monkeypatch.setattr(path_check_process, "_AGAIN", 0.2)
    process = RemoteChecking(Sleepy())
    try:
        began = time.monotonic()
        until(lambda: process.ready, STARTED)
        process.begin(time.monotonic(), WAY, HERE)
        longest, said = 0.0, None
        while said is None:
            before = time.thread_time()
            said = process.result(time.monotonic())
            longest = max(longest, time.thread_time() - before)
            time.sleep(0.005)
            assert time.monotonic() - began < STARTED
        assert said.why == "it could not be checked within 0 s"
        assert longest < 0.05
        assert not process.ready
    finally:
        process.close()


def test_a_process_that_was_given_up_is_ended_on_close():
    """Its replacing is left out, as all that has not begun then; its end is not."""
    process, held_up = RemoteChecking(JUDGE), threading.Event()
    child = process._child
    process._jobs.do(lambda: held_up.wait(STARTED) and None)
    process._busy = child.gone = True
    assert process.result(time.monotonic()).why == "it could not be checked: send it again"
    threading.Timer(0.2, held_up.set).start()
    process.close()
    assert child._process.exitcode is not None


def test_closing_does_not_wait_for_the_next_process(monkeypatch):
    monkeypatch.setattr(path_check_process, "_AGAIN", 60.0)
    monkeypatch.setattr(path_check_process, "_ENDS", 30.0)
    process = RemoteChecking(JUDGE)
    process._child.gone = True
    until(lambda: not process.ready and process._child is None, STARTED)
    began = time.monotonic()
    process.close()
    assert time.monotonic() - began < 20.0
    assert process._given_up._process.exitcode is not None


def test_a_process_that_starts_after_close_is_ended(monkeypatch):
    """On a busy machine `close` does not wait for it."""
    process = RemoteChecking(Sleepy())
    began, goes_on, ended = threading.Event(), threading.Event(), threading.Event()

    class Late:
        def end(self) -> None:
            ended.set()

    def slowly(_: object) -> Late:
        began.set()
        goes_on.wait(STARTED)
        return Late()

    monkeypatch.setattr(path_check_process, "_started", slowly)
    process._replace(process._child, 0.0)
    assert began.wait(STARTED)
    process._jobs.close = lambda within: False  # as where a second is not enough
    process.close()
    goes_on.set()
    assert ended.wait(STARTED)
