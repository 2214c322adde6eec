"""What became of a wish: one list of verdicts for every filter, so that records read alike."""

UNTOUCHED, SHAPED, POWERLESS, INVALID, BRAKING, STANDING = range(6)
"""UNTOUCHED: the wish passed. SHAPED: the filter changed it. POWERLESS: the paper's barrier alone,
see there. INVALID: a number that is not finite came in. BRAKING, STANDING: the guard alone,
nothing near the wish could be certified; the certified stop goes on, or the robot stands."""
