"""Time to contact of a motion with the surrounding points, and which of them may be left."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import Twist
from cohelm.robot.collision_monitor.surroundings import MonitorSurroundings
from cohelm.robot.collision_monitor.sweep import Outline, contact_time, outside, outwards, ring_of

ALONG = 1e-6
"""What comes nearer by no more than this is passed along [m]."""


class Met(NamedTuple):
    """When a motion, held, meets what is around, and which of it: first its returns with their
    errors, then anything with its margin."""

    solid: float
    """[s], infinite for never."""
    solid_point: int
    anything: float
    """[s], infinite for never."""
    point: int


NEVER = Met(math.inf, -1, math.inf, -1)


@jit
def met(obstacles: MonitorSurroundings, twist: Twist, shape: Outline) -> Met:
    """What a motion meets. What is in the outline may be left. What is beside it, but may be nearer
    by its error, may be passed along too, and so may unknown ground, as that takes in no more of
    it."""
    solid, solid_point, anything, point = math.inf, -1, math.inf, -1
    ring = ring_of(twist, shape)
    for i in range(len(obstacles.points)):
        x, y, error = obstacles.points[i, 0], obstacles.points[i, 1], obstacles.errors[i]
        time = contact_time(x, y, obstacles.margins[i], twist, shape, ring)
        if time == math.inf:
            continue
        out = outwards(x, y, twist, shape) if time == 0.0 else -math.inf
        known = error > -math.inf
        if time < anything and (known or not out >= -ALONG):
            anything, point = time, i
        if not known:
            continue
        time = contact_time(x, y, error, twist, shape, ring)
        beside = outside(x, y, shape) > 0.0
        if time == 0.0 and (out >= -ALONG if beside else out > 0.0):
            continue
        if time < solid:
            solid, solid_point = time, i
    return Met(solid, solid_point, anything, point)
