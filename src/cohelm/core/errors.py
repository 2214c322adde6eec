"""What a user can get wrong, as one class of error: a sentence that names the cure."""

from __future__ import annotations

from collections.abc import Iterable


class CohelmError(Exception):
    """Something the user gave can not be used; the message says what, where and how to mend it."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean X?`, to end a sentence with; nothing where no name is like the word."""
    from difflib import get_close_matches  # only who mistypes waits for it

    names = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), names, n=1, cutoff=0.5)
    return f"; did you mean {names[close[0]]}?" if close else ""
