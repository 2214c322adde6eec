"""What plans in another process never holds the loop up, wherever that process is stopped."""

import os
import signal
import time
from typing import Any

import pytest

from cohelm.loop.planning import Elsewhere

LONG = 2_000_000  # more than a socket holds


def wordy(task: Any) -> Any:
    """A planner whose plans are long."""
    return task[:LONG]


def planned(planning: Elsewhere) -> Any:
    """The plan, when it comes."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        if (made := planning.plan(0.0)) is not None:
            return made
        time.sleep(0.005)
    raise AssertionError("there was no plan")


@pytest.fixture
def planning():
    made = Elsewhere(wordy)  # type: ignore[arg-type]
    yield made
    made.close()


def test_tasks_and_plans_longer_than_the_line_holds_arrive_whole(planning):
    for fill in (b"a", b"b"):
        assert planning.offer(0.0, 2 * LONG * fill)
        assert not planning.offer(0.0, b"one at a time")
        assert planned(planning) == LONG * fill
    assert not planning.broken


def test_a_planner_stopped_in_the_middle_of_its_answer_is_not_waited_for(planning):
    assert planning.offer(0.0, LONG * b"a")
    while planning._going:
        planning._exchange()
    with planning._line.dup() as line:
        line.setblocking(True)
        planning._coming += line.recv(1000)  # a first part of the answer is there, and no more
        line.setblocking(False)  # the two share this
    os.kill(planning._process.pid, signal.SIGSTOP)
    try:
        for _ in range(20):
            assert planning.plan(0.0) is None
    finally:
        os.kill(planning._process.pid, signal.SIGCONT)
    assert planned(planning) == LONG * b"a"


def test_a_planner_that_died_leaves_the_loop_without_new_plans(planning):
    os.kill(planning._process.pid, signal.SIGKILL)
    end = time.monotonic() + 60.0
    while not planning.broken and time.monotonic() < end:
        planning.offer(0.0, LONG * b"a")
        planning.plan(0.0)
    assert planning.broken
    assert planning.plan(0.0) is None
