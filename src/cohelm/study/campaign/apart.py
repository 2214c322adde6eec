"""Laws by others drive in a process of their own: one that never answers, or crashes, ends that.

Compiled code can not be interrupted, so the process is killed; the next drive has a new one.
"""

from __future__ import annotations

import math
import multiprocessing
import pickle
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from multiprocessing.sharedctypes import RawArray
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.core.trace import Trace
from cohelm.core.types import Twist
from cohelm.robot.keep.child import Child
from cohelm.robot.keep.processes import killed_with_parent, lead_group
from cohelm.sim.setup import Setup
from cohelm.study.campaign.result import FAILS, fault_of
from cohelm.study.controlled import Controller, Observation, driven

_FIRST = 300.0
"""Until a law's first answer in an episode: it may import and compile for that [s]."""
_LATER = 60.0
"""From one answer to the next, which on a robot would be one period [s]."""
_DUE, _T = 0, 1
"""In shared memory: by when the next answer has to come, and of which time in the episode."""
_LOOK = 0.2  # between looks whether it has [s]

_held = threading.local()
"""Of each thread that drives: its process, and what it shares with it."""


def drive(setup: Setup, make: Callable[[], Controller]) -> Trace:
    """The trace of a run under a law by others, which `make`, pickled, makes there.

    Raises CohelmError where the law fails in any way.
    """
    if multiprocessing.current_process().daemon:  # as under Dask's nanny: may have no children
        return driven(setup, make())
    return _answered(setup, make)


def check(make: Callable[[], Controller]) -> None:
    """Have a law by others made there, and not driven. Raises CohelmError where that fails."""
    _answered(None, make)


def _answered(setup: Setup | None, make: Callable[[], Controller]) -> Any:
    """What `_driven` answers. Raises CohelmError where the law fails in any way."""
    child, shared = _process()
    try:
        shared[_DUE], shared[_T] = time.monotonic() + _FIRST, 0.0
        child.send((sys.path, pickle.dumps((setup, make)), _LATER))
        while (answer := child.received()) is None:
            late = time.monotonic() > shared[_DUE]
            if late or child.gone:
                how = child.end(0.0 if late else 1.0)
                ended = f"ended its process{how and f' ({how})'}"
                slow = f"did not answer within {_LATER:g} s ({_FIRST:g} s for the first time)"
                raise CohelmError(f"the law {slow if late else ended} at t = {shared[_T]:.2f} s")
            child.wait(_LOOK)
    except BaseException:  # what it answers after Ctrl-C is no answer to the next drive
        _held.process = None
        child.end()
        raise
    if isinstance(answer, str):
        raise CohelmError(answer)
    return answer


def _process() -> tuple[Child, Any]:
    held = getattr(_held, "process", None)
    if held is not None:
        held[0].received()
        if not held[0].gone:
            return held
    shared = RawArray("d", 2)
    _held.process = Child("cohelm law", partial(_driven, shared), parent=True), shared
    return _held.process


def _driven(shared: Any, asked: tuple[list[str], bytes, float]) -> Trace | str | bool:
    """In the process: a drive, or why it failed; True without a setup, once the law is made."""
    lead_group()
    killed_with_parent()  # no thread of ours runs beside compiled code that never returns
    sys.path[:], packed, later = asked
    try:
        setup, make = pickle.loads(packed)
        law = make()
        if setup is None:
            return True

        def watched(now: Observation) -> Twist:
            shared[_T] = now.t
            command = law(now)
            shared[_DUE] = time.monotonic() + later
            return command

        return driven(setup, watched)
    except FAILS as error:
        return fault_of(error)
    finally:
        shared[_DUE] = math.inf
