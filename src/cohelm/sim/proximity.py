"""How near a run came to movers, and for how long: the distance a person feels.

It works from the trace alone, as the judge does, once a control step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, Floats, Pose, X, Y
from cohelm.robot.clearance import disc_clearance
from cohelm.sim.judge import FAR
from cohelm.sim.world import World, moves

INTIMATE = 0.45
"""Gap nearer than which only intimates are welcome [m] (E. T. Hall, The Hidden Dimension, 1966)."""


class Proximity(NamedTuple):
    """To the nearest of all that move at any time, also while they stand."""

    closest: float = FAR
    """Smallest gap of the outline, negative in overlap; at most FAR [m]."""
    near: int = 0
    """Control steps in which it was below INTIMATE."""


def movers(world: World) -> NDArray[np.bool_]:
    """(n,): which discs of a world ever move."""
    return np.array([moves(i, world) for i in range(len(world.discs))], dtype=np.bool_)


@jit
def approached(
    seen: Proximity, rows: NDArray[np.void], discs: Floats, outline: Floats,
    moving: NDArray[np.bool_],
) -> Proximity:  # fmt: skip
    """Continue over further rows. rows: (n,) of dtype `core.row.ROW`, discs: (n, m, 6), moving:
    (m,)."""
    closest, near, reach = seen.closest, seen.near, 0.0
    for i in range(len(outline)):
        reach = max(reach, np.hypot(outline[i, 0], outline[i, 1]))
    for k in range(len(rows)):
        pose = Pose(rows[k].x, rows[k].y, rows[k].psi)
        least = FAR
        for i in range(len(moving)):
            if not moving[i]:
                continue
            x, y, radius = discs[k, i, X], discs[k, i, Y], discs[k, i, RADIUS]
            matters = min(least, max(closest, INTIMATE))
            if np.hypot(x - pose.x, y - pose.y) < matters + radius + reach:
                least = min(least, disc_clearance(pose, outline, x, y, radius))
        closest = min(closest, least)
        near += least < INTIMATE
    return Proximity(closest, near)
