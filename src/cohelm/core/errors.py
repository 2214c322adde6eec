"""What a user can get wrong, as one class of error: a sentence that names the cure."""

from __future__ import annotations


class CohelmError(Exception):
    """Something the user gave can not be used; the message says what, where and how to mend it."""
