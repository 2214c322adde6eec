"""Who may end a drive, and who has said that he will not."""

import os
import signal

import pytest

from cohelm.drive.operate import ended


@pytest.mark.parametrize(
    ("number", "before", "said"),
    [
        (signal.SIGINT, signal.default_int_handler, "Ctrl-C"),
        (signal.SIGTERM, signal.SIG_DFL, "told to terminate"),
        (signal.SIGHUP, signal.SIG_DFL, "the terminal is gone"),
        (signal.SIGHUP, signal.SIG_IGN, ""),  # nohup
    ],
)
def test_a_signal_becomes_a_wish_unless_the_drive_was_told_not_to_hear_it(number, before, said):
    then = signal.signal(number, before)
    try:
        with ended() as end:
            end.heed()
            os.kill(os.getpid(), number)
            assert end.asked == said
        assert signal.getsignal(number) == before
    finally:
        signal.signal(number, then)
