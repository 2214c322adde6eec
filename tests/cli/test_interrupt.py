"""Ctrl-C is never raised where numba makes an answer: it would end the process with a fault."""

import signal
import sys

import pytest

from cohelm.cli.interrupt import interrupted

NOTHING = 0  # a signal that does nothing, to come again


def test_in_code_of_ours_it_is_raised():
    with pytest.raises(KeyboardInterrupt):
        interrupted(signal.SIGINT, sys._getframe())


@pytest.mark.parametrize("file", ["<string>", "/somewhere/site-packages/numba/core/serialize.py"])
def test_where_an_answer_is_made_it_is_put_off(file):
    frames: list = []
    exec(compile("frames.append(get())", file, "exec"), {"frames": frames, "get": sys._getframe})
    interrupted(NOTHING, frames[0])
