"""Docks: named places that the robot drives into, straight and slowly, with a margin of their own.

All that is here is geometry: where a dock's approach begins, and how a pose lies to it. In a dock's
own frame the docked robot is at 0, x is the way it looks then, and it comes from negative x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between, compose, placed
from cohelm.core.types import Floats, Pose

STAGED_ASIDE, STAGED_TURNED = 0.2, math.radians(20.0)
"""The approach is begun from no farther beside its line [m], and turned away from it [rad]."""
BEFORE = 0.4
"""And from no farther before its beginning [m]."""
CORRIDOR_ASIDE, CORRIDOR_TURNED = 0.3, math.radians(40.0)
"""Farther off the line than this the robot has left the corridor [m, rad]."""
BEYOND = 0.1
"""And farther before its beginning, or past its end, than where it may begin or end by this [m]."""
DOCKED_ALONG, DOCKED_ASIDE, DOCKED_TURNED = 0.03, 0.05, math.radians(5.0)
"""The robot is docked where it is no farther off than this [m, m, rad]."""
LOOK = 0.02
"""Between poses along an approach that are held against a map [m]."""


class Dock(NamedTuple):
    """A place to dock at, in the map."""

    name: str
    pose: Pose
    """Of the docked robot."""
    approach: float
    """Length of the straight way that ends there [m]."""
    margin: float
    """Gap of the outline that commands are shaped to keep on it [m]."""
    speed: float
    """No more is asked for on it [m/s]."""
    within: float
    """It takes no longer, or docking ends [s]."""

    @property
    def staging(self) -> Pose:
        """Where the approach begins, looking along it."""
        return compose(self.pose, Pose(-self.approach, 0.0, 0.0))

    def off(self, pose: Pose) -> Pose:
        """A pose of the map in the dock's frame."""
        return between(self.pose, pose)


def far(dock: Dock, pose: Pose) -> float:
    """How far a robot is from the line of the approach [m]."""
    x, y, _ = dock.off(pose)
    return math.hypot(x - min(max(x, -dock.approach), 0.0), y)


def may_begin(dock: Dock, pose: Pose) -> bool:
    """Whether docking or undocking may begin at a pose."""
    x, y, psi = dock.off(pose)
    along = -dock.approach - BEFORE <= x <= BEYOND
    return along and abs(y) <= STAGED_ASIDE and abs(psi) <= STAGED_TURNED


def in_corridor(dock: Dock, pose: Pose) -> bool:
    """Whether a robot that docks or undocks is still where it should be."""
    x, y, psi = dock.off(pose)
    along = -dock.approach - BEFORE - BEYOND <= x <= BEYOND
    return along and abs(y) <= CORRIDOR_ASIDE and abs(psi) <= CORRIDOR_TURNED


def docked(dock: Dock, pose: Pose) -> bool:
    """Whether a robot is as near to the dock's pose as docking brings it."""
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
