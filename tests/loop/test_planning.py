"""The planner in another process never delays the loop."""

import os
import signal
import time
from contextlib import contextmanager
from typing import Any

import pytest

from cohelm.loop.planning import MAX_PLAN_AGE, InProcessPlanner, RemotePlanner

LONG = 2_000_000  # more than a socket holds


def wordy(task: Any) -> Any:
    """A planner whose plans are long."""
    return task[:LONG]


def planned(planning: RemotePlanner, now: float = 0.0) -> Any:
    """The plan, when it comes."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        if (made := planning.plan(now)) is not None:
            return made
        time.sleep(0.005)
    raise AssertionError("there was no plan")


@pytest.fixture(scope="module")
def process():
    """One for all tests but the one that kills it."""
    made = RemotePlanner(wordy)  # type: ignore[arg-type]
    yield made
    made.close()


@pytest.fixture
def planning(process):
    """That one, idle again."""
    end = time.monotonic() + 60.0
    while process.busy and time.monotonic() < end:
        process.plan(0.0)
        time.sleep(0.005)
    assert not process.busy
    return process


def test_tasks_and_plans_larger_than_the_socket_buffer_arrive_complete(planning):
    for fill in (b"a", b"b"):
        assert planning.offer(0.0, 2 * LONG * fill)
        assert not planning.offer(0.0, b"one at a time")
        assert planned(planning) == LONG * fill
    assert not planning.broken


def test_the_loop_does_not_wait_for_a_planner_stopped_in_its_answer(planning):
    assert planning.offer(0.0, LONG * b"a")
    child = planning._child
    while child._outgoing:
        child._exchange()
    with child._line.dup() as line:
        line.setblocking(True)
        child._incoming += line.recv(1000)  # a first part of the answer is there, and no more
        line.setblocking(False)  # the two share this
    os.kill(planning._child._process.pid, signal.SIGSTOP)
    try:
        for _ in range(20):
            assert planning.plan(0.0) is None
    finally:
        os.kill(planning._child._process.pid, signal.SIGCONT)
    assert planned(planning) == LONG * b"a"


def test_a_planner_that_died_leaves_the_loop_without_new_plans():
    planning = RemotePlanner(wordy)  # type: ignore[arg-type]
    os.kill(planning._child._process.pid, signal.SIGKILL)
    end = time.monotonic() + 60.0
    while not planning.broken and time.monotonic() < end:
        planning.offer(0.0, LONG * b"a")
        planning.plan(0.0)
    assert planning.broken
    assert planning.plan(0.0) is None
    planning.close()


@contextmanager
def stopped(planning):
    """The planner stands still."""
    os.kill(planning._child._process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(planning._child._process.pid, signal.SIGCONT)


def asked(planning, begin: float, seconds: float) -> Any:
    """Ask for the plan 50 times a second of the robot's time; when there was one or it was late."""
    for k in range(round(50 * seconds) + 1):
        made = planning.plan(begin + k / 50.0)
        if made is not None or planning.late:
            return made, k / 50.0
    return None, None


def test_a_hanging_planner_is_reported_after_its_timeout(planning):
    assert planning.offer(0.0, b"a")
    assert planned(planning) == b"a"
    with stopped(planning):
        assert planning.offer(1.0, b"b")
        assert asked(planning, 1.0, 60.0) == (None, pytest.approx(MAX_PLAN_AGE, abs=0.03))
        assert not planning.offer(10.0, b"c")  # it has one still
        assert not planning.broken


def test_a_plan_that_comes_too_late_is_not_used_and_the_next_one_is(planning):
    with stopped(planning):
        assert planning.offer(0.0, b"old")
        asked(planning, 0.0, 10.0)
        assert planning.late
    end = time.monotonic() + 60.0
    while planning.busy and time.monotonic() < end:
        assert planning.plan(10.0) is None
        time.sleep(0.005)
    assert planning.offer(10.1, b"new")
    assert planned(planning, 10.2) == b"new"
    assert not planning.late


def test_a_plan_that_is_not_collected_in_time_is_not_used(planning):
    """The mode was another one meanwhile."""
    assert planning.offer(0.0, b"old")
    time.sleep(0.5)
    end = time.monotonic() + 60.0
    while planning.busy and time.monotonic() < end:
        assert planning.plan(100.0) is None
        time.sleep(0.005)
    assert not planning.late
    assert planning.offer(100.0, b"new")
    assert planned(planning, 100.2) == b"new"


def test_a_plan_made_at_once_is_used_after_its_time_and_not_after_a_pause():
    made = InProcessPlanner(wordy, takes=0.04)  # type: ignore[arg-type]
    for pause, used in ((0.04, b"a"), (MAX_PLAN_AGE, b"a"), (60.0, None)):
        assert made.offer(10.0, b"a")  # type: ignore[arg-type]
        assert made.plan(10.02) is None
        assert made.plan(10.0 + pause) == used
        assert not made.busy
