"""The class of user errors: one sentence that names the cure."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path


class CohelmError(Exception):
    """An input can not be used; the message says what, where and how to mend it.

    >>> import cohelm
    >>> cohelm.SafetyFilter(cohelm.load_robot("sally"), period=0.0)
    Traceback (most recent call last):
    cohelm.core.errors.CohelmError: period must be from 0.001 to 1 s, got 0
    """


@contextmanager
def naming(file: Path) -> Generator[None]:
    """Name the file in what is wrong with what was read from it."""
    try:
        yield
    except CohelmError as error:
        raise CohelmError(f"{file}: {error}") from error


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean X?`, to end a sentence with; nothing where no name is like the word."""
    from difflib import get_close_matches  # imported only when needed

    names = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), names, n=1, cutoff=0.5)
    return f"; did you mean {names[close[0]]}?" if close else ""
