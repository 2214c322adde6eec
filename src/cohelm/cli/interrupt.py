"""Ctrl-C between two steps, never in the middle of one.

numba (0.68) converts results of compiled code to Python objects by calls that it does not expect
to fail: an interrupt there ends the process with a segmentation fault, and truncates the record. So
it is delayed by a moment.
"""

from __future__ import annotations

import signal
from types import FrameType

_MOMENT = 0.003  # [s]


def patient() -> None:
    """Take Ctrl-C as `KeyboardInterrupt`, as Python does, but not inside numba.

    A process that does not heed Ctrl-C, or has its own way with it, is left as it is.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGALRM, interrupted)
        signal.signal(signal.SIGINT, interrupted)


def settled() -> None:
    """The command is over: drop an interrupt that was put off, as nothing could handle it."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def interrupted(_: int, frame: FrameType | None) -> None:
    """The handler: raises, or comes again as an alarm, however often, until it can."""
    if frame is not None and _inside(frame.f_code.co_filename):
        signal.setitimer(signal.ITIMER_REAL, _MOMENT)
        return
    raise KeyboardInterrupt


def _inside(file: str) -> bool:
    """Whether code of this file runs while numba makes an answer: its own, that of named tuples,
    which is made from text, or this one's."""
    return file.startswith("<") or "/numba/" in file or file == __file__
