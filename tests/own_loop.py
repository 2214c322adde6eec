"""Coroutines in tests: a thread that shows pages has a browser's event loop already."""

import asyncio
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def run(coroutine: Coroutine[Any, Any, Any], within: float = 20.0) -> Any:
    """`asyncio.run` in a thread of its own; raises TimeoutError after `within` [s]."""
    with ThreadPoolExecutor(1) as own:
        return own.submit(asyncio.run, coroutine).result(within)
