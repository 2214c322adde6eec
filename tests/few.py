"""Which of many cases the default suite takes; `make test-all` takes all of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first(cases: Iterable[Any], few: int = 1) -> list[Any]:
    """The first ones as they are, the others marked slow: for cases that differ in little."""
    taken = []
    for k, case in enumerate(cases):
        values = case if type(case) is tuple else (case,)
        taken.append(case if k < few else pytest.param(*values, marks=pytest.mark.slow))
    return taken
