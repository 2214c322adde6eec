"""Verdicts of all filters, as numbered in records."""

from __future__ import annotations

from enum import IntEnum

UNTOUCHED, SHAPED, POWERLESS, INVALID, BRAKING, STANDING = range(6)
"""UNTOUCHED: the nominal command passed. SHAPED: the filter changed it. POWERLESS: the paper's
barrier alone, see there. INVALID: an argument was not finite. BRAKING, STANDING: the
guard alone, nothing near the nominal command could be certified; the certified stop goes on, or
the robot stands."""


class Verdict(IntEnum):
    """What became of a nominal command.

        >>> import cohelm
        >>> cohelm.Verdict(1).name
        'SHAPED'

    A record has the numbers of these.
    """

    UNTOUCHED = UNTOUCHED
    """It passed."""
    SHAPED = SHAPED
    """The nearest that is allowed did."""
    POWERLESS = POWERLESS
    """Of the paper's barrier alone: no command could keep it."""
    INVALID = INVALID
    """A number that is not finite came in."""
    BRAKING = BRAKING
    """Nothing near it could be certified: the stop that was certified before goes on."""
    STANDING = STANDING
    """The same, and the robot stands."""
