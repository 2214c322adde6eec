"""Proof that a tracked thing moves: it is where it was free, or where it was is free now."""

from __future__ import annotations

import math

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.perceive.scan.clusters import FRESH, Look, was_free
from cohelm.perceive.track.track import (
    CALM,
    ENDS,
    MOVES,
    PROOF,
    SEEN,
    SINCE,
    TVX,
    TVY,
    WHERE,
    noted_ends,
    set_moving,
    set_resting,
)
from cohelm.robot.sensors import Lidar

_SCATTERS = 3.0  # so many standard deviations a beam's end may lie off, seen from elsewhere
_ANCHORED = 1.2  # where it stood is remembered for so long [s]


@jit
def prove(
    one: Floats, cluster: Floats, seen: Floats, lidar: Lidar, now: Look, slowest: float, proof: int,
    calm: float, max_acceleration: float,
) -> None:  # fmt: skip
    """Weigh whether the track moves, from what was free then and what is free now."""
    moves = math.hypot(one[TVX], one[TVY]) > slowest
    if moves and one[SEEN] >= 3.0 and (cluster[FRESH] >= 0.5 or _left(one, lidar, now)):
        one[PROOF] = min(one[PROOF] + 1.0, 2.0 * proof)
    else:
        one[PROOF] = max(one[PROOF] - 1.0, 0.0)
    if one[PROOF] >= proof:
        set_moving(one, max_acceleration)
    elif one[PROOF] == 0.0 and one[CALM] > calm and one[MOVES] > 0.0:
        set_resting(one)
    if one[SINCE] > _ANCHORED:
        noted_ends(one, seen)


@jit
def _left(one: Floats, lidar: Lidar, now: Look) -> bool:
    """Whether half of where beams ended on it a while ago is seen through now. The disc that a
    part of it was taken for is not asked: where that was may have been free all the time."""
    free = 0
    for i in range(ENDS):
        x, y = one[WHERE + 2 * i], one[WHERE + 2 * i + 1]
        if was_free(lidar, now, x, y, _SCATTERS * lidar.noise):
            free += 1
    return 2 * free >= ENDS
