"""Motion test of a track by free-space violation (Petrovskaya and Thrun 2009)."""

from __future__ import annotations

import math

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.perceive.scan.clusters import FRESH
from cohelm.perceive.scan.deskew import DeskewedScan, was_free
from cohelm.perceive.track.params import TrackerParams
from cohelm.perceive.track.track import (
    AT_REST,
    ENDS_AGE,
    ENDS_AT,
    MOVES,
    N_ENDS,
    PROOF,
    SEEN,
    TVX,
    TVY,
    radius_known,
    set_ends,
    set_moving,
    set_resting,
)
from cohelm.robot.sensors import Lidar

_SIGMAS = 3.0  # of the range, tolerance of a beam's end seen from elsewhere
_ENDS_KEPT = 1.2  # how long the reference ends are kept [s]


@jit
def update_proof(
    track: Floats, cluster: Floats, points: Floats, lidar: Lidar, sweep: DeskewedScan,
    params: TrackerParams,
) -> None:  # fmt: skip
    """Update the proof that a track moves: it is where space was free, or where it was is free.

    points: of its cluster, in `odom`.
    """
    proof = params.proof
    calm = params.dynamic.keep if radius_known(track) else params.calm
    moves = math.hypot(track[TVX], track[TVY]) > params.slowest
    fresh = cluster[FRESH] >= 0.5
    if moves and track[SEEN] >= 3.0 and (fresh or _seen_through(track, lidar, sweep)):
        track[PROOF] = min(track[PROOF] + 1.0, 2.0 * proof)
    else:
        track[PROOF] = max(track[PROOF] - 1.0, 0.0)
    if track[PROOF] >= proof:
        set_moving(track, params.max_acceleration)
    elif track[PROOF] == 0.0 and track[AT_REST] > calm and track[MOVES] > 0.0:
        set_resting(track)
    if track[ENDS_AGE] > _ENDS_KEPT:
        set_ends(track, points)


@jit
def _seen_through(track: Floats, lidar: Lidar, sweep: DeskewedScan) -> bool:
    """Whether beams now pass half of the places in which beams ended on it a while ago. The fitted
    disc is not used: of a partly visible object its place may have been free all the time."""
    free = 0
    for i in range(N_ENDS):
        x, y = track[ENDS_AT + 2 * i], track[ENDS_AT + 2 * i + 1]
        if was_free(lidar, sweep, x, y, _SIGMAS * lidar.noise):
            free += 1
    return 2 * free >= N_ENDS
