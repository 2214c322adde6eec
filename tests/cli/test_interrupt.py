"""Ctrl-C is never raised where numba makes an answer: it would end the process with a fault."""

import signal
import sys
import time

import pytest

from cohelm.cli.interrupt import interrupted


@pytest.fixture(autouse=True)
def handled():
    before = {s: signal.signal(s, interrupted) for s in (signal.SIGINT, signal.SIGALRM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def frames_of(file: str) -> dict:
    """A function whose code is in this file: it is interrupted at once, and stays for a while."""
    names: dict = {"signal": signal, "time": time}
    source = """
def busy(seconds):
    end = time.monotonic() + seconds
    signal.raise_signal(signal.SIGINT)
    while time.monotonic() < end:
        sum(range(50))
"""
    exec(compile(source, file, "exec"), names)
    return names


def test_in_code_of_ours_it_is_raised():
    with pytest.raises(KeyboardInterrupt):
        interrupted(signal.SIGINT, sys._getframe())


@pytest.mark.parametrize("file", ["<string>", "/somewhere/site-packages/numba/core/serialize.py"])
def test_where_an_answer_is_made_it_is_put_off_until_that_is_done_and_never_lost(file):
    busy, done = frames_of(file)["busy"], False
    try:
        busy(0.1)
        done = True
        time.sleep(5.0)
    except KeyboardInterrupt:
        assert done
    else:
        pytest.fail("it was lost")
