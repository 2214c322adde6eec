"""Docks: named places that the robot drives into, straight and slowly, with a margin of their own.

Geometry only: the staging pose, and errors of a pose. In a dock's own frame the docked robot is at
0, facing x, and it comes from negative x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import compose, placed
from cohelm.core.types import Floats, Pose

STAGED_ASIDE, STAGED_TURNED = 0.2, math.radians(20.0)
"""Largest cross-track [m] and heading error [rad] at which an approach may begin."""
BEFORE = 0.4
"""And largest distance before its beginning [m]."""
CORRIDOR_ASIDE, CORRIDOR_TURNED = 0.3, math.radians(40.0)
"""Errors beyond which the robot has left the corridor [m, rad]."""
BEYOND = 0.1
"""And how far beyond where it may begin or end the corridor extends [m]."""
DOCKED_ALONG, DOCKED_ASIDE, DOCKED_TURNED = 0.03, 0.05, math.radians(5.0)
"""Tolerance of the docked pose [m, m, rad]."""
LOOK = 0.02
"""Between poses along an approach that are checked on a map [m]."""


class Dock(NamedTuple):
    """A place to dock at, in the map."""

    name: str
    pose: Pose
    """Of the docked robot."""
    approach: float
    """Length of the straight approach that ends there [m]."""
    margin: float
    """Clearance that commands are shaped to keep on it [m]."""
    speed: float
    """Largest speed on it [m/s]."""
    within: float
    """Timeout of docking [s]."""

    @property
    def staging(self) -> Pose:
        """The pose at which the approach begins, facing along it."""
        return compose(self.pose, Pose(-self.approach, 0.0, 0.0))

    def off(self, pose: Pose) -> Pose:
        """A pose of the map in the dock's frame: `frames.between` in plain Python, which is faster
        to call for every dock in every period."""
        dx, dy, turn = pose.x - self.pose.x, pose.y - self.pose.y, pose.psi - self.pose.psi
        c, s = math.cos(self.pose.psi), math.sin(self.pose.psi)
        turn = math.remainder(turn, 2.0 * math.pi) if math.isfinite(turn) else math.nan
        return Pose(c * dx + s * dy, c * dy - s * dx, turn)


def far(dock: Dock, pose: Pose) -> float:
    """Cross-track error from the line of the approach [m]."""
    x, y, _ = dock.off(pose)
    return math.hypot(x - min(max(x, -dock.approach), 0.0), y)


def may_begin(dock: Dock, pose: Pose) -> bool:
    """Whether docking or undocking may begin at a pose."""
    x, y, psi = dock.off(pose)
    along = -dock.approach - BEFORE <= x <= BEYOND
    return along and abs(y) <= STAGED_ASIDE and abs(psi) <= STAGED_TURNED


def in_corridor(dock: Dock, pose: Pose) -> bool:
    """Whether a robot that docks or undocks is still in the corridor."""
    x, y, psi = dock.off(pose)
    along = -dock.approach - BEFORE - BEYOND <= x <= BEYOND
    return along and abs(y) <= CORRIDOR_ASIDE and abs(psi) <= CORRIDOR_TURNED


def docked(dock: Dock, pose: Pose) -> bool:
    """Whether a robot is docked, within the tolerance."""
    x, y, psi = dock.off(pose)
    return abs(x) <= DOCKED_ALONG and abs(y) <= DOCKED_ASIDE and abs(psi) <= DOCKED_TURNED


def stands_in(dock: Dock, pose: Pose, outline: Floats, discs: Floats, backwards: bool) -> bool:
    """Whether any disc is where the robot has yet to drive, or beside that by less than the margin.

    discs: (n, 6) as in `core.types`, in the map. backwards: to the beginning of the approach, and
    not to its end.
    """
    if not len(discs):
        return False
    x = dock.off(pose).x
    own = placed(discs[:, :2] - np.array(dock.pose[:2]), Pose(0.0, 0.0, -dock.pose.psi))
    reach = discs[:, 4] + dock.margin
    front, rear = float(outline[:, 0].max()), float(outline[:, 0].min())
    low, high = (x, front) if not backwards else (rear - dock.approach, x)
    beside = np.abs(own[:, 1]) < float(np.abs(outline[:, 1]).max()) + reach
    return bool((beside & (own[:, 0] > low - reach) & (own[:, 0] < high + reach)).any())


def poses_to(dock: Dock) -> Floats:
    """Along its approach, the docked one last, (n, 3)."""
    n = math.ceil(dock.approach / LOOK) + 1
    at = [compose(dock.pose, Pose(x, 0.0, 0.0)) for x in np.linspace(-dock.approach, 0.0, n)]
    return np.array(at, dtype=np.float64)


def nearest(docks: Sequence[Dock], pose: Pose) -> int:
    """The dock at which docking or undocking could begin here, from 1; 0: none. Of several the one
    whose docked pose is nearest."""
    own = [i for i, dock in enumerate(docks) if may_begin(dock, pose)]
    return min(own, key=lambda i: math.hypot(*docks[i].off(pose)[:2])) + 1 if own else 0
