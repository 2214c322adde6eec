"""Where code by others failed: a driver, or a law, that is no part of this package."""

from __future__ import annotations

import traceback
from pathlib import Path
from traceback import FrameSummary, StackSummary, TracebackException

_PACKAGE = Path(__file__).resolve().parents[1]
_IMPORTING = "<frozen importlib"


def others_frames(frames: StackSummary) -> list[FrameSummary]:
    """Those that are neither of this package nor of Python's import."""
    return [
        one
        for one in frames
        if not Path(one.filename).is_relative_to(_PACKAGE)
        and not one.filename.startswith(_IMPORTING)
    ]


def others_traceback(error: BaseException) -> str:
    """As Python prints it, causes too, with the frames of others' code only."""
    try:
        found = TracebackException.from_exception(error)
        _keep_others(found)
        return "".join(found.format()).rstrip()
    except Exception:  # of an error that can not be printed: its author's mistake, too
        kept = others_frames(traceback.extract_tb(error.__traceback__))
        return "".join((*traceback.format_list(kept), type(error).__name__))


def _keep_others(found: TracebackException) -> None:
    found.stack = StackSummary.from_list(others_frames(found.stack))
    for one in (found.__cause__, found.__context__, *(found.exceptions or ())):
        if one is not None:
            _keep_others(one)
