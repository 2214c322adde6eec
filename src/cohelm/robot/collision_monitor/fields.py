"""The allowed share of a motion: the stop field, and the slow-down field before it.

A motion goes on for a reaction time and then brakes, on the same arc, as the gate does it. Times
are of the motion held: braking from it within B goes as far as holding it for B/2.
"""

from __future__ import annotations

import math

CRAWL = 0.08
"""No part of the outline is faster than this where a return may be as near as its error allows
[m/s]: what is promised, 0.1 m/s, less a fifth that a drive may overshoot by."""
RESERVE = 0.2
"""Share of the deceleration that the slow-down field keeps in reserve."""


def allowed(room: float, reaction: float, braking: float, crawl: float = 0.0) -> float:
    """The largest share of a motion that has come down to `crawl` of it where the room ends.

    room: how long the whole motion may be held until contact; reaction: how long it is held
    before it brakes; braking: from the whole motion to standing [s]. crawl: share that may go on
    beyond the room. At least `crawl`; not limited to 1.

    s reaction + (s^2 - crawl^2) braking / 2 = room, solved for s without a difference.
    """
    if room == math.inf:
        return math.inf
    room += 0.5 * crawl * crawl * braking
    below = reaction + math.sqrt(reaction * reaction + 2.0 * braking * room)
    return max(2.0 * room / below, crawl) if below > 0.0 else (math.inf if room > 0.0 else crawl)


def horizon(reaction: float, braking: float) -> float:
    """Nothing that is met after so long a hold [s] limits the whole motion."""
    return reaction + 0.5 * braking
