"""Verdicts of every filter, in one list, so that records read alike."""

from __future__ import annotations

from enum import IntEnum

UNTOUCHED, SHAPED, POWERLESS, INVALID, BRAKING, STANDING = range(6)
"""UNTOUCHED: the wish passed. SHAPED: the filter changed it. POWERLESS: the paper's barrier alone,
see there. INVALID: a number that is not finite came in. BRAKING, STANDING: the guard alone,
nothing near the wish could be certified; the certified stop goes on, or the robot stands."""


class Verdict(IntEnum):
    """What became of a nominal command; the numbers are those of the records.

        >>> import cohelm
        >>> cohelm.Verdict(1).name
        'SHAPED'

    UNTOUCHED: it passed. SHAPED: the nearest allowed one did. BRAKING: nothing near it could be
    certified, and the stop that was certified before goes on; STANDING: the same, and the robot
    stands. INVALID: a number that is not finite came in. POWERLESS: the paper's barrier alone.
    """

    UNTOUCHED = UNTOUCHED
    SHAPED = SHAPED
    POWERLESS = POWERLESS
    INVALID = INVALID
    BRAKING = BRAKING
    STANDING = STANDING
