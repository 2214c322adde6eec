"""Waiting on a machine that may be busy."""

import time
from collections.abc import Iterator


def looks(within: float, every: float, counted: float) -> Iterator[None]:
    """Now and then, `every` so long [s], until `within` [s] have been waited.

    While this process does not run, its threads do not either: from one look to the next no more
    than `counted` [s] is taken for waiting.
    """
    waited, last = 0.0, time.monotonic()
    while True:
        yield
        if waited > within:
            return
        time.sleep(every)
        now = time.monotonic()
        waited, last = waited + min(now - last, counted), now
