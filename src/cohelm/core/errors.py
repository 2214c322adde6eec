"""The class of user errors: one sentence that names the cure."""

from __future__ import annotations

import math
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
    """`; did you mean X?`, to end a sentence with; nothing where no name is like the word.

    A name is like it where one letter in three at most, up to a dot, is wrong, missing, too many or
    swapped with the next: so people mistype, and a share of letters in common, as difflib takes it,
    makes all words alike that end in `_m` or `.yaml`. Or it is the only one that begins with it.
    """
    names = {name.lower(): name for name in known}
    word = word.lower()
    most = math.ceil(len(word.partition(".")[0]) / 3)
    errors = {n: _errors(word, n) for n in names if abs(len(n) - len(word)) <= most}
    near = min(errors, key=errors.__getitem__, default="")
    if not near or errors[near] > most:
        begun = [name for name in names if name.startswith(word)] if len(word) > 2 else []
        near = begun[0] if len(begun) == 1 else ""
    return f"; did you mean {names[near]}?" if near else ""


def _errors(typed: str, meant: str) -> int:
    """How many letters were typed wrongly (the distance of Damerau and Levenshtein)."""
    before, last = [0], list(range(len(meant) + 1))
    for i, a in enumerate(typed, 1):
        row = [i]
        for j, b in enumerate(meant, 1):
            row.append(min(row[-1] + 1, last[j] + 1, last[j - 1] + (a != b)))
            if i > 1 and j > 1 and a == meant[j - 2] and typed[i - 2] == b:
                row[j] = min(row[j], before[j - 2] + 1)
        before, last = last, row
    return last[-1]
