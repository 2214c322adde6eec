"""What a user's code does at a start and does not come back from, is named."""

import contextlib
import multiprocessing
import subprocess
import sys
import threading
from collections.abc import Generator

WAITS = 5.0
"""A call at the start that takes longer is named [s]."""
_WATCHER = 'read over || echo "$0" >&2'
"""A shell that says its name where what it watches ends and has not said that all is well."""


@contextlib.contextmanager
def said_if_it_waits(call: str) -> Generator[None]:
    """During a start: a call of the user's code that takes long is named on stderr, else it is
    taken for compiling."""

    def say() -> None:
        what = f"{call} has not returned for {WAITS:g} s; the start waits"
        with contextlib.suppress(Exception):  # the user's code may have closed it
            print(what, file=sys.stderr, flush=True)

    timer = threading.Timer(WAITS, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextlib.contextmanager
def said_if_it_ends(what: str) -> Generator[None]:
    """What ends or crashes this process is named on stderr by another one, which then remains. Not
    in a child: how that ends its parent says."""
    if multiprocessing.parent_process() is not None:
        yield
        return
    command = ["/bin/sh", "-c", _WATCHER, what]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True
    ) as watcher:
        try:
            yield
        finally:
            watcher.communicate(b"over\n")
