"""The lab as a `Setup`, for the simulator's tests."""

import numpy as np

from cohelm.core.types import Floats, Pose, disc
from cohelm.law.gains import Gains
from cohelm.law.reference import through
from cohelm.robot.limits import Limits, unlimited
from cohelm.sim.setup import Setup
from cohelm.sim.world import Body, World, world
from tests.oracle import lab

LAB = through(lab.WAYPOINTS, lab.SPEED)
MOVER = through(lab.MOVER, lab.MOVER_SPEED)
SALLY = Limits(1.0, np.inf, 2.0, np.inf, 1.2, 2.0, 0.5)
"""The wheels of the shipped Sally model."""
WALLS = np.array([[-3.5, 5.0, 16.5, 5.0], [-1.0, -4.0, -1.0, 3.0], [0.45, 3.0, 12.55, 3.0]])
NO_WALLS = np.empty((0, 4))


def bodies() -> list[Body]:
    """The three cones and the mover."""
    cones = [Body(disc(x, y, lab.CONE_RADIUS, lab.SAFE)) for x, y in lab.CONES]
    here = disc(*lab.MOVER[0], lab.CONE_RADIUS, lab.SAFE)
    return [*cones, Body(here, MOVER, lab.MOVER_START)]


def lab_world(walls: Floats = NO_WALLS) -> World:
    return world((bodies(), walls))


def lab_run(k_cbf: float | None = 1.5, **changes) -> Setup:
    """The lab with the paper's gains; `k_cbf` None switches the barrier off."""
    gains = Gains(barrier=False) if k_cbf is None else Gains(k_cbf=k_cbf)
    given = {
        "start": Pose(*lab.START), "reference": LAB, "outline": lab.SALLY,
        "limits": unlimited(lab.TRACK), "gains": gains, "obstacles": lab_world(),
        "names": lab.NAMES,
    }  # fmt: skip
    return Setup(**(given | changes))
