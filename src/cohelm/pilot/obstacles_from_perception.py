"""Converts the result of perception to obstacles for filter and pilot."""

from __future__ import annotations

import numpy as np

from cohelm.core.frames import placed, turned
from cohelm.core.types import VX, VY, Floats, Pose, X, Y
from cohelm.law.guard.surroundings import Surroundings
from cohelm.perceive.pipeline import Seen

_NO_WALLS: Floats = np.empty((0, 4))


def obstacles_from_perception(seen: Seen, odom: Pose) -> Surroundings:
    """The obstacles of `seen`, in the frame in which `odom` is at this pose."""
    discs = seen.mobile.copy()
    discs[:, X : Y + 1] = placed(discs[:, X : Y + 1], odom)
    discs[:, VX : VY + 1] = turned(discs[:, VX : VY + 1], odom.psi)
    return Surroundings(
        discs, seen.mobile_max_acceleration, seen.mobile_velocity_error, _NO_WALLS,
        placed(seen.points, odom),
    )  # fmt: skip
